# Angle of the bed of a drum about the y axis, slope of its surface, and power of the drum over that of gravity; columns
# are found by their names.
#
#   awk -f ../datbox.awk -f drum.awk DATBOX/evolution-1.dat POSTPRO/series.csv
#
# Means over the second half: the angle between the vertical and the line from the axis to the centre of mass; the slope
# of the free surface; and the power that the walls give over the moment of the weight times the speed of the drum
# (rad/s) at the end of its table, which are equal in a steady flow.
#
# Reads: evolution-1.dat: time, speed; DATBOX: gravity; series.csv: time, mass, com_x, com_z, E_outside, surface_slope
# Writes: three lines on stdout: angle of the bed and slope of its surface, degrees; power over that of gravity, 1

BEGIN { FS = "," }
FILENAME ~ /\.dat$/ {
    if (split($0, point, " ") == 2) speed = point[2]
    datbox = FILENAME; sub(/\/[^\/]*$/, "", datbox)
    next
}
FNR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }
{
    n++; time[n] = $column["time"]; x[n] = $column["com_x"]; z[n] = $column["com_z"]; work[n] = $column["E_outside"]
    slope[n] = $column["surface_slope"]; mass = $column["mass"]
}
END {
    for (k = int(n / 2); k <= n; k++) { count++; sum_x += x[k]; sum_z += z[k]; sum_slope += slope[k] }
    first = int(n / 2)
    power = (work[n] - work[first]) / (time[n] - time[first])
    x_mean = sum_x / count; if (x_mean < 0) x_mean = -x_mean
    printf "angle of the bed         %.1f degrees\n", atan2(x_mean, -sum_z / count) * 180 / atan2(0, -1)
    printf "slope of its surface     %.1f degrees\n", sum_slope / count * 180 / atan2(0, -1)
    printf "power over that of gravity %.3f\n", power / (mass * uniform_gravity(datbox) * x_mean * speed)
}
