# The spins at which aggregates that are spun up slowly yield and fail, against the limits of Drucker and Prager:
#   awk -v svg=limit.svg -f limit.awk slow-f0-s1/POSTPRO/series.csv slow-f100-s1/POSTPRO/series.csv ...
# Each seed is an aggregate of its own, with a run without cohesion.
#
# One yields when its largest remnant is longer by a twentieth than at the start, while it is still close to a ball, and fails
# when that is longer by a fifth; or when it has lost a hundredth of the mass. The spin is the largest that it had before.
#
# The friction angle is that of the mean stress of the aggregate of this seed without cohesion, `friction_angle`, mean from where it yields to
# where it fails. The cohesion k of the whole comes from it and from the force f between two grains: the tensile strength of
# grains of Z neighbours that touch or pull and solid fraction nu is nu Z f / (pi d^2) (Rumpf 1970), and Drucker and Prager's cone, sqrt(J2) = s tr + k,
# has its apex there, k = 3 s times that. The next column is the cohesion that the mean stress requires, sqrt(J2) - s tr, mean while the
# spin is within a hundredth of the largest before it fails.
# With svg=FOLDER/limit.svg the table is written to FOLDER/limit.csv too. Columns are found by their names; SI units.
#
# Reads: series.csv: n_grains, R_enclosing, Z_all, nu_sphere, n_pulling, pressure, friction_angle, region_volume, largest_a, largest_b, largest_c,
#   largest_fraction, largest_mass, largest_spin
# Writes: the table, with names of columns, in limit.csv and on stdout: start2, yield2, failure2 are squares of spins over w_c^2; the figure of periods against cohesion (svg)

BEGIN {
    FS = ","; G = 6.6743e-11; PI = atan2(0, -1); YIELDS = 1.05; FAILS = 1.2
    for (k = 1; k < ARGC; k++) files[++cases] = ARGV[k]
}

FNR == 1 {
    run++
    for (k = 1; k <= NF; k++) column[$k] = k
    name = FILENAME; sub(/^.*\/?f/, "", name); sub(/\/.*/, "", name)
    cohesion[run] = name + 0
    seed[run] = name; sub(/.*-s/, "", seed[run])
    if (cohesion[run] == 0) bare[seed[run]] = run
    if (cohesion[run] > most) { most = cohesion[run]; strongest = run }
    next
}

# The volume of the ellipsoid of equal inertia, over 4 pi / 3.
{ size = $column["largest_a"] * $column["largest_b"] * $column["largest_c"] }

FNR == 2 {
    long[run] = $column["largest_a"]; radius[run] = size ^ (1 / 3)
    density[run] = $column["largest_mass"] / (4 / 3 * PI * size)
    # Mean radius by volume; the solid volume is nu_sphere times that of the enclosing ball.
    mean[run] = ($column["nu_sphere"] * $column["R_enclosing"] ^ 3 / $column["n_grains"]) ^ (1 / 3)
}

function beyond(longer) { return $column["largest_fraction"] < 0.99 || $column["largest_a"] > longer * long[run] }

!yielded[run] && beyond(YIELDS) { yielded[run] = 1 }
!failed[run] && beyond(FAILS) { failed[run] = 1 }
!yielded[run] {
    if ($column["largest_spin"] > yield[run]) yield[run] = $column["largest_spin"]
    strength[run] = $column["nu_sphere"] * $column["R_enclosing"] ^ 3 / size * ($column["Z_all"] + 2 * $column["n_pulling"] / $column["n_grains"]) * cohesion[run] / (4 * PI * mean[run] ^ 2)
}
!failed[run] && $column["largest_spin"] > failure[run] {
    failure[run] = $column["largest_spin"]
    axis_a[run] = sqrt($column["largest_a"] * $column["largest_b"]); axis_c[run] = $column["largest_c"]
    density_then[run] = $column["largest_mass"] / (4 / 3 * PI * size)
}
yielded[run] && !failed[run] { between[run]++; angle[run] += $column["friction_angle"] }
# Stresses are over the region, the hull of the largest fragment; here over the ellipsoid.
!failed[run] {
    row = ++states[run]; share = $column["region_volume"] / (4 / 3 * PI * size)
    spin[run, row] = $column["largest_spin"]; root[run, row] = $column["sqrt_J2"] * share; trace[run, row] = 3 * $column["pressure"] * share
}

