# Run-out and height of columns that have collapsed against their aspect ratio a = H/L, means over seeds:
#
#   awk -v svg=column-collapse.svg -f ../datbox.awk -f column-collapse.awk spheres-a0.75-s1 spheres-a0.75-s2 ... rocks-a6-s3
#
# Cases whose names differ in the seed at their end, -sN, are one column. LENGTH, m: length of the column before its collapse. H is twice
# the height of its centre of mass above the floor, z = 0. The deposit is divided into slices of a grain's diameter d; the depth of a
# slice is the volume of its grains over its area. The front is where the depth falls below that of half of a layer, 0.3 d. The final
# height is the depth of the two slices at the wall, over the solid fraction of the column. Errors: a standard deviation of the seeds'
# values over the root of their number. Powers of a are slopes of lines of least squares through logarithms against log a, of the columns with
# a > 1; that of Lube et al. is the slope through their run-outs at the same aspect ratios.
#
# Reads: CASE/DATBOX: BODIES.DAT, COMPUTE.RON: yperiode; CASE/OUTBOX/DOF.LAST: displacements
# Writes: the table next to the figure, column-collapse.csv: shape, seeds, aspect_ratio, runout, runout_error, expected_runout, height,
#   height_error (lengths over L); the same on stdout, with the powers; the figure (svg)

BEGIN {
    LENGTH = 0.06
    for (i = 1; i < ARGC; i++) measure(ARGV[i])
    if (!columns) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    table = svg; sub(/svg$/, "csv", table)
    print "shape,seeds,aspect_ratio,runout,runout_error,expected_runout,height,height_error" > table
    printf "%-8s %5s %13s %18s %9s %18s\n", "shape", "seeds", "aspect ratio", "(L_f - L)/L", "expected", "H_f/L"
    for (k = 1; k <= columns; k++) {
        a = mean(aspect, k); r = mean(runout, k); r_error = error(runout, k); h = mean(height, k); h_error = error(height, k)
        printf "%s,%d,%.4g,%.5g,%.2g,%.4g,%.5g,%.2g\n", shape[k], seeds[k], a, r, r_error, runout_of_lube(a), h, h_error > table
        printf "%-8s %5d %13.2f %10.2f +- %.2f %9.2f %11.3f +- %.3f\n", shape[k], seeds[k], a, r, r_error, runout_of_lube(a), h, h_error
    }
    close(table)
    for (s = 1; s <= shapes; s++) {
        fit_power(shape_name[s], lube)
        write_power(shape_name[s], runout, "run-out", sprintf("%.2f of Lube et al. at these aspect ratios", power))
        write_power(shape_name[s], height, "final height", "0.33 to 0.5")
    }
    draw()
    exit
}

# Fits to the experiments in channels of Lube et al. (2005), between whose ranges the line joins their ends, and to the discs of
# Staron and Hinch (2005); the final height of wide channels up to a factor (Balmforth and Kerswell 2005).
function runout_of_lube(a) { return a < 1.8 ? 1.2 * a : a > 2.8 ? 1.9 * a ^ (2 / 3) : 2.16 + (a - 1.8) * (1.9 * 2.8 ^ (2 / 3) - 2.16) }
function height_of_slope(a) { return 0.75 * a ^ 0.4 }
function runout_of_discs(a) { return a < 2 ? 2.5 * a : 3.25 * a ^ 0.7 }

