# Mass rates of a silo against the side of its orifice, or its diameter, D, with Beverloo's law W = C rho sqrt(g) (D - k d)^(5/2):
#
#   awk -v svg=silo.svg -f ../datbox.awk -f silo.awk D0.10 D0.11 ...
#
# Of other vessels `vessel` is the name, `width` the word for D, and `start` the time from which on the flow is steady, s. `published`, two
# values of C, adds the rates that Beverloo's law has with them and k = 1.4.
#
# Means are from `start` on, when the flow is steady. Cases whose names differ in the seed at their end, -sN, are one outlet: its rate
# is their mean, and its error their standard deviation over the root of their number. The error of one seed is a standard deviation of
# means over tenths of the time, over the root of ten. C and k are those of the line of least squares through W^(2/5) of all cases. The
# exponent is the slope of the line through log W against log (D - k d), for two values of k, of which 1.4 is Beverloo's for round
# grains; its error is that of the line.
#
# Reads: CASE/POSTPRO/probe-outflow.csv: time, h, number, passed_mass; CASE/POSTPRO/probe-bed.csv: time, density, mu, inertial_number;
#   CASE/DATBOX: gravity, mean diameter d of the beads
# Writes: the table next to the figure, silo.csv: side or diameter (m), seeds, rate (kg/s), rate_error, number, density (kg/m^3), mu,
#   inertial_number; the same on stdout, with the fits and the published rates (kg/s); the figure (svg)

BEGIN {
    FS = ","
    if (start == "") start = 0.2
    if (vessel == "") vessel = "silo through a square orifice"
    if (width == "") width = "side"
    for (i = 1; i < ARGC; i++) if (ARGV[i] ~ /D[0-9.]+(-s[0-9]+)?$/) { cases++; measure(ARGV[i], cases) }
    if (cases < 3) { print "expected the folders of three cases or more" > "/dev/stderr"; exit 1 }
    group_seeds(); read_bodies(datbox); gravity = uniform_gravity(datbox)
    write_table()
    for (n = 1; n <= cases; n++) { x[n] = side[n]; y[n] = rate[n] ^ 0.4 }
    line_of_least_squares()
    slope_of_root = slope; k = -intercept / slope / mean_diameter; k_error = sqrt(error_of_mean ^ 2 + (slope_error * mean_x) ^ 2) / slope / mean_diameter
    c = slope ^ 2.5 / rho / sqrt(gravity); c_error = 2.5 * c * slope_error / slope
    printf "Beverloo: C = %.3f +- %.3f, k = %.2f +- %.2f (W^(2/5) is linear in D: r^2 = %.5f)\n", c, c_error, k, k_error, r2
    fit_exponent(1.0); first = slope; fit_exponent(1.4)
    draw()
    exit
}

function fields(    n) { delete column; for (n = 1; n <= NF; n++) column[$n] = n }

function open(file) {
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    fields()
}

# Means of the cases of each outlet.
function group_seeds(    n, k) {
    for (n = 1; n <= cases; n++) {
        for (k = 1; k <= outlets && outlet[k] != side[n]; k++);
        if (k > outlets) outlet[outlets = k] = side[n]
        seeds[k]++; rates[k] += rate[n]; squares[k] += rate[n] ^ 2; passed[k] += beads[n]
        densities[k] += density[n]; frictions[k] += mu[n]; numbers[k] += inertial[n]; rate_error[k] = error[n]
    }
    for (k = 1; k <= outlets; k++) {
        n = seeds[k]; rates[k] /= n; densities[k] /= n; frictions[k] /= n; numbers[k] /= n; rho += densities[k] / outlets
        if (n > 1) rate_error[k] = sqrt((squares[k] - n * rates[k] ^ 2) / (n - 1) / n)
    }
}

function write_table(    table, k) {
    table = svg; sub(/svg$/, "csv", table)
    print width ",seeds,rate,rate_error,number,density,mu,inertial_number" > table
    printf "%12s %6s %13s %8s %7s %17s %7s %16s%s\n", width " [m]", "seeds", "rate [kg/s]", "+-", "beads", "density [kg/m^3]", "mu", "inertial number", published == "" ? "" : "  published [kg/s]"
    for (k = 1; k <= outlets; k++) {
        printf "%.4g,%d,%.6g,%.3g,%d,%.6g,%.4g,%.4g\n", outlet[k], seeds[k], rates[k], rate_error[k], passed[k], densities[k], frictions[k], numbers[k] > table
        printf "%12.3g %6d %13.4g %8.2g %7d %17.1f %7.3f %16.3g%s\n", outlet[k], seeds[k], rates[k], rate_error[k], passed[k], densities[k], frictions[k], numbers[k], published_rates(outlet[k])
    }
    close(table)
}

# The rates of Beverloo's law with k = 1.4 and both of the published constants.
function published_rates(diameter,    constant, unit) {
    if (published == "") return ""
    split(published, constant, " "); unit = rho * sqrt(gravity) * (diameter - 1.4 * mean_diameter) ^ 2.5
    return sprintf("  %.3g to %.3g", constant[1] * unit, constant[2] * unit)
}

