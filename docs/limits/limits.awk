# Writes docs/explanation/limits.md from docs/limits/limits.md.in and the output of the tests, run in the top folder of the project:
#   awk -f docs/limits/limits.awk docs/limits-*.log docs/limits/limits.md.in > docs/explanation/limits.md
# A test prints a line: limit | PARAMETER | RANGE | SEARCH | TYPICAL | MARGIN | PROPERTY | RESULT | `TEST` |
# Each log holds the output of all tests, with another number of threads or another build. All logs must hold the same
# lines.

# The test harness may have printed something before on the same line.
/limit \| / {
    sub(/.*limit \| /, "| ")
    if (!logs_with[$0]++) row[++rows] = $0
    next
}
FILENAME ~ /\.log$/ { if (FILENAME != log_before) { logs++; log_before = FILENAME }; next }

/^@limits$/ {
    if (rows == 0) { print FILENAME ": no limits in the logs; expected lines 'limit | ...' of the tests" > "/dev/stderr"; failed = 1; exit 1 }
    for (i = 1; i <= rows; i++)
        if (logs_with[row[i]] != logs) { print "in " logs_with[row[i]] " of " logs " logs: " row[i] > "/dev/stderr"; failed = 1; exit 1 }
    print "| parameter | stated range | search | typical use | margin | what holds within it | found | test |\n|---|---|---|---|---|---|---|---|"
    # Sorted by parameter, since tests end in any order.
    for (i = 2; i <= rows; i++) {
        one = row[i]
        for (k = i - 1; k >= 1 && row[k] > one; k--) row[k + 1] = row[k]
        row[k + 1] = one
    }
    for (i = 1; i <= rows; i++) print row[i]
    next
}
{ print }
END { if (failed) exit 1 }
