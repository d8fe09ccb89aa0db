# The figure of a frictionless aggregate against its spin, and that of a fluid (Maclaurin):
#   awk -v svg=maclaurin.svg -f maclaurin.awk window=0 fluid-s1/POSTPRO/series.csv window=24000 shaken-s1/POSTPRO/series.csv ...
# A point is a state, or the mean over a window of time, s: shaken runs fluctuate.
# w^2 / (pi G rho) = 2 sqrt(1 - e^2) / e^3 (3 - 2 e^2) asin(e) - 6 (1 - e^2) / e^2, e^2 = 1 - (c/a)^2; a is sqrt(a b) here,
# rho the mass over the volume of the ellipsoid of equal inertia.
#
# Also drawn: the limit of Drucker and Prager for the mean stress of an oblate body with a friction angle phi (Holsapple 2004),
#   w^2 / (pi G rho) = 2 A_x - 2 A_z (c/a)^2 (1 - q) / (1 + 2 q), q = 2 sin(phi) / (3 - sin(phi)),
# A the coefficients of the potential within an ellipsoid; phi = 0 is the fluid. Spheres without friction have a friction angle
# of 5.8 degrees, by their arrangement alone (Peyneau & Roux 2008). Columns are found by their names; SI units.
#
# Reads: series.csv: time, friction_angle, largest_a, largest_b, largest_c, largest_fraction, largest_mass, largest_spin
# Writes: a table on stdout and in a CSV file with the name of the figure; the figure c/a against spin (svg)

BEGIN { FS = ","; G = 6.6743e-11; PI = atan2(0, -1); BIFURCATION = 0.374; PHI = 5.8 * PI / 180 }

function asin(x) { return atan2(x, sqrt(1 - x * x)) }
# w^2 / (pi G rho) at the ratio r = c/a with the coefficient q; 0 is Maclaurin's.
function spin2(r, q,    e2, e, az) {
    e2 = 1 - r * r
    if (e2 < 1e-6) return 4 / 3 * (1 - (1 - q) / (1 + 2 * q))
    e = sqrt(e2)
    az = 2 / e2 * (1 - r / e * asin(e))
    return (2 - az) - 2 * az * r * r * (1 - q) / (1 + 2 * q)
}
# The ratio c/a between 0.5 and 1 at which a body of that q is at its limit; 1 where a sphere is below it.
function ratio(s, q,    low, high, k, middle) {
    low = 0.5; high = 1
    for (k = 0; k < 60; k++) { middle = (low + high) / 2; if (spin2(middle, q) > s) low = middle; else high = middle }
    return low
}
function of_phi(phi) { return 2 * sin(phi) / (3 - sin(phi)) }

FNR == 1 {
    close_window()
    for (k = 1; k <= NF; k++) column[$k] = k
    name[++runs] = FILENAME; sub(/\/.*/, "", name[runs]); over = 0
    next
}

# What flies just then is no part of the figure.
$column["largest_fraction"] > 0.95 && !over {
    a = sqrt($column["largest_a"] * $column["largest_b"]); c = $column["largest_c"]
    rho = $column["largest_mass"] / (4 / 3 * PI * a * a * c)
    s = $column["largest_spin"] ^ 2 / (PI * G * rho)
    now = window ? int($column["time"] / window - 1e-6) : FNR # the last state of a window is at its end
    if (now != then) close_window()
    then = now; states++; spins += s; ratios += c / a; angles += $column["friction_angle"] * 180 / PI
    if (s > 0.02 && s < BIFURCATION) single[runs] = larger(single[runs], c / a / ratio(s, 0) - 1)
}

