# Draws friction and solid fraction against the inertial number, for the scripts of the examples:
#
#   awk -v svg=friction.svg -f ../datbox.awk -f ../inertial-number.awk -f friction.awk v0.01 v0.03 ...
#
# The script sets points and, for each, inertial, mu, mu_error, nu and nu_error (none: no bar), then calls draw with the title. With
# curves it draws published laws, too: curve_label and curve_dash of each, and curve_inertial, curve_mu and curve_nu of its points, of
# which there are 41. A curve without mu or nu is left out of that panel. Hollow points are other_inertial, other_mu and
# other_mu_error.
#
# Reads: nothing
# Writes: the figure (svg)

function px(i) { return 80 + 440 * (log(i) - low) / (high - low) }
function py(value) { return bottom - 170 * (value - least) / (most - least) }
function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function line(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }

# One quantity above the other, over the same axis.
function panel(values, errors, curve, other, floor_, roof, step, label, last,    k, m, y, power, tick, labels) {
    least = floor_; most = roof
    for (y = least; y < most + step / 2; y += step) { line(80, py(y), 520, py(y), "stroke=\"#e0e0e0\""); text(72, py(y) + 4, "end", sprintf("%.2f", y)) }
    for (power = 1e-6; power < 1e3; power *= 10) for (tick = 1; tick <= 5; tick += tick == 2 ? 3 : 1) {
        if (log(power * tick) < low || log(power * tick) > high || tick == 4) continue
        line(px(power * tick), bottom, px(power * tick), bottom + 5, "stroke=\"black\"")
        if (last) text(px(power * tick), bottom + 20, "middle", power * tick)
    }
    line(80, bottom - 170, 80, bottom, "stroke=\"black\""); line(80, bottom, 520, bottom, "stroke=\"black\"")
    for (k = 1; k <= curves; k++) {
        if (!((k, 0) in curve)) continue
        printf "<path fill=\"none\" stroke=\"#d55e00\" stroke-width=\"1.5\" stroke-dasharray=\"%s\" d=\"", curve_dash[k] > svg
        for (m = 0; m <= 40; m++) printf "%s%.1f %.1f", m ? "L" : "M", px(curve_inertial[k, m]), py(curve[k, m]) > svg
        print "\"/>" > svg
        y = last ? bottom - 48 + 16 * labels++ : bottom - 152 + 16 * labels++
        printf "<path d=\"M95 %.1fL125 %.1f\" stroke=\"#d55e00\" stroke-width=\"1.5\" stroke-dasharray=\"%s\"/>\n", y - 4, y - 4, curve_dash[k] > svg
        text(131, y, "start", curve_label[k])
    }
    for (k = 1; k <= points; k++) {
        if (errors[k]) line(px(inertial[k]), py(values[k] - errors[k]), px(inertial[k]), py(values[k] + errors[k]), "stroke=\"#0072b2\" stroke-width=\"1.5\"")
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"#0072b2\"/>\n", px(inertial[k]), py(values[k]) > svg
    }
    for (k in other) {
        if (other_mu_error[k]) line(px(other_inertial[k]), py(other[k] - other_mu_error[k]), px(other_inertial[k]), py(other[k] + other_mu_error[k]), "stroke=\"#0072b2\" stroke-width=\"1.5\"")
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"white\" stroke=\"#0072b2\" stroke-width=\"1.5\"/>\n", px(other_inertial[k]), py(other[k]) > svg
    }
    printf "<text x=\"25\" y=\"%.1f\" text-anchor=\"middle\" transform=\"rotate(-90 25 %.1f)\">%s</text>\n", bottom - 85, bottom - 85, label > svg
}

# Bounds of some values, curves and other values on multiples of a step.
function bounds(values, curve, other, step,    k) {
    lower = 1e9; upper = -1e9
    for (k = 1; k <= points; k++) { if (values[k] < lower) lower = values[k]; if (values[k] > upper) upper = values[k] }
    for (k in curve) { if (curve[k] < lower) lower = curve[k]; if (curve[k] > upper) upper = curve[k] }
    for (k in other) { if (other[k] < lower) lower = other[k]; if (other[k] > upper) upper = other[k] }
    lower = step * int(lower / step - 0.3); upper = step * (int(upper / step) + 1.3); upper = step * int(upper / step + 0.5)
}

function draw(title,    k) {
    low = 1e9; high = -1e9
    for (k = 1; k <= points; k++) { if (log(inertial[k]) < low) low = log(inertial[k]); if (log(inertial[k]) > high) high = log(inertial[k]) }
    low -= log(1.5); high += log(1.5)
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"500\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"500\" fill=\"white\"/>" > svg
    text(80, 25, "start", title)
    bottom = 220; bounds(mu, curve_mu, other_mu, 0.05); panel(mu, mu_error, curve_mu, other_mu, lower, upper, 0.05, "shear over normal stress")
    bottom = 430; bounds(nu, curve_nu, none, 0.02); panel(nu, nu_error, curve_nu, none, lower, upper, 0.02, "solid fraction", 1)
    text(300, 480, "middle", "inertial number, γ̇ d √(ρ/P)")
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
