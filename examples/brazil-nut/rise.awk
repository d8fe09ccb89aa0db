# Rise of a large ball in a shaken box, from the rows of a probe at the end of each cycle:
#
#   awk -f rise.awk earth-s1/POSTPRO/probe-nut.csv ...
#
# The slope of the height by least squares, from the tenth cycle on.
#
# Reads: probe-nut.csv: time, z
# Writes: a line for each case on stdout: cycles, rise per cycle (mm), rise per time (mm/s)

BEGIN { FS = ","; printf "%-14s %7s %20s %16s\n", "case", "cycles", "rise [mm per cycle]", "rise [mm/s]" }
FNR == 1 { report(); cycles = n = sum_x = sum_z = sum_xx = sum_xz = 0; name = FILENAME; sub(/\/POSTPRO.*/, "", name)
           for (k = 1; k <= NF; k++) place[$k] = k; next }
{
    cycles++; time = $place["time"]; z = 1000 * $place["z"]
    if (cycles < 10) next
    n++; sum_x += cycles; sum_z += z; sum_xx += cycles * cycles; sum_xz += cycles * z
}
END { report() }

function report(    slope) {
    if (n < 2) return
    slope = (n * sum_xz - sum_x * sum_z) / (n * sum_xx - sum_x * sum_x)
    printf "%-14s %7d %20.2f %16.3g\n", name, cycles, slope, slope * cycles / time
}
