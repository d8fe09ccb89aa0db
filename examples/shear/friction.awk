# Friction and solid fraction of a sheared bed against its inertial number:
#
#   awk -v svg=friction.svg -f ../datbox.awk -f friction.awk v0.01 v0.03 ...
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
    for (i = 1; i < ARGC; i++) { name[++cases] = ARGV[i]; shear(ARGV[i], cases) }
    if (!cases) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    table = svg; sub(/svg$/, "csv", table)
    header = "speed,inertial_number,friction,friction_error,solid_fraction,normal_stress,height"
    print header > table
    printf "%12s %17s %10s %8s %16s %20s %11s\n", "speed [m/s]", "inertial number", "friction", "+-", "solid fraction", "normal stress [Pa]", "height [m]"
    for (k = 1; k <= cases; k++) {
        printf "%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", v[k], inertial[k], mu[k], error[k], nu[k], normal[k], height[k] > table
        printf "%12.4g %17.4g %10.3f %8.3f %16.3f %20.2f %11.3f\n", v[k], inertial[k], mu[k], error[k], nu[k], normal[k], height[k]
    }
    close(table)
    draw()
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
    error[k] = sqrt((sum2 - sum * sum > 0 ? sum2 - sum * sum : 0) / 9)
    nu[k] = grain_volume / area / height[k]
}

function px(i) { return 80 + 440 * (log(i) - low) / (high - low) }
function py(value) { return bottom - 170 * (value - least) / (most - least) }
function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function line(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }

# One quantity above the other, over the same axis.
function panel(values, errors, floor_, roof, step, label, last,    k, y, power, tick) {
    least = floor_; most = roof
    for (y = least; y < most + step / 2; y += step) { line(80, py(y), 520, py(y), "stroke=\"#e0e0e0\""); text(72, py(y) + 4, "end", sprintf("%.2f", y)) }
    for (power = 1e-6; power < 1e3; power *= 10) for (tick = 1; tick <= 5; tick += tick == 2 ? 3 : 1) {
        if (log(power * tick) < low || log(power * tick) > high || tick == 4) continue
        line(px(power * tick), bottom, px(power * tick), bottom + 5, "stroke=\"black\"")
        if (last) text(px(power * tick), bottom + 20, "middle", power * tick)
    }
    line(80, bottom - 170, 80, bottom, "stroke=\"black\""); line(80, bottom, 520, bottom, "stroke=\"black\"")
    for (k = 1; k <= cases; k++) {
        if (errors[k]) line(px(inertial[k]), py(values[k] - errors[k]), px(inertial[k]), py(values[k] + errors[k]), "stroke=\"#0072b2\" stroke-width=\"1.5\"")
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"#0072b2\"/>\n", px(inertial[k]), py(values[k]) > svg
    }
    printf "<text x=\"25\" y=\"%.1f\" text-anchor=\"middle\" transform=\"rotate(-90 25 %.1f)\">%s</text>\n", bottom - 85, bottom - 85, label > svg
}

# Bounds of some values on multiples of a step.
function bounds(values, step,    k) {
    lower = 1e9; upper = -1e9
    for (k = 1; k <= cases; k++) { if (values[k] < lower) lower = values[k]; if (values[k] > upper) upper = values[k] }
    lower = step * int(lower / step - 0.3); upper = step * (int(upper / step) + 1.3); upper = step * int(upper / step + 0.5)
}

function draw(    k) {
    low = 1e9; high = -1e9
    for (k = 1; k <= cases; k++) { if (log(inertial[k]) < low) low = log(inertial[k]); if (log(inertial[k]) > high) high = log(inertial[k]) }
    low -= log(1.5); high += log(1.5)
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"500\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"500\" fill=\"white\"/>" > svg
    text(80, 25, "start", "A sheared bed against its inertial number")
    bottom = 220; bounds(mu, 0.05); panel(mu, error, lower, upper, 0.05, "shear over normal stress")
    bottom = 430; bounds(nu, 0.02); panel(nu, none, lower, upper, 0.02, "solid fraction", 1)
    text(300, 480, "middle", "inertial number, γ̇ d √(ρ/P)")
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
