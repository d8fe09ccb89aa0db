# Spin after the passage, of the rubble pile and of a rigid body with the same grains:
#
#   awk -v svg=spin.svg -f rigid.awk phase0 phase30 ...
#
# The rigid body has the positions of the grains of DATBOX/BODIES.DAT and the spin of changes.ron. Its angular momentum L changes by the sum of
# r x m a over the grains, with the tide a of the Earth relative to the origin, which is on the hyperbola of changes.ron; its orientation by
# J^-1 L. Both are integrated by Runge's and Kutta's method of fourth order in steps of 100 s, from 30 000 s before to 30 000 s after the passage.
#
# Reads: CASE/DATBOX/BODIES.DAT; CASE/POSTPRO/series.csv: spin_x, spin_y, spin_z, a, c, largest_fraction
# Writes: spin.csv next to the figure: phase (degrees), spin_start, spin_end, rigid_end (rad/s), period, rigid_period (h), tilt, rigid_tilt (degrees
#   from z), a and c (m) at start and end; a table on stdout; the figure (svg)

BEGIN {
    FS = ","; PI = atan2(0, -1); MU = 6.6743e-11 * 5.972e24; DENSITY = 3000; SPIN = 6.37e-5
    PERIAPSIS = 3.8012e7; V_INF = 5.84e3; INCLINATION = 0.6; HALF = 30000; STEP = 100
    ECC = 1 + PERIAPSIS * V_INF ^ 2 / MU; AXIS = PERIAPSIS / (ECC - 1); MOTION = sqrt(MU / AXIS ^ 3)
    table = svg; sub(/svg$/, "csv", table)
    print "phase,spin_start,spin_end,rigid_end,period,rigid_period,tilt,rigid_tilt,a_start,a_end,c_start,c_end" > table
    printf "%6s %16s %16s %10s %12s %10s %8s\n", "phase", "period [h]", "rigid [h]", "tilt", "rigid tilt", "a, end [m]", "held"
    for (i = 1; i < ARGC; i++) if (ARGV[i] ~ /phase[0-9.]+$/) compare(ARGV[i])
    if (!count) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    close(table)
    printf "largest difference of the changes of spin %.1e of the change, of the tilt %.1e rad\n", worst_spin, worst_tilt
    draw()
    exit
}

function compare(folder,    phase, k) {
    phase = folder; sub(/.*phase/, "", phase)
    read_series(folder "/POSTPRO/series.csv")
    read_grains(folder "/DATBOX/BODIES.DAT")
    fly()
    count++; phases[count] = phase; ends[count] = spin_end; rigids[count] = norm(w[1], w[2], w[3])
    tilt = acos(end["spin_z"] / spin_end) * 180 / PI; rigid_tilt = acos(w[3] / rigids[count]) * 180 / PI
    printf "%s,%.6e,%.6e,%.6e,%.4f,%.4f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f\n", phase, spin_start, spin_end, rigids[count], hours(spin_end), \
        hours(rigids[count]), tilt, rigid_tilt, start["a"], end["a"], start["c"], end["c"] > table
    printf "%6s %16.2f %16.2f %10.2f %12.2f %10.1f %8.3f\n", phase, hours(spin_end), hours(rigids[count]), tilt, rigid_tilt, end["a"], end["largest_fraction"]
    k = abs((spin_end - rigids[count]) / (rigids[count] - SPIN)); if (k > worst_spin) worst_spin = k
    k = abs(tilt - rigid_tilt) * PI / 180; if (k > worst_tilt) worst_tilt = k
}

function abs(x) { return x < 0 ? -x : x }
function acos(x) { return atan2(sqrt(x * x < 1 ? 1 - x * x : 0), x) }
function norm(x, y, z) { return sqrt(x * x + y * y + z * z) }
function hours(spin) { return 2 * PI / spin / 3600 }

function read_series(file,    k, line, name) {
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    for (k = 1; k <= NF; k++) name[k] = $k
    line = 0
    while ((getline < file) > 0) {
        line++
        for (k = 1; k <= NF; k++) { if (line == 1) start[name[k]] = $k; end[name[k]] = $k }
    }
    close(file)
    spin_start = norm(start["spin_x"], start["spin_y"], start["spin_z"])
    spin_end = norm(end["spin_x"], end["spin_y"], end["spin_z"])
}

