# Friction angle of grains between plates, from the pressures on them:
#
#   awk -v csv=triaxial.csv -v packings=packings.csv -v svg=stress_strain.svg -f ../datbox.awk -f triaxial.awk mu0.2-s1 mu0.2-s2 ...
#
# CASE/POSTPRO/probe-x.csv, -y and -z have the areas between the plates and the pressures, s_3 at x and y, s_1 on top: sin(phi) = (s_1 -
# s_3) / (s_1 + s_3). Lengths follow from the areas: z = sqrt(A_x A_y / A_z), V = sqrt(A_x A_y A_z). Means are over axial strains
# ln(z_0 / z) of FROM to TO. Of the seeds of a friction, `-sSEED` in the name of the case, mean and error of the mean are given. The
# largest deviation of a side from its pressure is that of means over tenths of the strains. q = 2 sin(phi) / (3 - sin(phi)) is the slope of
# Drucker and Prager's cone, and spin2 = 3 q / (1 + 2 q) the square of the spin at which a ball of such grains yields under its
# own gravity, over 4 pi G rho / 3. Columns are found by their names.
#
# Reads: probe-*.csv: time, area, wall_pressure; series.csv: friction_angle (rad); BODIES.DAT; DRV_DOF.DAT: pressure
# Writes: triaxial.csv: friction, friction_angle, error, of_mean_stress (degrees), solid_fraction_at_first, solid_fraction, its error,
#   deviation (of the pressure, 1), spin2; the same on stdout; packings.csv: a row a case: friction, seed,
#   friction_angle, of_mean_stress, solid_fraction_at_first, solid_fraction, spin2, pressure_at_rest: horizontal over
#   vertical stress of a bed at rest, 1 - sin(phi) (Jaky 1944); stress_strain.svg: (s_1 - s_3) / (s_1 + s_3) against strain

BEGIN {
    FS = ","; FROM = 0.1; TO = 0.22; DEGREE = atan2(0, -1) / 180
    print "friction,friction_angle,error,of_mean_stress,solid_fraction_at_first,solid_fraction,solid_fraction_error,deviation,spin2" > csv
    print "friction,seed,friction_angle,of_mean_stress,solid_fraction_at_first,solid_fraction,spin2,pressure_at_rest" > packings
    print " friction  angle [deg]     +-  of the mean stress  solid fraction, first, then     +-  pressure off by  (spin/critical)^2"
    for (i = 1; i < ARGC; i++) read_case(ARGV[i])
    for (i = 1; i <= frictions; i++) summary(friction[i])
    if (svg) picture()
    exit
}

function set_columns(    k) { delete column; for (k = 1; k <= NF; k++) column[$k] = k }

function asin(x) { return atan2(x, sqrt(1 - x * x)) }

# Reads area and pressure of a plate by rows; returns the number of rows.
function probe(folder, name, area, pressure,    file, row) {
    file = folder "/POSTPRO/probe-" name ".csv"
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    set_columns()
    while ((getline < file) > 0) { time[++row] = $column["time"]; area[row] = $column["area"]; pressure[row] = $column["wall_pressure"] }
    close(file)
    return row
}

# Pressure that the plates hold, Pa.
function held_pressure(datbox,    file, words, value) {
    file = datbox "/DRV_DOF.DAT"
    while ((getline words < file) > 0) if (words ~ /^ press/) value = substr(words, 15, 14) + 0
    close(file)
    return value < 0 ? -value : value
}

function read_case(folder,    mu, file, row, rows, ax, ay, az, px, py, pz, z, first, strain, s1, s3, n, tenth, m, sum_x, sum_y, axial, lateral, dense, held, off, count, angle_sum, from_time, to_time, sine, seed) {
    read_bodies(folder "/DATBOX"); held = held_pressure(folder "/DATBOX")
    probe(folder, "x", ax, px); probe(folder, "y", ay, py); rows = probe(folder, "z", az, pz)
    mu = folder; sub(/.*mu/, "", mu); sub(/-s.*/, "", mu)
    if (!(mu in seeds)) friction[++frictions] = mu
    seeds[mu]++
    curves++
    for (row = 1; row <= rows; row++) {
        z[row] = sqrt(ax[row] * ay[row] / az[row])
        if (z[row] > z[1] * (1 - 1e-9)) { first = row; continue }
        strain = log(z[1] / z[row]); s3 = (px[row] + py[row]) / 2
        curve_x[curves, ++points[curves]] = strain; curve_y[curves, points[curves]] = (pz[row] - s3) / (pz[row] + s3); curve_mu[curves] = mu
        if (strain < FROM || strain > TO) continue
        if (!n++) from_time = time[row]
        to_time = time[row]
        tenth = int(10 * (strain - FROM) / (TO - FROM) * 0.999999)
        m[tenth]++; sum_x[tenth] += px[row]; sum_y[tenth] += py[row]
        axial += pz[row]; lateral += s3; dense += grain_volume / sqrt(ax[row] * ay[row] * az[row])
    }
    if (n < 20) { print folder ": fewer than twenty rows at strains of " FROM " to " TO > "/dev/stderr"; exit 1 }
    for (tenth in m) {
        off = sum_x[tenth] / m[tenth] / held - 1; deviation[mu] = larger(deviation[mu], off < 0 ? -off : off)
        off = sum_y[tenth] / m[tenth] / held - 1; deviation[mu] = larger(deviation[mu], off < 0 ? -off : off)
    }
    file = folder "/POSTPRO/series.csv"; getline < file; set_columns()
    while ((getline < file) > 0) if ($column["time"] >= from_time && $column["time"] <= to_time) { count++; angle_sum += $column["friction_angle"] / DEGREE }
    close(file)
    sine = (axial - lateral) / (axial + lateral)
    seed = folder; sub(/.*-s/, "", seed)
    printf "%s,%s,%.5g,%.5g,%.5g,%.5g,%.5g,%.5g\n", mu, seed, asin(sine) / DEGREE, angle_sum / count, grain_volume / sqrt(ax[first] * ay[first] * az[first]), dense / n, limit(sine), 1 - sine > packings
    add("angle", mu, asin(sine) / DEGREE); add("stress", mu, angle_sum / count); add("dense", mu, dense / n)
    add("first", mu, grain_volume / sqrt(ax[first] * ay[first] * az[first]))
}