# w^2 of a ball of that run with a cohesion k: w^2 (1/sqrt(3) + 2 s) = 4 pi G rho s + 5 k / (rho R^2).
function ball(run, k,    s) { s = slope(run); return (4 * PI * G * density[run] * s + 5 * k / (density[run] * radius[run] ^ 2)) / (1 / sqrt(3) + 2 * s) }
# The same of an oblate body (Holsapple 2004, with cohesion 2007), with the shape and density of that run as it fails:
# w^2 = 2 pi G rho A_x - (2 pi G rho A_z (c/a)^2 (1/sqrt(3) - s) - 5 k / (rho a^2)) / (1/sqrt(3) + 2 s).
function oblate(run, k,    s, r, e2, e, az, g) {
    s = slope(run); r = axis_c[run] / axis_a[run]; e2 = 1 - r * r; e = sqrt(e2); az = 2 / e2 * (1 - r / e * atan2(e, r))
    g = 2 * PI * G * density_then[run]
    return g * (1 - az / 2) - (g * az * r * r * (1 / sqrt(3) - s) - 5 * k / (density_then[run] * axis_a[run] ^ 2)) / (1 / sqrt(3) + 2 * s)
}
function rumpf(run) { return 3 * slope(run) * strength[run] }
function measured(run,    s, row, n, sum) {
    s = slope(run)
    for (row = 1; row <= states[run]; row++) if (spin[run, row] > 0.99 * failure[run]) { n++; sum += root[run, row] - s * trace[run, row] }
    return sum / n
}
function hours(w) { return 2 * PI / w / 3600 }

# Friction angle of the seed of a run, slope of its cone, and the square of w_c.
function phi(run) { return angle[bare[seed[run]]] / between[bare[seed[run]]] }
function slope(run) { return 2 * sin(phi(run)) / (3 - sin(phi(run))) / sqrt(3) }
function critical2(run) { return 4 * PI * G * density[run] / 3 }

END {
    for (run = 1; run <= cases; run++)
        if (!between[bare[seed[run]]]) { print "seed " seed[run] ": expected a run without cohesion that yields" > "/dev/stderr"; exit 1 }
    print "                             k [Pa]         yields: (w/w_c)^2, ball of k        fails: (w/w_c)^2"
    print "   f_c [N] seed    phi  Rumpf  stress     run   Rumpf  over  stress  over   c/a    run  oblate  over  period [h]"
    for (run = 1; run <= cases; run++) {
        w2 = critical2(run)
        printf "%10g %4s %6.1f %6.3f %7.3f %7.3f %7.3f %5.2f %7.3f %5.2f %5.2f %6.3f %7.3f %5.2f %11.2f%s\n", cohesion[run], seed[run], phi(run) * 180 / PI, rumpf(run), \
            measured(run), yield[run] ^ 2 / w2, ball(run, rumpf(run)) / w2, yield[run] ^ 2 / ball(run, rumpf(run)), ball(run, measured(run)) / w2, \
            yield[run] ^ 2 / ball(run, measured(run)), axis_c[run] / axis_a[run], failure[run] ^ 2 / w2, \
            oblate(run, rumpf(run)) / w2, failure[run] ^ 2 / oblate(run, rumpf(run)), hours(failure[run]), failed[run] ? "" : "  (held to the end)"
    }
    if (svg != "") { write_table(); draw() }
}

function write_table(    table, run, w2) {
    table = svg; sub(/svg$/, "csv", table)
    print "cohesion,seed,friction_angle,strength,k,k_measured,start2,yield_spin,yield2,ball2,yield_over_ball,yield_over_measured,axis_ratio,failure_spin,failure_period,failure2,oblate2,failure_over_oblate,failed" > table
    for (run = 1; run <= cases; run++) {
        w2 = critical2(run)
        printf "%g,%s,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d\n", cohesion[run], seed[run], phi(run) * 180 / PI, strength[run], \
            rumpf(run), measured(run), spin[run, 1] ^ 2 / w2, yield[run], yield[run] ^ 2 / w2, ball(run, rumpf(run)) / w2, yield[run] ^ 2 / ball(run, rumpf(run)), \
            yield[run] ^ 2 / ball(run, measured(run)), axis_c[run] / axis_a[run], failure[run], hours(failure[run]), failure[run] ^ 2 / w2, oblate(run, rumpf(run)) / w2, failure[run] ^ 2 / oblate(run, rumpf(run)), failed[run] > table
    }
    close(table)
}

