# Solid fractions and coordination numbers of packings, means over seeds:
#
#   awk -v csv=packing.csv -f packing.awk cell-mu0-s1 cell-mu0-s2 ...
#
# Cases whose names differ in the seed at their end, -sN, are one packing. Values are those of the last snapshot; the error is a
# standard deviation over the seeds, over the root of their number. Z is the mean number of neighbours of the
# grains without rattlers. Columns are found by their names.
#
# Reads: CASE/POSTPRO/series.csv: nu, Z, Z_no_rattlers, rattler_fraction
# Writes: packing.csv: packing, seeds, nu, nu_error, Z_no_rattlers, Z_no_rattlers_error, rattler_fraction; the same on stdout

BEGIN {
    FS = ","
    for (i = 1; i < ARGC; i++) measure(ARGV[i])
    print "packing,seeds,nu,nu_error,Z_no_rattlers,Z_no_rattlers_error,rattler_fraction" > csv
    printf "%-22s %5s %16s %16s %9s\n", "packing", "seeds", "nu", "Z", "rattlers"
    for (k = 1; k <= packings; k++) {
        n = count[k]
        printf "%s,%d,%.5g,%.2g,%.4g,%.2g,%.3g\n", name[k], n, nu[k] / n, error(nu[k], nu2[k], n), z[k] / n, error(z[k], z2[k], n), rattlers[k] / n > csv
        printf "%-22s %5d %8.4f +- %.4f %7.2f +- %.2f %9.3f\n", name[k], n, nu[k] / n, error(nu[k], nu2[k], n), z[k] / n, error(z[k], z2[k], n), rattlers[k] / n
    }
    exit
}

# Error of the mean of n values, from their sum and the sum of their squares.
function error(sum, squares, n,    variance) {
    if (n < 2) return 0
    variance = (squares - sum * sum / n) / (n - 1)
    return variance > 0 ? sqrt(variance / n) : 0
}

function measure(folder,    file, k, packing, column, last) {
    packing = folder; sub(/-s[0-9]+$/, "", packing)
    if (!(packing in number)) { number[packing] = ++packings; name[packings] = packing }
    file = folder "/POSTPRO/series.csv"
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    for (k = 1; k <= NF; k++) column[$k] = k
    while ((getline < file) > 0) last = $0
    close(file)
    split(last, value, ",")
    k = number[packing]; count[k]++
    nu[k] += value[column["nu"]]; nu2[k] += value[column["nu"]] ^ 2
    z[k] += value[column["Z_no_rattlers"]]; z2[k] += value[column["Z_no_rattlers"]] ^ 2
    rattlers[k] += value[column["rattler_fraction"]]
}
