# Writes docs/limits.md from docs/limits/limits.md.in and what tests have told, at the top folder of the project:
#   awk -f docs/limits/limits.awk docs/limits-*.log docs/limits/limits.md.in > docs/limits.md
# A line of a test: limit | PARAMETER | RANGE | WHAT HOLDS | HOW WELL | `TEST` |
# Every log is of all tests, with other threads and another build: all must have told the same lines.

# The harness may have begun the line.
/limit \| / {
    sub(/.*limit \| /, "| ")
    if (!told[$0]++) row[++rows] = $0
    next
}
FILENAME ~ /\.log$/ { if (FILENAME != log_before) { logs++; log_before = FILENAME }; next }

/^@limits$/ {
    if (rows == 0) { print FILENAME ": no test has told a limit" > "/dev/stderr"; failed = 1; exit 1 }
    for (i = 1; i <= rows; i++)
        if (told[row[i]] != logs) { print "told by " told[row[i]] " of " logs " runs: " row[i] > "/dev/stderr"; failed = 1; exit 1 }
    print "| parameter | range | what holds within it | found | test |\n|---|---|---|---|---|"
    # By parameter; tests end in any order.
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