# Positions and masses of the grains about their centre of mass, and their inertia tensor with that of the balls.
function read_grains(file,    line, number, k, j, sum, total, centre, radius) {
    grains = 0; total = 0; split("", centre)
    while ((getline line < file) > 0) {
        if (line ~ /avrd=/) { number = line; sub(/.*avrd= */, "", number); radius = number + 0 }
        if (line ~ /coo1=/) {
            grains++
            for (k = 1; k <= 3; k++) { number = line; sub(".*coo" k "= *", "", number); grain[grains, k] = number + 0 }
            mass[grains] = 4 / 3 * PI * radius ^ 3 * DENSITY; size[grains] = radius; total += mass[grains]
            for (k = 1; k <= 3; k++) centre[k] += mass[grains] * grain[grains, k]
        }
    }
    close(file)
    split("", J)
    for (i_grain = 1; i_grain <= grains; i_grain++) {
        sum = 0.4 * mass[i_grain] * size[i_grain] ^ 2
        for (k = 1; k <= 3; k++) grain[i_grain, k] -= centre[k] / total
        for (k = 1; k <= 3; k++) sum += mass[i_grain] * grain[i_grain, k] ^ 2
        for (k = 1; k <= 3; k++) {
            J[k, k] += sum
            for (j = 1; j <= 3; j++) J[k, j] -= mass[i_grain] * grain[i_grain, k] * grain[i_grain, j]
        }
    }
    invert()
}

# Inverse K of the symmetric tensor J by its cofactors.
function invert(    k, j, k1, k2, j1, j2, det) {
    for (k = 1; k <= 3; k++) for (j = 1; j <= 3; j++) {
        k1 = k % 3 + 1; k2 = k1 % 3 + 1; j1 = j % 3 + 1; j2 = j1 % 3 + 1
        K[j, k] = J[k1, j1] * J[k2, j2] - J[k1, j2] * J[k2, j1]
    }
    det = J[1, 1] * K[1, 1] + J[1, 2] * K[2, 1] + J[1, 3] * K[3, 1]
    for (k = 1; k <= 3; k++) for (j = 1; j <= 3; j++) K[k, j] /= det
}

# Position of the Earth relative to the origin at the time t from the passage.
function earth(t,    f, k, step, x, y) {
    f = log(2 * abs(MOTION * t) / ECC + 1.8) * (t < 0 ? -1 : 1)
    for (k = 0; k < 60; k++) {
        step = (ECC * (exp(f) - exp(-f)) / 2 - f - MOTION * t) / (ECC * (exp(f) + exp(-f)) / 2 - 1)
        f -= step
        if (step * step < 1e-26) break
    }
    x = AXIS * (ECC - (exp(f) + exp(-f)) / 2); y = AXIS * sqrt(ECC * ECC - 1) * (exp(f) - exp(-f)) / 2
    p[1] = -x; p[2] = -y * cos(INCLINATION); p[3] = -y * sin(INCLINATION)
}

# Rotation matrix R of the quaternion s[1..4] (scalar first).
function matrix(s,    a, b, c, d) {
    a = s[1]; b = s[2]; c = s[3]; d = s[4]
    R[1, 1] = 1 - 2 * (c * c + d * d); R[1, 2] = 2 * (b * c - a * d); R[1, 3] = 2 * (b * d + a * c)
    R[2, 1] = 2 * (b * c + a * d); R[2, 2] = 1 - 2 * (b * b + d * d); R[2, 3] = 2 * (c * d - a * b)
    R[3, 1] = 2 * (b * d - a * c); R[3, 2] = 2 * (c * d + a * b); R[3, 3] = 1 - 2 * (b * b + c * c)
}