function name_of_column(folder) { sub(/\/$/, "", folder); sub(/.*\//, "", folder); sub(/-s[0-9]+$/, "", folder); return folder }

function measure(folder,    column, k, file, words, n, x, z, radius, free, volume, volumes, moment, width, d, slice, depth, slices, bin, initial, fraction, threshold) {
    column = name_of_column(folder)
    if (!(column in number)) {
        number[column] = ++columns; shape[columns] = column; sub(/-.*/, "", shape[columns])
        if (!(shape[columns] in known)) { known[shape[columns]] = 1; shape_name[++shapes] = shape[columns] }
    }
    k = number[column]; width = option_number(folder "/DATBOX", "yperiode")
    file = folder "/DATBOX/BODIES.DAT"
    while ((getline words < file) > 0) {
        if (words ~ /^\$bdyty/) n++
        if (words ~ /avrd=/) radius[n] = number_after("avrd=", words)
        if (words ~ /^ NO6xx/) { x[n] = number_after("coo1=", words); z[n] = number_after("coo3=", words) }
        if (words ~ /^ (SPHER|POLYR)/ && words ~ /BLUEx/) free[n] = 1
    }
    close(file)
    file = folder "/OUTBOX/DOF.LAST"; n = 0
    if ((getline words < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    while ((getline words < file) > 0) {
        if (words ~ /^ RBDY3/) { split(words, part, " "); n = part[2] }
        if (words !~ /X\(1\)=/ || !(n in free)) continue
        gsub(/D/, "E", words)
        volume = ball_volume(radius[n]); volumes += volume; moment += volume * z[n]; d += 2 * radius[n]; initial++
        moved[n] = x[n] + number_after("X\\(1\\)= *", words)
    }
    close(file)
    d /= initial
    for (n in free) {
        bin = int(moved[n] / d); slice[bin] += ball_volume(radius[n]); if (bin >= slices) slices = bin + 1
    }
    j = ++seeds[k]
    aspect[k, j] = 2 * moment / volumes / LENGTH
    fraction = volumes / (width * LENGTH * aspect[k, j] * LENGTH)
    threshold = 0.3 * d * d * width
    for (bin = 0; bin < slices && slice[bin] > threshold; bin++);
    # The front between the middles of the last slice above the threshold and of the next.
    depth = slice[bin - 1] - slice[bin]
    lube[k, j] = runout_of_lube(aspect[k, j])
    runout[k, j] = (d * (bin - 0.5 + (slice[bin - 1] - threshold) / depth) - LENGTH) / LENGTH
    height[k, j] = (slice[0] + slice[1]) / (2 * d * width) / fraction / LENGTH
}

# Mean over the seeds of a column, and its error, 0 for one seed.
function mean(values, k,    j, sum) { for (j = 1; j <= seeds[k]; j++) sum += values[k, j]; return sum / seeds[k] }
function error(values, k,    j, sum, middle) {
    middle = mean(values, k)
    for (j = 1; j <= seeds[k]; j++) sum += (values[k, j] - middle) ^ 2
    return seeds[k] > 1 ? sqrt(sum / (seeds[k] - 1) / seeds[k]) : 0
}

# Sets the power of a, and its error, of the columns of a shape with a > 1; returns how many there are.
function fit_power(name, values,    k, j, n, x, y, sx, sy, sxx, sxy, syy, rest) {
    for (k = 1; k <= columns; k++) if (shape[k] == name) for (j = 1; j <= seeds[k]; j++) if (aspect[k, j] > 1) {
        x[++n] = log(aspect[k, j]); y[n] = log(values[k, j]); sx += x[n]; sy += y[n]
    }
    if (n < 3) return 0
    for (k = 1; k <= n; k++) { sxx += (x[k] - sx / n) ^ 2; sxy += (x[k] - sx / n) * (y[k] - sy / n); syy += (y[k] - sy / n) ^ 2 }
    if (sxx < 0.1) return 0 # one column
    rest = syy - sxy ^ 2 / sxx; if (rest < 0) rest = 0
    power = sxy / sxx; power_error = sqrt(rest / (n - 2) / sxx)
    return n
}

function write_power(name, values, quantity, published) {
    if (fit_power(name, values)) printf "%s: %s as a^%.2f +- %.2f for a > 1, published %s\n", name, quantity, power, power_error, published
}

function px(a) { return 80 + 440 * log(a / 0.3) / log(12 / 0.3) }
function py(value) { return bottom - 200 * log(value / low) / log(high / low) }
function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function line(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }

# Axes of a panel with values from low to high; those of a only below the last.
function axes(label, last,    tick, power, value, m) {
    for (power = 0.1; power < 99; power *= 10) for (m = 1; m <= 5; m += m == 2 ? 3 : 1) {
        value = power * m
        if (value >= low && value <= high) { line(80, py(value), 520, py(value), "stroke=\"#e0e0e0\""); text(72, py(value) + 4, "end", value) }
        if (value < 0.3 || value > 12) continue
        line(px(value), bottom, px(value), bottom + 5, "stroke=\"black\"")
        if (last) text(px(value), bottom + 20, "middle", value)
    }
    line(80, bottom - 200, 80, bottom, "stroke=\"black\""); line(80, bottom, 520, bottom, "stroke=\"black\"")
    printf "<text x=\"25\" y=\"%.1f\" text-anchor=\"middle\" transform=\"rotate(-90 25 %.1f)\">%s</text>\n", bottom - 100, bottom - 100, label > svg
}

# A curve through values at a from `from` to `to`, by the name of its function.
function curve(name, from, to, style,    m, a, value) {
    printf "<path fill=\"none\" %s d=\"", style > svg
    for (m = 0; m <= 60; m++) {
        a = from * (to / from) ^ (m / 60)
        value = name == "runout" ? runout_of_lube(a) : name == "height" ? height_of_slope(a) : runout_of_discs(a)
        printf "%s%.1f %.1f", m ? "L" : "M", px(a), py(value) > svg
    }
    print "\"/>" > svg
}

function points(values,    k, x, y, e, colour) {
    for (k = 1; k <= columns; k++) {
        colour = shape[k] == "rocks" ? "#d55e00" : "#0072b2"
        x = px(mean(aspect, k)); y = mean(values, k); e = error(values, k)
        line(x, py(y - e), x, py(y + e), "stroke=\"" colour "\" stroke-width=\"1.5\"")
        if (shape[k] == "rocks") printf "<rect x=\"%.1f\" y=\"%.1f\" width=\"8\" height=\"8\" fill=\"%s\"/>\n", x - 4, py(y) - 4, colour > svg
        else printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"%s\" stroke=\"%s\" stroke-width=\"1.5\"/>\n", x, py(y), shape[k] == "fine" ? "white" : colour, colour > svg
    }
}

function draw() {
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"560\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"560\" fill=\"white\"/>" > svg
    text(80, 25, "start", "Collapsed columns against their aspect ratio")
    bottom = 250; low = 0.2; high = 20
    axes("run-out, (L_f − L)/L", 0); curve("runout", 0.35, 10, "stroke=\"black\""); curve("discs", 0.35, 10, "stroke=\"black\" stroke-dasharray=\"6 4\""); points(runout)
    line(300, 195, 330, 195, "stroke=\"black\""); text(336, 199, "start", "channels, Lube et al. 2005")
    line(300, 213, 330, 213, "stroke=\"black\" stroke-dasharray=\"6 4\""); text(336, 217, "start", "discs, Staron &amp; Hinch 2005")
    printf "<circle cx=\"315\" cy=\"231\" r=\"4\" fill=\"#0072b2\"/><rect x=\"389\" y=\"227\" width=\"8\" height=\"8\" fill=\"#d55e00\"/>\n" > svg
    text(324, 235, "start", "spheres"); text(402, 235, "start", "rocks")
    print "<circle cx=\"454\" cy=\"231\" r=\"4\" fill=\"white\" stroke=\"#0072b2\" stroke-width=\"1.5\"/>" > svg; text(463, 235, "start", "half size")
    bottom = 490; low = 0.2; high = 5
    axes("final height, H_f/L", 1); curve("height", 1, 10, "stroke=\"black\""); text(px(8), py(2.1), "middle", "a^0.4"); points(height)
    text(300, 535, "middle", "aspect ratio, a = H/L")
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