# Takes the mean of the states since the last as a point.
function close_window(    s, r, n) {
    if (!states) return
    s = spins / states; r = ratios / states
    if (s > reached[runs]) reached[runs] = s # the first point beyond counts in this alone
    if (s > BIFURCATION) over = 1
    else {
        n = ++points[runs]; x[runs, n] = s; y[runs, n] = r
        most[runs] = larger(most[runs], s > 0.02 ? r / ratio(s, 0) - 1 : 0)
        if (s > fastest[runs]) fastest[runs] = s
        # Where a sphere would be beyond its limit.
        if (s > spin2(1, of_phi(PHI))) {
            yielding[runs]++; angle[runs] += angles / states
            beyond[runs] = larger(beyond[runs], r / ratio(s, of_phi(PHI)) - 1)
        }
    }
    states = spins = ratios = angles = 0
}

function larger(most, away) { if (away < 0) away = -away; return away > most ? away : most }

END {
    close_window()
    table = svg; sub(/svg$/, "csv", table)
    print "run,points,fastest,reached,largest_difference,of_single_states,from_limit,friction_angle" > table
    for (r = 1; r <= runs; r++) {
        if (!yielding[r]) { print name[r] ": ends below the limit of a sphere" > "/dev/stderr"; exit 1 }
        angle[r] /= yielding[r]
        print name[r] "\nw^2/(pi G rho)   c/a   of a fluid   at the limit"
        for (k = 1; k <= points[r]; k += int(points[r] / 12) + 1)
            printf "%14.3f %5.3f %12.3f %14.3f\n", x[r, k], y[r, k], ratio(x[r, k], 0), ratio(x[r, k], of_phi(PHI))
        printf "Largest difference from 0.02 to %.3f: %.1f %%; from the limit, once a sphere is beyond it: %.1f %%\n", fastest[r], 100 * most[r], 100 * beyond[r]
        printf "Of single states: %.1f %%\n", 100 * single[r]
        printf "Friction angle then, mean of %d: %.1f degrees\n", yielding[r], angle[r]
        print name[r] "," points[r] "," fastest[r] "," reached[r] "," most[r] "," single[r] "," beyond[r] "," angle[r] > table
    }
    draw()
}

function px(s) { return 70 + 400 * s / 0.4 }
function py(q) { return 270 - 220 * (q - 0.5) / 0.55 }

function curve(q, colour,    k, s) {
    printf "<path fill=\"none\" stroke=\"%s\" d=\"", colour > svg
    for (k = 0; k <= 60; k++) { s = BIFURCATION * k / 60; printf "%s%.1f %.1f", k ? "L" : "M", px(s), py(ratio(s, q)) > svg }
    print "\"/>" > svg
}

function draw(    k, r) {
    printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"330\" font-family=\"sans-serif\" font-size=\"13\">\n" > svg
    print "<rect width=\"560\" height=\"330\" fill=\"white\"/>" > svg
    for (k = 5; k <= 10; k++)
        printf "<path d=\"M70 %.1f H470\" stroke=\"#e0e0e0\"/><text x=\"62\" y=\"%.1f\" text-anchor=\"end\">%.1f</text>\n", py(k / 10), py(k / 10) + 4, k / 10 > svg
    for (k = 0; k <= 4; k++) printf "<text x=\"%.1f\" y=\"288\" text-anchor=\"middle\">%.1f</text>\n", px(k / 10), k / 10 > svg
    curve(0, "#999"); curve(of_phi(PHI), "#d55e00")
    for (r = 1; r <= runs; r++) for (k = 1; k <= points[r]; k++)
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3\" fill=\"%s\"/>\n", px(x[r, k]), py(y[r, k]), name[r] ~ /^fluid/ ? "#0072b2" : "#009e73" > svg
    print "<path d=\"M70 40 V270 H470\" fill=\"none\" stroke=\"black\"/>" > svg
    print "<text x=\"270\" y=\"315\" text-anchor=\"middle\">ω² / πGρ</text>" > svg
    print "<text x=\"22\" y=\"155\" text-anchor=\"middle\" transform=\"rotate(-90 22 155)\">c / a</text>" > svg
    print "<text x=\"70\" y=\"18\">Spheres without friction: blue; shaken: green.</text><text x=\"70\" y=\"34\">Grey: fluid. Red: limit at φ = 5.8°.</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
