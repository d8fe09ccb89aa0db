# Bounces of landers: time, speed and distance of each:
#
#   awk -v svg=landing.svg -f landing.awk POSTPRO/probe-lander-*.csv
#
# The first impact is the first fall of the speed. A ball that bounces on a plane comes to rest 2e/(1 - e) v/g later, with its speed v at the first
# impact and the gravity g; here g is v over the time of the fall. A lander is at rest from when its speed was last above 1 mm/s.
#
# Reads: probe-lander-E-K.csv, lander K with the restitution E/10: time, x, y, z, v_x, v_y, v_z
# Writes: landing.csv next to the figure: e, lander, impact_time, rest_time (s), impact_speed (m/s), ball_time (s), distance (m); means of
#   each e on stdout; the figure (svg): distance from the first impact against time

BEGIN {
    FS = ","; table = svg; sub(/svg$/, "csv", table)
    print "e,lander,impact_time,rest_time,impact_speed,ball_time,distance" > table
    split("#0072b2 #d55e00 #009e73 #cc79a7", colours, " ")
    for (i = 1; i < ARGC; i++) if (ARGV[i] ~ /lander-[0-9]-[0-9]+[.]csv$/) follow(ARGV[i])
    if (!cases) { print "expected probe-lander-E-K.csv" > "/dev/stderr"; exit 1 }
    close(table)
    printf "%5s %18s %18s %22s %22s %18s\n", "e", "impact [s]", "speed [cm/s]", "bouncing [s]", "of a ball [s]", "distance [m]"
    for (g = 1; g <= groups; g++) {
        printf "%5s %18.0f %18.2f", group[g], impacts[g] / runs[g], 100 * speeds[g] / runs[g]
        printf " %14.0f +- %4.0f %22.0f %11.1f +- %3.1f\n", times[g] / runs[g], error(times[g], times2[g], runs[g]), balls[g] / runs[g], \
            ways[g] / runs[g], error(ways[g], ways2[g], runs[g])
    }
    draw()
    exit
}

function error(sum, sum2, n,    variance) {
    variance = n > 1 ? (sum2 / n - (sum / n) ^ 2) / (n - 1) : 0
    return variance > 0 ? sqrt(variance) : 0
}

function follow(file,    name, part, k, column, speed, last, hit, x0, y0, z0, t, n, ball, way, g) {
    name = file; sub(/.*lander-/, "", name); sub(/[.]csv$/, "", name); split(name, part, "-"); part[1] /= 10
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    for (k = 1; k <= NF; k++) column[$k] = k
    cases++; hit = 0; last = 0; n = 0
    while ((getline < file) > 0) {
        t = $column["time"]; speed = sqrt($column["v_x"] ^ 2 + $column["v_y"] ^ 2 + $column["v_z"] ^ 2)
        if (!hit && speed < last) { hit = t; impact_speed = last; x0 = $column["x"]; y0 = $column["y"]; z0 = $column["z"] }
        last = speed
        if (speed > 1e-3) moved = t
        way = hit ? sqrt(($column["x"] - x0) ^ 2 + ($column["y"] - y0) ^ 2 + ($column["z"] - z0) ^ 2) : 0
        if (hit && t - drawn_at[cases] >= 20) { n++; drawn_at[cases] = t; at[cases, n] = t; far[cases, n] = way }
    }
    close(file)
    if (t > longest) longest = t
    t = moved; n++; at[cases, n] = t; far[cases, n] = way; points[cases] = n
    for (k = 1; k <= n; k++) if (far[cases, k] > farthest) farthest = far[cases, k]
    ball = 2 * part[1] / (1 - part[1]) * hit
    printf "%s,%s,%.0f,%.0f,%.5g,%.0f,%.4g\n", part[1], part[2], hit, t, impact_speed, ball, way > table
    for (g = 1; g <= groups; g++) if (group[g] == part[1]) break
    if (g > groups) { groups = g; group[g] = part[1] }
    of[cases] = g; runs[g]++; impacts[g] += hit; speeds[g] += impact_speed; balls[g] += ball
    times[g] += t - hit; times2[g] += (t - hit) ^ 2; ways[g] += way; ways2[g] += way ^ 2
}

function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function stroke(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }
function px(t) { return 80 + 440 * t / wide }
function py(d) { return 400 - 340 * d / high }

function draw(    k, g, tick, step) {
    step = longest > 8000 ? 4000 : 2000; wide = step * int(longest / step + 1); high = 10 * int(farthest / 10 + 1)
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"470\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"470\" fill=\"white\"/>" > svg
    text(300, 30, "middle", "Distance of the lander from its first impact")
    for (tick = 0; tick <= high; tick += high > 50 ? 20 : 10) { stroke(80, py(tick), 520, py(tick), "stroke=\"#e0e0e0\""); text(72, py(tick) + 4, "end", tick) }
    for (tick = 0; tick <= wide; tick += step) { stroke(px(tick), 400, px(tick), 405, "stroke=\"black\""); text(px(tick), 420, "middle", tick) }
    stroke(80, 60, 80, 400, "stroke=\"black\""); stroke(80, 400, 520, 400, "stroke=\"black\"")
    for (k = 1; k <= cases; k++) {
        printf "<path d=\"" > svg
        for (g = 1; g <= points[k]; g++) printf "%s%.1f %.1f", g == 1 ? "M" : "L", px(at[k, g]), py(far[k, g]) > svg
        printf "\" fill=\"none\" stroke=\"%s\" stroke-width=\"1.3\"/>\n", colours[of[k]] > svg
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3.5\" fill=\"%s\"/>\n", px(at[k, points[k]]), py(far[k, points[k]]), colours[of[k]] > svg
    }
    for (g = 1; g <= groups; g++) { stroke(92, 55 + 20 * g, 112, 55 + 20 * g, "stroke=\"" colours[g] "\" stroke-width=\"2\""); text(118, 59 + 20 * g, "start", "restitution " group[g]) }
    text(300, 450, "middle", "time, s")
    print "<text x=\"30\" y=\"230\" text-anchor=\"middle\" transform=\"rotate(-90 30 230)\">distance, m</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
