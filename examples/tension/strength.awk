# Strength of a packing of cohesive rocks against the strength that the scene states:
#
#   awk -v svg=strength.svg -f ../datbox.awk -f strength.awk pull-25-s1 shear-25-s1 ...
#
# The strength is the largest mean stress of a second on the floor: of tension in `pull`, along the floor in `shear`. (The plate above still feels
# the rocks that it carries off.) Rumpf's formula with the
# solid fraction nu and the coordination number Z that the packing has without load, in the first snapshot after the start, is the stated strength
# times nu Z over those of the scene. Each strength is a mean over the seeds, with its standard error.
#
# Reads: CASE/POSTPRO/probe-floor.csv: time, force_x, force_z; CASE/POSTPRO/probe-middle.csv: time, nu, sigma_xz, sigma_zz;
#   CASE/POSTPRO/series.csv: time, Z; CASE/DATBOX: area of the cell; CASE/scene.ron: nu and z of the stated strength
# Writes: strength.csv next to the figure: mode, stated (Pa), seed, measured, in_the_middle, rumpf (Pa), nu, Z; the means on stdout; the figure (svg)

BEGIN {
    FS = ","
    table = svg; sub(/svg$/, "csv", table)
    print "mode,stated,seed,measured,in_the_middle,rumpf,nu,Z" > table
    for (i = 1; i < ARGC; i++) if (ARGV[i] ~ /(pull|shear)-[0-9.]+-s[0-9]+$/) measure(ARGV[i])
    if (!groups) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    close(table)
    printf "%6s %12s %14s %6s %19s %12s %8s %6s\n", "mode", "stated [Pa]", "measured [Pa]", "+-", "in the middle [Pa]", "Rumpf [Pa]", "nu", "Z"
    for (g = 1; g <= groups; g++) {
        n = count[g]; mean[g] = sum[g] / n; error[g] = n > 1 ? sqrt((sum2[g] / n - mean[g] ^ 2) / (n - 1)) : 0
        printf "%6s %12g %14.1f %6.1f %19.1f %12.1f %8.3f %6.2f\n", mode[g], stated[g], mean[g], error[g], inside[g] / n, rumpf[g] / n, nus[g] / n, zs[g] / n
        ratio[mode[g]] += mean[g] / stated[g]; of_mode[mode[g]]++
    }
    for (m in ratio) printf "%s: measured over stated strength %.2f\n", m, ratio[m] / of_mode[m]
    draw()
    exit
}

function fields(    k) { delete column; for (k = 1; k <= NF; k++) column[$k] = k }

function open(file) {
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    fields()
}

# Sets solid fraction and coordination number for which the scene states the strength.
function read_stated(file,    words) {
    stated_nu = 0
    while (!stated_nu && (getline words < file) > 0) if (words ~ /bulk_strength/) { stated_nu = number_after("nu: *", words); stated_z = number_after(" z: *", words) }
    close(file)
    if (!stated_nu) { print file ": no bulk_strength with nu" > "/dev/stderr"; exit 1 }
}

function measure(folder,    name, part, file, is_shear, stress, largest, middle, nu, z, g, t, area, unloaded, rumpfs) {
    name = folder; sub(/.*\//, "", name); split(name, part, "-"); is_shear = part[1] == "shear"
    area = option_number(folder "/DATBOX", "xperiode") * option_number(folder "/DATBOX", "yperiode")
    read_stated(folder "/scene.ron")
    file = folder "/POSTPRO/series.csv"; open(file)
    while ((getline < file) > 0) if ($column["time"] > 0 && z == "") { unloaded = $column["time"]; z = $column["Z"] }
    close(file)
    file = folder "/POSTPRO/probe-floor.csv"; open(file)
    while ((getline < file) > 0) {
        stress = (is_shear ? $column["force_x"] : $column["force_z"]) / area
        if ($column["time"] > unloaded && stress > largest) { largest = stress; t = $column["time"] }
    }
    close(file)
    # The stress of the region in the same second.
    file = folder "/POSTPRO/probe-middle.csv"; open(file)
    while ((getline < file) > 0) {
        if ($column["time"] == unloaded || nu == "") nu = $column["nu"]
        if ($column["time"] == t) middle = is_shear ? $column["sigma_xz"] : -$column["sigma_zz"]
    }
    close(file)
    if (middle < 0) middle = -middle
    rumpfs = part[2] * nu * z / stated_nu / stated_z
    printf "%s,%s,%s,%.5g,%.5g,%.5g,%.4g,%.4g\n", part[1], part[2], substr(part[3], 2), largest, middle, rumpfs, nu, z > table
    for (g = 1; g <= groups; g++) if (mode[g] == part[1] && stated[g] == part[2]) break
    if (g > groups) { groups = g; mode[g] = part[1]; stated[g] = part[2] }
    count[g]++; sum[g] += largest; sum2[g] += largest ^ 2; inside[g] += middle; rumpf[g] += rumpfs; nus[g] += nu; zs[g] += z
}

function text(x, y, anchor, words) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">%s</text>\n", x, y, anchor, words > svg }
function stroke(x0, y0, x1, y1, style) { printf "<path d=\"M%.1f %.1fL%.1f %.1f\" %s/>\n", x0, y0, x1, y1, style > svg }
function px(value) { return 80 + 440 * value / roof }
function py(value) { return 400 - 340 * value / roof }

function draw(    g, tick, colour) {
    roof = 20
    for (g = 1; g <= groups; g++) while (roof < 1.1 * stated[g] || roof < 1.1 * mean[g]) roof += 20
    print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"470\" font-family=\"sans-serif\" font-size=\"13\">" > svg
    print "<rect width=\"560\" height=\"470\" fill=\"white\"/>" > svg
    text(300, 30, "middle", "Strength of a packing of cohesive rocks")
    for (tick = 0; tick <= roof; tick += 20) {
        stroke(80, py(tick), 520, py(tick), "stroke=\"#e0e0e0\""); text(72, py(tick) + 4, "end", tick)
        stroke(px(tick), 400, px(tick), 405, "stroke=\"black\""); text(px(tick), 420, "middle", tick)
    }
    stroke(80, 60, 80, 400, "stroke=\"black\""); stroke(80, 400, 520, 400, "stroke=\"black\"")
    stroke(px(0), py(0), px(roof), py(roof), "stroke=\"#808080\" stroke-dasharray=\"5 4\"")
    for (g = 1; g <= groups; g++) {
        colour = mode[g] == "pull" ? "#0072b2" : "#d55e00"
        stroke(px(stated[g]), py(mean[g] - error[g]), px(stated[g]), py(mean[g] + error[g]), "stroke=\"" colour "\" stroke-width=\"1.5\"")
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"%s\"/>\n", px(stated[g]), py(mean[g]), colour > svg
    }
    printf "<circle cx=\"100\" cy=\"75\" r=\"4\" fill=\"#0072b2\"/>\n<circle cx=\"100\" cy=\"95\" r=\"4\" fill=\"#d55e00\"/>\n" > svg
    text(112, 79, "start", "tension"); text(112, 99, "start", "shear without pressure")
    stroke(92, 115, 108, 115, "stroke=\"#808080\" stroke-dasharray=\"5 4\""); text(112, 119, "start", "as stated")
    text(300, 450, "middle", "tensile strength that the scene states, Pa")
    print "<text x=\"30\" y=\"230\" text-anchor=\"middle\" transform=\"rotate(-90 30 230)\">measured strength, Pa</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
