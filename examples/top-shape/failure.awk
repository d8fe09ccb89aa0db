# Period at failure of spun-up bodies against the tensile strength that the scene states:
#
#   awk -v svg=failure.svg -f failure.awk T0-s1 T0-s2 ... T30-s3
#
# A body fails when its longest semi-axis is a tenth longer than at the start, or its largest remnant has lost a hundredth of the mass; the spin at
# failure is the largest before. The limit is that of the mean stress of a sphere with the criterion of Drucker and Prager (Holsapple 2007),
#   w^2 (1/sqrt(3) + 2 s) = 4 pi G rho s + 5 k/(rho R^2),  s = 2 sin(phi)/(sqrt(3) (3 - sin(phi))),  k = 3 s T,
# with the tensile strength T, the bulk density rho and the radius R = (a b c)^(1/3) of each body at the start, and phi = PHI degrees.
#
# Reads: CASE/POSTPRO/series.csv: time, a, b, c, spin_x, spin_y, spin_z, largest_fraction, mass
# Writes: failure.csv next to the figure: strength (Pa), seed, spin (rad/s), period, limit_period (h), density (kg/m^3), radius (m); means over the
#   seeds on stdout; the figure (svg)

BEGIN {
    FS = ","; PI = atan2(0, -1); G = 6.6743e-11; if (!PHI) PHI = 33; SHARE = 0.55
    table = svg; sub(/svg$/, "csv", table)
    print "strength,seed,spin,period,limit_period,density,radius" > table
    for (i = 1; i < ARGC; i++) if (ARGV[i] ~ /T[0-9.]+-s[0-9]+$/) follow(ARGV[i])
    if (!groups) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    close(table)
    printf "%14s %20s %16s %22s\n", "strength [Pa]", "period [h]", "limit [h]", "limit, measured T [h]"
    for (g = 1; g <= groups; g++) {
        mean[g] = sum[g] / runs[g]; error[g] = runs[g] > 1 ? sqrt(max(sum2[g] / runs[g] - mean[g] ^ 2, 0) / (runs[g] - 1)) : 0
        printf "%14s %12.2f +- %4.2f %16.2f %22.2f\n", group[g], mean[g], error[g], limits[g] / runs[g], measured[g] / runs[g]
    }
    draw()
    exit
}

function max(a, b) { return a > b ? a : b }
function hours(spin) { return 2 * PI / spin / 3600 }

# Spin of the limit at the tensile strength.
function limit(strength, density, radius,    s) {
    s = 2 * sin(PHI * PI / 180) / (sqrt(3) * (3 - sin(PHI * PI / 180)))
    return sqrt((4 * PI * G * density * s + 15 * s * strength / (density * radius ^ 2)) / (1 / sqrt(3) + 2 * s))
}

function follow(folder,    name, part, file, k, column, a0, spin, largest, density, radius, failed, g) {
    name = folder; sub(/.*\//, "", name); split(substr(name, 2), part, "-s")
    file = folder "/POSTPRO/series.csv"
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    for (k = 1; k <= NF; k++) column[$k] = k
    largest = 0; failed = 0; a0 = 0
    while (!failed && (getline < file) > 0) {
        if (!a0) {
            a0 = $column["a"]; radius = ($column["a"] * $column["b"] * $column["c"]) ^ (1 / 3)
            density = $column["mass"] / (4 / 3 * PI * radius ^ 3)
        }
        spin = sqrt($column["spin_x"] ^ 2 + $column["spin_y"] ^ 2 + $column["spin_z"] ^ 2)
        failed = $column["a"] > 1.1 * a0 || $column["largest_fraction"] < 0.99
        if (!failed && spin > largest) largest = spin
    }
    close(file)
    if (!failed) { print folder ": does not fail" > "/dev/stderr"; return }
    printf "%s,%s,%.5g,%.4g,%.4g,%.5g,%.5g\n", part[1], part[2], largest, hours(largest), hours(limit(part[1], density, radius)), density, radius > table
    for (g = 1; g <= groups; g++) if (group[g] == part[1]) break
    if (g > groups) { groups = g; group[g] = part[1] }
    runs[g]++; sum[g] += hours(largest); sum2[g] += hours(largest) ^ 2; limits[g] += hours(limit(part[1], density, radius))
    measured[g] += hours(limit(SHARE * part[1], density, radius)); all_density += density; all_radius += radius; bodies++
}

function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function stroke(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }
function px(value) { return 80 + 440 * value / wide }
function py(period) { return 400 - 340 * period / 4 }

function curve(share, style,    k, t) {
    printf "<path d=\"" > svg
    for (k = 0; k <= 100; k++) { t = wide * k / 100; printf "%s%.1f %.1f", k ? "L" : "M", px(t), py(hours(limit(share * t, all_density / bodies, all_radius / bodies))) > svg }
    print "\" fill=\"none\" " style "/>" > svg
}

function draw(    g, tick, colour) {
    wide = 10; for (g = 1; g <= groups; g++) while (wide < 1.1 * group[g]) wide += 10
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"470\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"470\" fill=\"white\"/>" > svg
    text(300, 30, "middle", "Period at failure of a rubble pile")
    for (tick = 0; tick <= 4; tick++) { stroke(80, py(tick), 520, py(tick), "stroke=\"#e0e0e0\""); text(72, py(tick) + 4, "end", tick) }
    for (tick = 0; tick <= wide; tick += 10) { stroke(px(tick), 400, px(tick), 405, "stroke=\"black\""); text(px(tick), 420, "middle", tick) }
    stroke(80, 60, 80, 400, "stroke=\"black\""); stroke(80, 400, 520, 400, "stroke=\"black\"")
    curve(1, "stroke=\"#808080\" stroke-dasharray=\"5 4\""); curve(SHARE, "stroke=\"#d55e00\"")
    for (g = 1; g <= groups; g++) {
        stroke(px(group[g]), py(mean[g] - error[g]), px(group[g]), py(mean[g] + error[g]), "stroke=\"#0072b2\" stroke-width=\"1.5\"")
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"#0072b2\"/>\n", px(group[g]), py(mean[g]) > svg
    }
    printf "<circle cx=\"300\" cy=\"75\" r=\"4\" fill=\"#0072b2\"/>\n" > svg; text(316, 79, "start", "measured")
    stroke(292, 95, 308, 95, "stroke=\"#808080\" stroke-dasharray=\"5 4\""); text(316, 99, "start", "limit, strength as stated")
    stroke(292, 115, 308, 115, "stroke=\"#d55e00\""); text(316, 119, "start", "limit, 0.55 of this strength")
    text(300, 450, "middle", "tensile strength that the scene states, Pa")
    print "<text x=\"30\" y=\"230\" text-anchor=\"middle\" transform=\"rotate(-90 30 230)\">period, h</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
