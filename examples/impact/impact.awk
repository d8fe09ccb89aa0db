# Craters, momentum enhancement and ejecta of impacts at strengths Y and speeds U, with scaling laws:
#
#   awk -v folder=figures -f impact.awk Y30-U10 Y100-U10 ...
#
# pi_V = density V / m, V the volume of the crater, m the mass of the projectile; pi_3 = Y / (density U^2), Y the strength that the scene
# states. The line of least squares through log pi_V against log pi_3 has the slope -3 mu/2; its error is that of the line. Craters that
# are less deep than the radius of the projectile are left out of it. The exponent a of the ejecta, N(>v) ~ v^-a, is that of the largest likelihood
# of the n ejecta faster than w = sqrt(Y/density), a = n / sum of ln(v/w), with the error a / sqrt(n); scaling laws have a = 3 mu.
#
# Reads: CASE/POSTPRO/impact/beta.csv: beta, ejecta, ejecta_mass; crater-size.csv: diameter, depth, volume; ejecta-speeds.csv: speed_over_impact,
#   mass_over_projectile; ejecta-grains.csv: speed
# Writes: impact.csv in the folder: strength (Pa), speed (m/s), pi_3, pi_V, diameter (m), depth (m), volume (m^3), beta, ejecta, mass of the ejecta over
#   that of the projectile; the same on stdout, with the fits; the figures crater.svg and ejecta.svg

BEGIN {
    FS = ","; PI = 3.14159265; DENSITY = 2700 * 0.56; MASS = 2700 * 4 / 3 * PI * 0.75 ^ 3; LEAST_DEPTH = 0.75
    MU_SAND = 0.41; K_SOIL = 0.132
    split("#0072b2 #d55e00 #009e73 #cc79a7 #e69f00 #56b4e9 #000000", colour, " ")
    for (i = 1; i < ARGC; i++) if (ARGV[i] ~ /^Y[0-9.]+-U[0-9.]+$/) { cases++; measure(ARGV[i], cases) }
    if (cases < 3) { print "expected the folders of three cases or more" > "/dev/stderr"; exit 1 }
    table = folder "/impact.csv"
    print "strength,speed,pi_3,pi_V,diameter,depth,volume,beta,ejecta,ejecta_mass_over_projectile" > table
    printf "%8s %7s %9s %7s %13s %10s %13s %7s %7s %10s\n", "Y [Pa]", "U [m/s]", "pi_3", "pi_V", "diameter [m]", "depth [m]", "volume [m^3]", "beta", "ejecta", "M/m"
    for (n = 1; n <= cases; n++) {
        printf "%g,%g,%.4g,%.4g,%.4g,%.4g,%.4g,%.5g,%d,%.4g\n", y[n], u[n], pi3[n], pi_v[n], diameter[n], depth[n], volume[n], beta[n], ejecta[n], mass[n] > table
        printf "%8g %7g %9.2e %7.3g %13.3g %10.3g %13.3g %7.3f %7d %10.3g\n", y[n], u[n], pi3[n], pi_v[n], diameter[n], depth[n], volume[n], beta[n], ejecta[n], mass[n]
    }
    close(table)
    for (n = 1; n <= cases; n++) if (depth[n] >= LEAST_DEPTH && pi_v[n] > 0) { points++; lx[points] = log(pi3[n]); ly[points] = log(pi_v[n]) }
    if (points >= 3) {
        line_of_least_squares()
        printf "crater: pi_V = %.3g pi_3^(%.2f +- %.2f) of %d craters: mu = %.2f +- %.2f\n", exp(intercept), slope, slope_error, points, -slope / 1.5, slope_error / 1.5
    }
    for (n = 1; n <= cases; n++) if (fast[n] >= 8) printf "ejecta of %s: a = %.2f +- %.2f of %d, mu = %.2f\n", name[n], exponent[n], exponent[n] / sqrt(fast[n]), fast[n], exponent[n] / 3
    draw_craters(); draw_ejecta()
    exit
}

function fields(    n) { delete column; for (n = 1; n <= NF; n++) column[$n] = n }

function open(file) {
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    fields()
}

function measure(case_name, n,    file, part, logs) {
    name[n] = case_name; part = case_name; sub(/-U.*/, "", part); y[n] = substr(part, 2) + 0
    part = case_name; sub(/.*-U/, "", part); u[n] = part + 0
    pi3[n] = y[n] / (DENSITY * u[n] ^ 2)
    file = case_name "/POSTPRO/impact/beta.csv"; open(file)
    while ((getline < file) > 0) { beta[n] = $column["beta"]; ejecta[n] = $column["ejecta"]; mass[n] = $column["ejecta_mass"] / MASS }
    close(file)
    file = case_name "/POSTPRO/impact/crater-size.csv"; open(file)
    while ((getline < file) > 0) { diameter[n] = $column["diameter"]; depth[n] = $column["depth"]; volume[n] = $column["volume"] }
    close(file)
    pi_v[n] = DENSITY * volume[n] / MASS
    file = case_name "/POSTPRO/impact/ejecta-speeds.csv"; open(file)
    while ((getline < file) > 0) {
        count[n]++
        v[n, count[n]] = $column["speed_over_impact"]; m[n, count[n]] = $column["mass_over_projectile"]
    }
    close(file)
    file = case_name "/POSTPRO/impact/ejecta-grains.csv"; open(file)
    while ((getline < file) > 0) if ($column["speed"] > sqrt(y[n] / DENSITY)) { fast[n]++; logs += log($column["speed"] / sqrt(y[n] / DENSITY)) }
    close(file)
    if (fast[n] > 0) exponent[n] = fast[n] / logs
}

