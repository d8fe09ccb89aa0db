# Tables of the results of cd-post, one row per case:
#   awk -v folder=study/figures -f ../datbox.awk -f impacts.awk study/g9.81e-4/bed study/g9.81e-4/strike-f0 ...
# FOLDER/rest.csv has the beds, FOLDER/impacts.csv the strikes, FOLDER/touches.csv the first seconds of them with a snapshot at
# every step. Columns are found by their names; SI units.
#
# Reads: series.csv: mass, n_grains, Ec_mean, com_z, bed_nu, bed_stress_ratio; layers.csv: vertical_stress, weight; of the lander track.csv: time,
#   depth, v_x, v_y, v_z, force, impact.csv: impact_speed, restitution, largest_depth, final_depth, largest_force, contact_time, crater.csv: before,
#   after; fragments.csv: grains; DATBOX: mass of the lander, the last grain
# Writes: rest.csv, impacts.csv, touches.csv, with the names of the columns in their first line, and the same on stdout

BEGIN {
    FS = ","
    for (k = 1; k < ARGC; k++) {
        name = ARGV[k]; sub(/^.*\//, "", name)
        if (match(ARGV[k], /\/g[^\/]*\//)) g = substr(ARGV[k], RSTART + 2, RLENGTH - 3)
        if (name ~ /^bed/) bed(ARGV[k]); else if (name ~ /^touch/) touch(ARGV[k]); else strike(ARGV[k])
    }
    exit
}

# Reads a table: rows, cell[row, column].
function load(file,    line, parts, head, n, k, row) {
    split("", cell); row = -1
    while ((getline line < file) > 0) {
        n = split(line, parts, ",")
        if (++row == 0) for (k = 1; k <= n; k++) head[k] = parts[k]
        else for (k = 1; k <= n; k++) cell[row, head[k]] = parts[k]
    }
    close(file)
    if (row < 1) { print "impacts.awk: no table " file > "/dev/stderr"; exit 1 }
    return rows = row
}

# The files of a case that a pattern of the shell names.
function found(pattern, files,    n, line, command) {
    split("", files); command = "ls -d " pattern
    while ((command | getline line) > 0) files[++n] = line
    close(command)
    return n
}

function put(table, heads, line) {
    if (!(table in begun)) { begun[table] = 1; print heads > (folder "/" table); print ""; print table; print "  " heads }
    print line > (folder "/" table)
    print "  " line
}

function start(case_name,    parts) { sub(/^study\//, "", case_name); cohesion = name; sub(/^.*-f/, "", cohesion); return case_name }

function or_dash(x) { return x == "" ? "-" : sprintf("%.6g", x) }

# At rest: what the walls carry against the weight of all grains, and what the grains still move; solid fraction, horizontal
# over vertical stress, and the sum of the vertical stress of all layers over that of the weight above them.
function bed(path,    files, n, k, all, most, weight, height, nu, ratio, stress, above) {
    load(path "/POSTPRO/series.csv"); weight = cell[rows, "mass"] * g
    grains = cell[rows, "n_grains"]; energy = cell[rows, "Ec_mean"] * grains; height = cell[rows, "com_z"]
    nu = cell[rows, "bed_nu"]; ratio = cell[rows, "bed_stress_ratio"]
    n = found(path "/POSTPRO/state-*/layers.csv", files); load(files[n])
    for (k = 1; k <= rows; k++) { stress += cell[k, "vertical_stress"]; above += cell[k, "weight"] }
    n = found(path "/POSTPRO/track-*/track.csv", files)
    for (k = 1; k <= n; k++) { load(files[k]); all -= cell[rows, "force"]; if (-cell[rows, "force"] > most) most = -cell[rows, "force"] }
    put("rest.csv", "case,gravity,grains,weight,on_walls,on_walls_over_weight,floor_share,height,nu,stress_ratio,stress_over_weight,energy_over_potential", \
        sprintf("%s,%g,%d,%.6g,%.6g,%.6f,%.4f,%.5f,%.4f,%.4f,%.5f,%.2e", start(path), g, grains, weight, all, all / weight, most / all, height, nu, ratio, stress / above, energy / (weight * height)))
}

# The lander from the start to rest.
function strike(path,    files, k, speed, force, loose, hollow, ring) {
    read_bodies(path "/DATBOX"); mass = grain_mass
    found(path "/POSTPRO/track-*", files); file = files[1]
    load(file "/impact.csv"); line = sprintf("%s,%g,%s", start(path), g, cohesion)
    line = line "," or_dash(cell[1, "impact_speed"]) "," or_dash(cell[1, "restitution"]) "," or_dash(cell[1, "largest_depth"]) "," or_dash(cell[1, "final_depth"])
    load(file "/track.csv"); speed = cell[rows, "v_z"]
    k = rows - int(rows / 10) # the mean force by the momentum, as snapshots have those of single steps
    force = 1 + (speed - cell[k, "v_z"]) / (cell[rows, "time"] - cell[k, "time"]) / g
    line = line "," or_dash(speed) "," (speed == "" ? "-" : sprintf("%.4g", force))
    load(file "/crater.csv")
    for (k = 1; k <= rows; k++) if (cell[k, "before"] != "" && cell[k, "after"] != "") {
        ring = cell[k, "before"] - cell[k, "after"]
        if (ring > hollow) hollow = ring
    }
    found(path "/POSTPRO/state-*", files); load(files[1] "/fragments.csv")
    for (k = 2; k <= rows; k++) if (!lander(k)) loose += cell[k, "grains"]
    put("impacts.csv", "case,gravity,cohesion,impact_speed,restitution,largest_depth,final_depth,final_speed,force_over_weight,hollow,loose", line sprintf(",%.4g,%d", hollow, loose))
}

function lander(row) { return cell[row, "grains"] == 1 && cell[row, "mass"] > 0.999 * mass && cell[row, "mass"] < 1.001 * mass }

# The first seconds: the force, the momentum that it takes, what flies then.
function touch(path,    files, k, j, sum, impulse, from, half, speed, largest, tenth, v, h, fastest, ejected, rising, change, depth) {
    read_bodies(path "/DATBOX"); mass = grain_mass
    found(path "/POSTPRO/track-*", files); file = files[1]
    load(file "/impact.csv"); from = cell[1, "contact_time"]; speed = cell[1, "impact_speed"]; largest = cell[1, "largest_force"]
    load(file "/track.csv"); h = cell[2, "time"] - cell[1, "time"]
    for (k = 2; k <= rows; k++) {
        impulse += cell[k, "force"] * h
        if (half == "" && cell[k, "time"] >= from && -cell[k, "v_z"] < speed / 2) half = cell[k, "time"] - from + h
        sum += cell[k, "force"]; if (k > 6) sum -= cell[k - 5, "force"]
        if (sum / 5 > tenth) tenth = sum / 5
    }
    depth = cell[rows, "depth"]
    change = mass * (cell[rows, "v_z"] - cell[1, "v_z"]) + mass * g * (cell[rows, "time"] - cell[1, "time"])
    found(path "/POSTPRO/state-*", files); load(files[1] "/fragments.csv")
    for (k = 2; k <= rows; k++) if (!lander(k)) {
        v = sqrt((cell[k, "v_x"] - cell[1, "v_x"]) ^ 2 + (cell[k, "v_y"] - cell[1, "v_y"]) ^ 2 + (cell[k, "v_z"] - cell[1, "v_z"]) ^ 2)
        if (v > fastest) fastest = v
        if (v > speed / 20) ejected += cell[k, "grains"]
        if (cell[k, "v_z"] > 0 && cell[k, "v_z"] ^ 2 > 4 * g * cell[k, "a"]) rising += cell[k, "grains"]
    }
    put("touches.csv", "case,gravity,cohesion,largest_force,force_of_5_steps,half_time,impulse,momentum,impulse_over_momentum,ejected,rising,fastest,depth", \
        sprintf("%s,%g,%s,%.4g,%.4g,%s,%.8g,%.8g,%.8f,%d,%d,%.4g,%.5g", start(path), g, cohesion, largest, tenth, or_dash(half), impulse, change, impulse / change, ejected, rising, fastest, depth))
}
