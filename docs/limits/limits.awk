# Writes docs/limits.md from docs/limits/limits.md.in and what tests have told, at the top folder of the project:
#   awk -f docs/limits/limits.awk docs/limits.log docs/limits/limits.md.in > docs/limits.md
# A line of a test: limit | PARAMETER | RANGE | WHAT HOLDS | HOW WELL | `TEST` |

# The harness may have begun the line.
/limit \| / { sub(/.*limit \| /, "| "); row[++rows] = $0; next }
FNR == NR { next }

/^@limits$/ {
    if (rows == 0) { print FILENAME ": no test has told a limit" > "/dev/stderr"; failed = 1; exit 1 }
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