function larger(a, b) { return a > b ? a : b }

function add(name, mu, value) { sum[name, mu] += value; squares[name, mu] += value * value }

function mean(name, mu) { return sum[name, mu] / seeds[mu] }

# Error of the mean over the seeds; 0 of one seed.
function error(name, mu,    n, spread) {
    n = seeds[mu]; if (n < 2) return 0
    spread = (squares[name, mu] - sum[name, mu] ^ 2 / n) / (n - 1)
    return sqrt(larger(spread, 0) / n)
}

# Square of the spin at which a ball of grains with that sine of the friction angle yields, over 4 pi G rho / 3.
function limit(sine,    q) { q = 2 * sine / (3 - sine); return 3 * q / (1 + 2 * q) }

function summary(mu,    spin2) {
    spin2 = limit(sin(mean("angle", mu) * DEGREE))
    printf "%s,%.5g,%.3g,%.5g,%.5g,%.5g,%.3g,%.2g,%.5g\n", mu, mean("angle", mu), error("angle", mu), mean("stress", mu), mean("first", mu), mean("dense", mu), error("dense", mu), deviation[mu], spin2 > csv
    printf "%9s %12.1f %6.1f %19.1f %21.3f %6.3f %6.3f %15.1f%% %18.3f\n", mu, mean("angle", mu), error("angle", mu), mean("stress", mu), mean("first", mu), mean("dense", mu), error("dense", mu), 100 * deviation[mu], spin2
}

# Curves of all cases, one colour for each friction.
function picture(    k, p, i, colours, left, top, width, height, most) {
    split("#1b6ca8 #d1495b #3a7d44 #8d6a9f #b8860b", colours, " ")
    left = 70; top = 30; width = 520; height = 320; most = 0.5
    printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"640\" height=\"420\" font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"640\" height=\"420\" fill=\"white\"/>\n" > svg
    printf "<text x=\"70\" y=\"20\">Stress ratio between the plates against axial strain, a curve a packing</text>\n" > svg
    for (k = 0; k <= 5; k++) {
        printf "<line x1=\"%g\" y1=\"%g\" x2=\"%g\" y2=\"%g\" stroke=\"#ddd\"/><text x=\"%g\" y=\"%g\" text-anchor=\"end\">%.1f</text>\n", left, top + height * (1 - k / 5), left + width, top + height * (1 - k / 5), left - 6, top + height * (1 - k / 5) + 4, most * k / 5 > svg
        printf "<text x=\"%g\" y=\"%g\" text-anchor=\"middle\">%.2f</text>\n", left + width * k / 5, top + height + 18, 0.25 * k / 5 > svg
    }
    printf "<text x=\"%g\" y=\"%g\" text-anchor=\"middle\">axial strain</text><text x=\"18\" y=\"%g\" transform=\"rotate(-90 18 %g)\" text-anchor=\"middle\">(\317\203\342\202\201 - \317\203\342\202\203)/(\317\203\342\202\201 + \317\203\342\202\203)</text>\n", left + width / 2, top + height + 40, top + height / 2, top + height / 2 > svg
    for (k = 1; k <= curves; k++) {
        for (i = 1; friction[i] != curve_mu[k]; i++);
        printf "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"1\" points=\"", colours[(i - 1) % 5 + 1] > svg
        for (p = 1; p <= points[k]; p++) if (curve_x[k, p] <= 0.25 && curve_y[k, p] >= 0) printf "%.1f,%.1f ", left + width * curve_x[k, p] / 0.25, top + height * (1 - curve_y[k, p] / most) > svg
        printf "\"/>\n" > svg
    }
    for (i = 1; i <= frictions; i++) printf "<text x=\"%g\" y=\"%g\" fill=\"%s\">\316\274 = %s</text>\n", left + width - 70, top + 16 + 18 * i, colours[(i - 1) % 5 + 1], friction[i] > svg
    print "</svg>" > svg
}
