# Friction angle of grains between plates, from the forces on them:
#
#   awk -v csv=triaxial.csv -f ../datbox.awk -f triaxial.awk mu0.2 mu0.4 ...
#
# Reads CASE/POSTPRO/track-N/track.csv of the plates at x, at y and on top, the last three bodies of CASE/DATBOX/BODIES.DAT, and the
# friction_angle of the mean stress in CASE/POSTPRO/series.csv. Stresses are forces over areas, sin(phi) = (s_1 - s_3) / (s_1 + s_3) with
# s_1 on top and s_3 the mean of the sides. Means are over axial strains of FROM to TO, strain from where the top plate begins to move, with the error of the mean: a
# standard deviation of means over tenths, over the root of ten. q = 2 sin(phi) / (3 - sin(phi)) is the slope of Drucker and Prager's cone, and
# spin2 = 3 q / (1 + 2 q) the square of the spin at which a ball of such grains yields under its own gravity, over 4 pi G rho / 3.
# Lengths in m. Columns are found by their names.
#
# Reads: track.csv: time, x, y, z, f_x, f_y, f_z; series.csv: friction_angle (rad); BODIES.DAT
# Writes: triaxial.csv: friction, friction_angle, error, of_mean_stress (degrees), solid_fraction_at_first, solid_fraction, q, spin2; the same on
#   stdout

BEGIN {
    FS = ","; FROM = 0.05; TO = 0.2; DEGREE = atan2(0, -1) / 180
    print "friction,friction_angle,error,of_mean_stress,solid_fraction_at_first,solid_fraction,q,spin2" > csv
    print " friction  angle [deg]     +-  of the mean stress  solid fraction, first, then   (spin/critical)^2"
    for (i = 1; i < ARGC; i++) measured(ARGV[i])
    exit
}

function fields(    k) { delete column; for (k = 1; k <= NF; k++) column[$k] = k }

function asin(x) { return atan2(x, sqrt(1 - x * x)) }

# Reads the place and the force along `axis` of the plate that is the last but `back` into place[row], force[row].
function track(folder, plate, axis, place, force,    file, row) {
    file = folder "/POSTPRO/track-" sprintf("%d", plate) "/track.csv"
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    fields()
    while ((getline < file) > 0) { time[++row] = $column["time"]; place[row] = $column[axis] - half_thickness; force[row] = $column["f_" axis] }
    close(file)
    return row
}

function measured(folder,    file, row, rows, x, y, z, fx, fy, fz, s1, s3, strain, first, at, sine, n, sum, tenth, part, m, angle, mean, spread, q, mu) {
    read_bodies(folder "/DATBOX")
    track(folder, body_count - 2, "x", x, fx); track(folder, body_count - 1, "y", y, fy); rows = track(folder, body_count, "z", z, fz)
    file = folder "/POSTPRO/series.csv"
    getline < file; fields()
    for (row = 1; (getline < file) > 0; row++) at[row] = $column["friction_angle"]
    close(file)
    for (row = 1; row <= rows; row++) {
        if (z[row] == z[1]) { first = row; continue }
        strain = 1 - z[row] / z[first]
        if (strain < FROM || strain > TO) continue
        s1 = fz[row] / (x[row] * y[row]); s3 = (fx[row] / (y[row] * z[row]) + fy[row] / (x[row] * z[row])) / 2
        angle = asin((s1 - s3) / (s1 + s3)) / DEGREE
        tenth = int(10 * (strain - FROM) / (TO - FROM) * 0.999999)
        part[tenth] += angle; m[tenth]++
        n++; mean += angle; sum += at[row] / DEGREE; dense += grain_volume / (x[row] * y[row] * z[row])
    }
    if (n < 20) { print folder ": fewer than twenty states at strains of " FROM " to " TO > "/dev/stderr"; exit 1 }
    mean /= n
    for (tenth = 0; tenth < 10; tenth++) if (m[tenth]) spread += (part[tenth] / m[tenth] - mean) ^ 2 / 10
    sine = sin(mean * DEGREE); q = 2 * sine / (3 - sine)
    mu = folder; sub(/.*mu/, "", mu)
    printf "%s,%.5g,%.3g,%.5g,%.5g,%.5g,%.5g,%.5g\n", mu, mean, sqrt(spread / 9), sum / n, grain_volume / (x[first] * y[first] * z[first]), dense / n, q, 3 * q / (1 + 2 * q) > csv
    printf "%9s %12.1f %6.1f %19.1f %21.3f %6.3f %19.3f\n", mu, mean, sqrt(spread / 9), sum / n, grain_volume / (x[first] * y[first] * z[first]), dense / n, 3 * q / (1 + 2 * q)
    dense = 0
}