function line_of_least_squares(    n, sx, sy, sxx, sxy, syy, rest) {
    for (n = 1; n <= points; n++) { sx += lx[n] / points; sy += ly[n] / points }
    for (n = 1; n <= points; n++) { sxx += (lx[n] - sx) ^ 2; sxy += (lx[n] - sx) * (ly[n] - sy); syy += (ly[n] - sy) ^ 2 }
    slope = sxy / sxx; intercept = sy - slope * sx
    rest = syy - slope * sxy; if (rest < 0) rest = 0
    slope_error = points > 2 ? sqrt(rest / (points - 2) / sxx) : 0
}

function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function stroke(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }
function dot(x, y, fill) { printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"%s\"/>\n", x, y, fill > svg }
function log10(x) { return log(x) / log(10) }
function px(x) { return 80 + 440 * (log10(x) - left) / (right - left) }
function py(x) { return 400 - 340 * (log10(x) - bottom) / (top - bottom) }

function power(k) { return k < -2 ? sprintf("1e%d", k) : sprintf("%g", 10 ^ k) }

# Axes in powers of ten from 10^left to 10^right and from 10^bottom to 10^top.
function begin_figure(file, title, x_label, y_label,    k) {
    svg = file
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"470\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"470\" fill=\"white\"/>" > svg
    text(300, 30, "middle", title)
    for (k = left; k <= right; k++) { stroke(px(10 ^ k), 60, px(10 ^ k), 400, "stroke=\"#e0e0e0\""); text(px(10 ^ k), 420, "middle", power(k)) }
    for (k = bottom; k <= top; k++) { stroke(80, py(10 ^ k), 520, py(10 ^ k), "stroke=\"#e0e0e0\""); text(72, py(10 ^ k) + 4, "end", power(k)) }
    stroke(80, 60, 80, 400, "stroke=\"black\""); stroke(80, 400, 520, 400, "stroke=\"black\"")
    text(300, 450, "middle", x_label)
    print "<text x=\"28\" y=\"230\" text-anchor=\"middle\" transform=\"rotate(-90 28 230)\">" y_label "</text>" > svg
}

function end_figure() { print "</svg>" > svg; close(svg); print "drawn in " svg }

function draw_craters(    n, a, b, low, high) {
    left = -4; right = -1; bottom = -1; top = 2
    begin_figure(folder "/crater.svg", "Volume of the crater against strength", "strength over inertia, π₃ = Y/(ρU²)", "cratering efficiency, π_V = ρV/m")
    low = 1.5e-4; high = 3e-2
    stroke(px(low), py(K_SOIL * low ^ (-1.5 * MU_SAND)), px(high), py(K_SOIL * high ^ (-1.5 * MU_SAND)), "stroke=\"#909090\" stroke-dasharray=\"6 4\"")
    if (points >= 3) stroke(px(low), py(exp(intercept) * low ^ slope), px(high), py(exp(intercept) * high ^ slope), "stroke=\"black\"")
    for (n = 1; n <= cases; n++) {
        if (pi_v[n] <= 0) continue
        dot(px(pi3[n]), py(pi_v[n]), u[n] == 10 ? colour[1] : colour[2])
    }
    dot(340, 80, colour[1]); text(352, 84, "start", "U = 10 m/s"); dot(340, 100, colour[2]); text(352, 104, "start", "20 and 40 m/s")
    stroke(330, 120, 348, 120, "stroke=\"black\""); text(352, 124, "start", sprintf("line: exponent −%.2f", -slope))
    stroke(330, 140, 348, 140, "stroke=\"#909090\" stroke-dasharray=\"6 4\""); text(352, 144, "start", "dry soil, exponent −0.62")
    end_figure()
}

function draw_ejecta(    n, k, shown, a) {
    left = -3; right = 0; bottom = -2; top = 2
    begin_figure(folder "/ejecta.svg", "Ejecta that are faster than v", "v/U", "mass over that of the projectile")
    for (n = 1; n <= cases; n++) {
        if (ejecta[n] < 10) continue
        shown++
        for (k = 1; k <= count[n]; k++) dot(px(v[n, k]), py(m[n, k]), colour[(shown - 1) % 7 + 1])
        dot(100, 265 + 20 * shown, colour[(shown - 1) % 7 + 1]); text(112, 269 + 20 * shown, "start", y[n] " Pa, " u[n] " m/s")
    }
    a = 3 * 0.01 ^ (3 * MU_SAND)
    stroke(px(4e-3), py(a * 4e-3 ^ (-3 * MU_SAND)), px(0.2), py(a * 0.2 ^ (-3 * MU_SAND)), "stroke=\"#909090\" stroke-dasharray=\"6 4\"")
    stroke(90, 285 + 20 * shown, 108, 285 + 20 * shown, "stroke=\"#909090\" stroke-dasharray=\"6 4\""); text(112, 289 + 20 * shown, "start", "slope −3μ, μ = 0.41")
    end_figure()
}
