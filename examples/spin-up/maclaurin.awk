# The figure of a frictionless aggregate against its spin, beside that of a fluid (Maclaurin):
#   awk -v svg=maclaurin.svg -f maclaurin.awk fluid/POSTPRO/series.csv
# w^2 / (pi G rho) = 2 sqrt(1 - e^2) / e^3 (3 - 2 e^2) asin(e) - 6 (1 - e^2) / e^2, e^2 = 1 - (c/a)^2; a is sqrt(a b) here,
# rho the mass over the volume of the ellipsoid of equal inertia. Columns go by their names; SI units.

BEGIN { FS = ","; G = 6.6743e-11; PI = atan2(0, -1); BIFURCATION = 0.374 }

function asin(x) { return atan2(x, sqrt(1 - x * x)) }
function spin2(q,    e2, e) {
    e2 = 1 - q * q
    if (e2 < 1e-6) return 0
    e = sqrt(e2)
    return 2 * sqrt(1 - e2) / (e2 * e) * (3 - 2 * e2) * asin(e) - 6 * (1 - e2) / e2
}
# The ratio c/a of the fluid between 0.58, where w^2 / (pi G rho) is 0.374, and 1.
function ratio(s,    low, high, k, middle) {
    low = 0.5; high = 1
    for (k = 0; k < 60; k++) { middle = (low + high) / 2; if (spin2(middle) > s) low = middle; else high = middle }
    return low
}

FNR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }

$column["largest_fraction"] > 0.99 && !over {
    a = sqrt($column["largest_a"] * $column["largest_b"]); c = $column["largest_c"]
    rho = $column["largest_mass"] / (4 / 3 * PI * a * a * c)
    s = $column["largest_spin"] ^ 2 / (PI * G * rho)
    if (s > BIFURCATION) { over = 1; next }
    n++; x[n] = s; y[n] = c / a
    away = y[n] / ratio(s) - 1
    if (s > 0.02 && (away > most || -away > most)) most = away < 0 ? -away : away
}

END {
    print "w^2/(pi G rho)   c/a   of a fluid"
    for (k = 1; k <= n; k += int(n / 12) + 1) printf "%14.3f %5.3f %12.3f\n", x[k], y[k], ratio(x[k])
    printf "Largest difference above 0.02: %.1f %%\n", 100 * most
    print "points,largest_difference\n" n "," most > "figures/maclaurin.csv"
    draw()
}

function px(s) { return 70 + 400 * s / 0.4 }
function py(q) { return 270 - 220 * (q - 0.5) / 0.55 }

function draw(    k) {
    printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"330\" font-family=\"sans-serif\" font-size=\"13\">\n" > svg
    print "<rect width=\"560\" height=\"330\" fill=\"white\"/>" > svg
    for (k = 5; k <= 10; k++)
        printf "<path d=\"M70 %.1f H470\" stroke=\"#e0e0e0\"/><text x=\"62\" y=\"%.1f\" text-anchor=\"end\">%.1f</text>\n", py(k / 10), py(k / 10) + 4, k / 10 > svg
    for (k = 0; k <= 4; k++) printf "<text x=\"%.1f\" y=\"288\" text-anchor=\"middle\">%.1f</text>\n", px(k / 10), k / 10 > svg
    printf "<path fill=\"none\" stroke=\"#999\" d=\"" > svg
    for (k = 0; k <= 60; k++) printf "%s%.1f %.1f", k ? "L" : "M", px(BIFURCATION * k / 60), py(ratio(BIFURCATION * k / 60)) > svg
    print "\"/>" > svg
    for (k = 1; k <= n; k++) printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3\" fill=\"#0072b2\"/>\n", px(x[k]), py(y[k]) > svg
    print "<path d=\"M70 40 V270 H470\" fill=\"none\" stroke=\"black\"/>" > svg
    print "<text x=\"270\" y=\"315\" text-anchor=\"middle\">ω² / πGρ</text>" > svg
    print "<text x=\"22\" y=\"155\" text-anchor=\"middle\" transform=\"rotate(-90 22 155)\">c / a</text>" > svg
    print "<text x=\"70\" y=\"25\">Dots: the frictionless aggregate. Line: Maclaurin's figures of a fluid.</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