# Rates g[1..7] of the quaternion and the angular momentum s[1..7] at the time t.
function rates(t, s, g,    k, j, i, l, m, x, q, d2, cube, change, r2, a, pd) {
    matrix(s)
    for (k = 1; k <= 3; k++) { l[k] = 0; for (j = 1; j <= 3; j++) l[k] += R[j, k] * s[4 + j] }
    for (k = 1; k <= 3; k++) { m[k] = 0; for (j = 1; j <= 3; j++) m[k] += K[k, j] * l[j] }
    for (k = 1; k <= 3; k++) { w[k] = 0; for (j = 1; j <= 3; j++) w[k] += R[k, j] * m[j] }
    g[1] = -(w[1] * s[2] + w[2] * s[3] + w[3] * s[4]) / 2
    g[2] = (w[1] * s[1] + w[2] * s[4] - w[3] * s[3]) / 2
    g[3] = (w[2] * s[1] + w[3] * s[2] - w[1] * s[4]) / 2
    g[4] = (w[3] * s[1] + w[1] * s[3] - w[2] * s[2]) / 2
    g[5] = g[6] = g[7] = 0
    earth(t)
    r2 = p[1] ^ 2 + p[2] ^ 2 + p[3] ^ 2
    for (i = 1; i <= grains; i++) {
        for (k = 1; k <= 3; k++) { x[k] = 0; for (j = 1; j <= 3; j++) x[k] += R[k, j] * grain[i, j] }
        pd = -(p[1] * x[1] + p[2] * x[2] + p[3] * x[3]); d2 = x[1] ^ 2 + x[2] ^ 2 + x[3] ^ 2
        q = (2 * pd + d2) / r2; cube = (1 + q) * sqrt(1 + q); change = q * (3 + 3 * q + q * q) / (cube * (1 + cube))
        for (k = 1; k <= 3; k++) a[k] = -MU / (r2 * sqrt(r2)) * (x[k] - (x[k] - p[k]) * change) * mass[i]
        g[5] += x[2] * a[3] - x[3] * a[2]; g[6] += x[3] * a[1] - x[1] * a[3]; g[7] += x[1] * a[2] - x[2] * a[1]
    }
}

function fly(    t, k, s, y, g1, g2, g3, g4, n, h) {
    h = STEP; s[1] = 1; s[2] = s[3] = s[4] = 0
    for (k = 1; k <= 3; k++) s[4 + k] = J[k, 3] * SPIN
    for (n = 0; n < 2 * HALF / h; n++) {
        t = -HALF + n * h
        rates(t, s, g1)
        for (k = 1; k <= 7; k++) y[k] = s[k] + h / 2 * g1[k]
        rates(t + h / 2, y, g2)
        for (k = 1; k <= 7; k++) y[k] = s[k] + h / 2 * g2[k]
        rates(t + h / 2, y, g3)
        for (k = 1; k <= 7; k++) y[k] = s[k] + h * g3[k]
        rates(t + h, y, g4)
        for (k = 1; k <= 7; k++) s[k] += h / 6 * (g1[k] + 2 * g2[k] + 2 * g3[k] + g4[k])
    }
    rates(HALF, s, g1)
}

function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function stroke(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }
function px(phase) { return 80 + 440 * phase / 180 }
function py(ratio) { return 400 - 340 * ratio / 2 }

function draw(    k, tick) {
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"470\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"470\" fill=\"white\"/>" > svg
    text(300, 30, "middle", "Spin after the passage")
    for (tick = 0; tick <= 4; tick++) {
        stroke(80, py(tick / 2), 520, py(tick / 2), "stroke=\"#e0e0e0\""); text(72, py(tick / 2) + 4, "end", sprintf("%.1f", tick / 2))
    }
    for (tick = 0; tick <= 180; tick += 30) { stroke(px(tick), 400, px(tick), 405, "stroke=\"black\""); text(px(tick), 420, "middle", tick) }
    stroke(80, 60, 80, 400, "stroke=\"black\""); stroke(80, 400, 520, 400, "stroke=\"black\"")
    stroke(80, py(1), 520, py(1), "stroke=\"#808080\" stroke-dasharray=\"5 4\"")
    for (k = 1; k <= count; k++) {
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"7\" fill=\"none\" stroke=\"#d55e00\" stroke-width=\"1.5\"/>\n", px(phases[k]), py(rigids[k] / SPIN) > svg
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3.5\" fill=\"#0072b2\"/>\n", px(phases[k]), py(ends[k] / SPIN) > svg
    }
    printf "<circle cx=\"350\" cy=\"75\" r=\"3.5\" fill=\"#0072b2\"/>\n<circle cx=\"350\" cy=\"95\" r=\"7\" fill=\"none\" stroke=\"#d55e00\" stroke-width=\"1.5\"/>\n" > svg
    text(364, 79, "start", "rubble pile"); text(364, 99, "start", "rigid body")
    stroke(342, 115, 358, 115, "stroke=\"#808080\" stroke-dasharray=\"5 4\""); text(364, 119, "start", "before")
    text(300, 450, "middle", "orientation at the start, degrees")
    print "<text x=\"30\" y=\"230\" text-anchor=\"middle\" transform=\"rotate(-90 30 230)\">spin over the spin before</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
