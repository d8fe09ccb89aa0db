# Friction and solid fraction of a sheared bed against its inertial number:
#
#   awk -v svg=friction.svg -f ../datbox.awk -f ../inertial-number.awk -f friction.awk v0.01 v0.03 ...
#
# Reads CASE/POSTPRO/plate/track.csv (displacement of the plate and force of the rocks on it) and, from CASE/DATBOX, the volume,
# mean diameter and density of the rocks, the thickness of the plate and the area of the cell. Means
# are over the states in which the plate has gone farther than START m. Shear and normal stress are the forces over the area of the
# cell, I = V/H d sqrt(density/normal stress) with V/H the speed over the height between the plates. The table goes to friction.csv
# next to the figure. Errors: a standard deviation of means over tenths of the displacement, over the root of ten.
#
# Reads: plate/track.csv: time, x, z, f_x, f_z; BODIES.DAT, BULK_BEHAV.DAT, COMPUTE.RON
# Writes: friction.csv: speed (m/s), inertial_number, friction, friction_error, solid_fraction, normal_stress (Pa), height (m); the same on stdout;
#   the figure of friction and solid fraction (svg)

BEGIN {
    FS = ","; START = 1.5
    for (i = 1; i < ARGC; i++) { name[++points] = ARGV[i]; shear(ARGV[i], points) }
    if (!points) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    table = svg; sub(/svg$/, "csv", table)
    header = "speed,inertial_number,friction,friction_error,solid_fraction,normal_stress,height"
    print header > table
    printf "%12s %17s %10s %8s %16s %20s %11s\n", "speed [m/s]", "inertial number", "friction", "+-", "solid fraction", "normal stress [Pa]", "height [m]"
    for (k = 1; k <= points; k++) {
        printf "%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", v[k], inertial[k], mu[k], mu_error[k], nu[k], normal[k], height[k] > table
        printf "%12.4g %17.4g %10.3f %8.3f %16.3f %20.2f %11.3f\n", v[k], inertial[k], mu[k], mu_error[k], nu[k], normal[k], height[k]
    }
    close(table)
    draw("A sheared bed against its inertial number")
    exit
}

function fields(    k) { delete column; for (k = 1; k <= NF; k++) column[$k] = k }

function shear(folder, k,    file, rows, x, fx, fz, z, time, n, part, tenth, sum, sum2, m) {
    file = folder "/POSTPRO/plate/track.csv"
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    fields()
    while ((getline < file) > 0) {
        if ($column["x"] < START) continue
        rows++; time[rows] = $column["time"]; x[rows] = $column["x"]
        fx[rows] = -$column["f_x"]; fz[rows] = $column["f_z"]; z[rows] = $column["z"]
    }
    close(file)
    read_bodies(folder "/DATBOX"); area = option_number(folder "/DATBOX", "xperiode") * option_number(folder "/DATBOX", "yperiode")
    if (rows < 20) { print file ": the plate has not gone farther than " START " m in twenty states" > "/dev/stderr"; exit 1 }
    for (n = 1; n <= rows; n++) { tangential[k] += fx[n] / rows / area; normal[k] += fz[n] / rows / area; height[k] += (z[n] - half_thickness) / rows }
    mu[k] = tangential[k] / normal[k]
    v[k] = (x[rows] - x[1]) / (time[rows] - time[1])
    inertial[k] = v[k] / height[k] * mean_diameter * sqrt(grain_density / normal[k])
    for (n = 1; n <= rows; n++) { tenth = int(10 * (n - 1) / rows); part[tenth] += fx[n]; m[tenth] += fz[n] }
    for (n = 0; n < 10; n++) { sum += part[n] / m[n] / 10; sum2 += (part[n] / m[n]) ^ 2 / 10 }
    mu_error[k] = sqrt((sum2 - sum * sum > 0 ? sum2 - sum * sum : 0) / 9)
    nu[k] = grain_volume / area / height[k]
}
