# Angle of the bed of a drum about the y axis, slope of its surface, and power of the drum over that of gravity, means over seeds:
#
#   awk -v svg=drum.svg -f ../datbox.awk -f drum.awk smooth-s1 smooth-s2 ... rough-s3
#
# Cases whose names differ in the seed at their end, -sN, are one drum. Means over the second half: the angle between the vertical and
# the line from the axis to the centre of mass; the slope of the free surface; and the power that the walls give over the moment of the
# weight times the speed of the drum (rad/s) at the end of its table, which are equal in a steady flow. Errors: a standard deviation of
# the seeds' means over the root of their number. The Froude number is the square of the speed times the radius over gravity. Columns
# are found by their names.
#
# Reads: CASE/DATBOX: evolution-1.dat: time, speed; BODIES.DAT: radius of the drum; gravity; CASE/POSTPRO/series.csv: time, mass, com_x,
#   com_z, E_outside, surface_slope
# Writes: the table next to the figure, drum.csv: drum, seeds, froude_number, bed_angle, bed_angle_error, slope, slope_error (degrees),
#   power (over that of gravity), power_error; the same on stdout; slopes against time (svg)

BEGIN {
    FS = ","; DEGREE = atan2(0, -1) / 180
    PUBLISHED = 26 # degrees, of the experiment that README.md names
    for (i = 1; i < ARGC; i++) measure(ARGV[i])
    if (!drums) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    table = svg; sub(/svg$/, "csv", table)
    print "drum,seeds,froude_number,bed_angle,bed_angle_error,slope,slope_error,power,power_error" > table
    printf "%-8s %5s %13s %21s %21s %24s\n", "drum", "seeds", "Froude number", "angle of the bed", "slope of its surface", "power over that of gravity"
    for (k = 1; k <= drums; k++) {
        printf "%s,%d,%.4g,%.4g,%.2g,%.4g,%.2g,%.4g,%.2g\n", name[k], seeds[k], froude[k], mean(bed, k), error(bed, k), mean(slope, k), error(slope, k), mean(power, k), error(power, k) > table
        printf "%-8s %5d %13.4f %13.1f° +- %.1f° %13.1f° +- %.1f° %17.3f +- %.3f\n", name[k], seeds[k], froude[k], mean(bed, k), error(bed, k), mean(slope, k), error(slope, k), mean(power, k), error(power, k)
    }
    close(table)
    draw()
    exit
}

# Speed of the drum at the end of its table, rad/s; sets the time at which it begins to rotate, s.
function drum_speed(datbox,    file, words, point, speed) {
    file = datbox "/evolution-1.dat"
    while ((getline words < file) > 0) if (split(words, point, " ") == 2) { speed = point[2]; if (speed == 0) begins = point[1] }
    close(file)
    return speed
}

# Radius of the first hollow cylinder, m.
function drum_radius(datbox,    file, words, value) {
    file = datbox "/BODIES.DAT"
    while (!value && (getline words < file) > 0) if (words ~ /^ DNLYC/) value = number_after("byrd=", words)
    close(file)
    return value
}

function measure(folder,    drum, k, j, file, column, rows, row, t, x, z, work, tilt, mass, first, count, sum_x, sum_z, sum_tilt, datbox, speed) {
    drum = folder; sub(/-s[0-9]+$/, "", drum)
    for (k = 1; k <= drums && name[k] != drum; k++);
    if (k > drums) name[drums = k] = drum
    j = ++seeds[k]; datbox = folder "/DATBOX"; speed = drum_speed(datbox)
    file = folder "/POSTPRO/series.csv"
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    for (row = 1; row <= NF; row++) column[$row] = row
    while ((getline < file) > 0) {
        rows++; t[rows] = $column["time"]; x[rows] = $column["com_x"]; z[rows] = $column["com_z"]; work[rows] = $column["E_outside"]
        tilt[rows] = $column["surface_slope"] / DEGREE; mass = $column["mass"]
        times[k, j, rows] = t[rows]; tilts[k, j, rows] = tilt[rows]
    }
    close(file)
    states[k, j] = rows; first = int(rows / 2)
    for (row = first; row <= rows; row++) { count++; sum_x += x[row]; sum_z += z[row]; sum_tilt += tilt[row] }
    sum_x /= count; if (sum_x < 0) sum_x = -sum_x
    bed[k, j] = atan2(sum_x, -sum_z / count) / DEGREE; slope[k, j] = sum_tilt / count
    power[k, j] = (work[rows] - work[first]) / (t[rows] - t[first]) / (mass * uniform_gravity(datbox) * sum_x * speed)
    froude[k] = speed ^ 2 * drum_radius(datbox) / uniform_gravity(datbox)
}

# Mean over the seeds of a drum, and its error, 0 for one seed.
function mean(values, k,    j, sum) { for (j = 1; j <= seeds[k]; j++) sum += values[k, j]; return sum / seeds[k] }
function error(values, k,    j, sum, middle) {
    middle = mean(values, k)
    for (j = 1; j <= seeds[k]; j++) sum += (values[k, j] - middle) ^ 2
    return seeds[k] > 1 ? sqrt(sum / (seeds[k] - 1) / seeds[k]) : 0
}

function px(time) { return 80 + 440 * time / last }
function py(angle) { return 330 - 280 * angle / 50 }
function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function line(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }

# Slope of the surface against time, from the begin of the rotation on, a curve a case.
function draw(    k, j, row, tick, step, colour, started) {
    last = times[1, 1, states[1, 1]]; step = last > 5 ? 2 : 1
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"400\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"400\" fill=\"white\"/>" > svg
    text(80, 25, "start", "Slope of the surface in a rotating drum, a curve a filling")
    for (tick = 0; tick <= 50; tick += 10) { line(80, py(tick), 520, py(tick), "stroke=\"#e0e0e0\""); text(72, py(tick) + 4, "end", tick "°") }
    for (tick = 0; tick <= last; tick += step) { line(px(tick), 330, px(tick), 335, "stroke=\"black\""); text(px(tick), 350, "middle", tick) }
    line(80, 50, 80, 330, "stroke=\"black\""); line(80, 330, 520, 330, "stroke=\"black\"")
    line(80, py(PUBLISHED), 520, py(PUBLISHED), "stroke=\"black\" stroke-dasharray=\"6 4\"")
    text(516, py(2.2), "end", "dashed: " PUBLISHED "°, experiment in a long drum")
    for (k = 1; k <= drums; k++) {
        colour = k == 1 ? "#0072b2" : "#d55e00"
        text(516, py(2.2) - 18 * (drums - k + 1), "end", "<tspan fill=\"" colour "\">" name[k] " ends</tspan>")
        for (j = 1; j <= seeds[k]; j++) {
            started = 0
            printf "<path fill=\"none\" stroke=\"%s\" d=\"", colour > svg
            for (row = 1; row <= states[k, j]; row++) if (times[k, j, row] >= begins && tilts[k, j, row] >= 0) printf "%s%.1f %.1f", started++ ? "L" : "M", px(times[k, j, row]), py(tilts[k, j, row]) > svg
            print "\"/>" > svg
        }
    }
    text(300, 380, "middle", "time, s")
    print "<text x=\"30\" y=\"190\" text-anchor=\"middle\" transform=\"rotate(-90 30 190)\">slope of the surface</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