function px(force) { return 70 + 470 * force / most }
function py(period) { return 310 - 270 * period / top }

# The largest of 1, 2 and 5 times a power of ten that is not above the number, > 0.
function round_part(number,    power) {
    power = 1
    while (power > number) power /= 10
    while (10 * power <= number) power *= 10
    return (number >= 5 * power ? 5 : number >= 2 * power ? 2 : 1) * power
}

function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function line(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }
function dot(x, y) { printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"#0072b2\"/>\n", x, y > svg }
function ring(x, y) { printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"7\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"1.5\"/>\n", x, y > svg }
function square(x, y) { printf "<rect x=\"%.1f\" y=\"%.1f\" width=\"7\" height=\"7\" fill=\"#d55e00\"/>\n", x - 3.5, y - 3.5 > svg }

# Dots of all seeds; the lines are those of the seed of the first run.
function draw(    k, run, tick, grey, dashed) {
    grey = "stroke=\"#666\" stroke-width=\"1.5\" fill=\"none\""; dashed = grey " stroke-dasharray=\"6 4\""
    per_force = most ? rumpf(strongest) / most : 0
    most = most ? 1.05 * most : 1
    top = 0
    for (run = 1; run <= cases; run++) { if (hours(yield[run]) > top) top = hours(yield[run]); if (hours(sqrt(oblate(run, rumpf(run)))) > top) top = hours(sqrt(oblate(run, rumpf(run)))) }
    top = int(1.15 * top + 1)
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"580\" height=\"370\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"580\" height=\"370\" fill=\"white\"/>" > svg
    for (k = 0; k <= top; k++) { line(70, py(k), 540, py(k), "stroke=\"#e0e0e0\""); text(62, py(k) + 4, "end", k) }
    tick = round_part(most / 3)
    for (k = 0; k * tick <= most; k++) { line(px(k * tick), 310, px(k * tick), 315, "stroke=\"black\""); text(px(k * tick), 330, "middle", k * tick) }
    line(70, py(hours(sqrt(critical2(1)))), 540, py(hours(sqrt(critical2(1)))), dashed)
    # The tensile strength goes with the force, as in the run with most cohesion.
    printf "<path %s d=\"", grey > svg
    for (k = 0; k <= 100; k++)
        printf "%s%.1f %.1f", k ? "L" : "M", px(most * k / 100), py(hours(sqrt(ball(1, per_force * most * k / 100)))) > svg
    print "\"/>" > svg
    for (run = 1; run <= cases; run++) {
        square(px(cohesion[run]), py(hours(sqrt(oblate(run, rumpf(run))))))
        dot(px(cohesion[run]), py(hours(yield[run]))); ring(px(cohesion[run]), py(hours(failure[run])))
    }
    print "<path d=\"M70 40 V310 H540\" fill=\"none\" stroke=\"black\"/>" > svg
    text(305, 355, "middle", "cohesion between two grains (N)")
    print "<text x=\"30\" y=\"175\" text-anchor=\"middle\" transform=\"rotate(-90 30 175)\">period of rotation (h)</text>" > svg
    text(70, 25, "start", "Period at yield and at failure against cohesion")
    dot(296, 52); text(315, 56, "start", "runs, at yield")
    ring(296, 70); text(315, 74, "start", "runs, at failure")
    line(285, 88, 308, 88, dashed); text(315, 92, "start", "sphere, √(4πGρ/3)")
    line(285, 106, 308, 106, grey); text(315, 110, "start", sprintf("sphere, Drucker–Prager, φ = %.1f°", phi(1) * 180 / PI))
    square(296, 124); text(315, 128, "start", "the same, oblate as at failure")
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
