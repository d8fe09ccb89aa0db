# Rows for bench/record.sh from the output of `cargo bench`:
#   cargo bench -p cd-solve --bench sweep | LC_ALL=C awk -f bench/kernels.awk
# Reads: the tree that divan prints, with a line of items per second below each bench.
# Writes: lines scene,size,quantity,value,unit,threads to the standard output, of the fastest sample.

BEGIN { scale["K"] = 1e3; scale["M"] = 1e6; scale["G"] = 1e9 }
{ gsub(/│/, "|"); gsub(/├─ |╰─ /, "> "); gsub(/µ/, "u") }
/^[a-z]/ { bench = $1 }
/^[| ]*> / { match($0, /> /); depth = (RSTART - 1) / 3; rest = substr($0, RSTART + 2); sub(/ .*/, "", rest); path[depth] = rest }
match($0, /[0-9.]+ [KMG]?item\/s/) {
    split(substr($0, RSTART, RLENGTH), speed, " ")
    letter = substr(speed[2], 1, 1)
    ns = 1e9 / (speed[1] * (letter in scale ? scale[letter] : 1))
    if (bench == "polyhedra") { printf "gap %s,%d,%s,%.3g,ns per pair,1\n", path[2], path[1], path[0], ns; next }
    name = path[0]; side = path[1]
    cuboids = name ~ /polyhedra/
    quantity = name == "layout" || name == "judge" ? name : name ~ /single/ ? "single" : "double"
    sub(/judge/, "residual", quantity)
    if (name ~ /frictionless/) quantity = quantity " frictionless"
    if (name ~ /rolling/) quantity = quantity " rolling"
    if (name ~ /four_wide|eight_wide/) quantity = quantity " AVX2"
    if (name ~ /one_wide/) quantity = quantity " without vectors"
    printf "%s,%d,%s,%.2g,ns per contact,%d\n", cuboids ? "cuboids" : "spheres", (cuboids ? 12 : 3) * side * side * (side - 1), quantity, ns, name ~ /two_threads/ ? 2 : 1
}