function measure(folder, n,    file, rows, mass, h, m, tenth, part, length_of, sum, sum2, one) {
    datbox = folder "/DATBOX"
    side[n] = folder; sub(/-s[0-9]+$/, "", side[n]); sub(/.*D/, "", side[n])
    file = folder "/POSTPRO/probe-outflow.csv"
    open(file)
    while ((getline < file) > 0) {
        if ($column["time"] <= start) continue
        rows++; mass[rows] = $column["passed_mass"]; h[rows] = $column["h"]; beads[n] += $column["number"]
    }
    close(file)
    if (rows < 20) { print file ": fewer than twenty rows after " start " s" > "/dev/stderr"; exit 1 }
    for (m = 1; m <= rows; m++) { tenth = int(10 * (m - 1) / rows); part[tenth] += mass[m]; length_of[tenth] += h[m] }
    for (m = 0; m < 10; m++) { one = part[m] / length_of[m]; sum += one / 10; sum2 += one ^ 2 / 10 }
    rate[n] = sum; error[n] = sqrt((sum2 - sum ^ 2) / 9)
    file = folder "/POSTPRO/probe-bed.csv"; rows = 0
    open(file)
    while ((getline < file) > 0) {
        if ($column["time"] <= start) continue
        rows++; density[n] += $column["density"]; mu[n] += $column["mu"]; inertial[n] += $column["inertial_number"]
    }
    close(file)
    density[n] /= rows; mu[n] /= rows; inertial[n] /= rows
}

# Line through y against x, with the standard errors of its slope and of the mean of y.
function line_of_least_squares(    n, sx, sy, sxx, sxy, syy, rest) {
    sx = sy = sxx = sxy = syy = 0
    for (n = 1; n <= cases; n++) { sx += x[n] / cases; sy += y[n] / cases }
    for (n = 1; n <= cases; n++) { sxx += (x[n] - sx) ^ 2; sxy += (x[n] - sx) * (y[n] - sy); syy += (y[n] - sy) ^ 2 }
    slope = sxy / sxx; intercept = sy - slope * sx; mean_x = sx
    rest = syy - slope * sxy; if (rest < 0) rest = 0
    r2 = 1 - rest / syy
    slope_error = sqrt(rest / (cases - 2) / sxx); error_of_mean = sqrt(rest / (cases - 2) / cases)
}

function fit_exponent(k,    n) {
    for (n = 1; n <= cases; n++) { x[n] = log(side[n] - k * mean_diameter); y[n] = log(rate[n]) }
    line_of_least_squares()
    printf "exponent with k = %.1f: %.2f +- %.2f, expected 2.5\n", k, slope, slope_error
}

function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function stroke(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }
function px(d) { return 80 + 440 * d / 10 }
function py(root) { return 400 - 340 * root / roof }

# W^(2/5) against D/d, with the line, which ends at k.
function draw(    n, tick, low, high) {
    roof = 1; while (roof < rates[outlets] ^ 0.4 * 1.1) roof++
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"470\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"470\" fill=\"white\"/>" > svg
    text(300, 25, "middle", "Discharge of a " vessel)
    text(90, 80, "start", "line: W = C ρ √g (D − k d)^(5/2)"); text(90, 98, "start", sprintf("C = %.2f, k = %.2f", c, k))
    text(90, 116, "start", sprintf("exponent %.2f with k = 1, %.2f with k = 1.4", first, slope))
    for (tick = 0; tick <= 10; tick += 2) { stroke(px(tick), 400, px(tick), 405, "stroke=\"black\""); text(px(tick), 420, "middle", tick) }
    for (tick = 0; tick <= roof; tick++) { stroke(80, py(tick), 520, py(tick), "stroke=\"#e0e0e0\""); text(72, py(tick) + 4, "end", tick) }
    stroke(80, 60, 80, 400, "stroke=\"black\""); stroke(80, 400, 520, 400, "stroke=\"black\"")
    stroke(px(k), py(0), px(9), py(slope_of_root * mean_diameter * (9 - k)), "stroke=\"#d55e00\" stroke-width=\"1.5\"")
    for (n = 1; n <= outlets; n++) {
        low = (rates[n] - rate_error[n]) ^ 0.4; high = (rates[n] + rate_error[n]) ^ 0.4
        stroke(px(outlet[n] / mean_diameter), py(low), px(outlet[n] / mean_diameter), py(high), "stroke=\"#0072b2\" stroke-width=\"1.5\"")
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"#0072b2\"/>\n", px(outlet[n] / mean_diameter), py(rates[n] ^ 0.4) > svg
    }
    text(300, 450, "middle", width " of the orifice over the mean diameter of the beads, D/d")
    print "<text x=\"30\" y=\"230\" text-anchor=\"middle\" transform=\"rotate(-90 30 230)\">W^(2/5), W in kg/s</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
