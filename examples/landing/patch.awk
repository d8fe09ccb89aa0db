# Patch of a surface as convex pieces: each triangle near a site (polygons are cut into triangles) is the base of a tetrahedron with its apex in the origin, which the surface
# must surround like a star. Neighbours share their faces, so that the pieces together have the surface itself.
#
#   awk -v x=40 -v y=30 -v radius=45 -f patch.awk ../shape-model/asteroid.obj
#
# x, y: site on the upper side, m; radius: distance from it, m.
# Reads: an OBJ file: vertices and faces
# Writes: patch/piece-NNN.obj, and their names as a list of RON on stdout.

$1 == "v" { n++; for (k = 1; k <= 3; k++) v[n, k] = $(k + 1) }
$1 == "f" { for (corner = 3; corner < NF; corner++) add($2, $corner, $(corner + 1)) }
END { print list }

function add(a, b, c,    k, at, file) {
    for (k = 1; k <= 3; k++) at[k] = (v[a, k] + v[b, k] + v[c, k]) / 3
    if (at[3] < 0 || (at[1] - x) ^ 2 + (at[2] - y) ^ 2 > radius ^ 2) return
    file = sprintf("patch/piece-%03d.obj", ++pieces)
    print "v", v[a, 1], v[a, 2], v[a, 3] "\nv", v[b, 1], v[b, 2], v[b, 3] "\nv", v[c, 1], v[c, 2], v[c, 3] > file
    print "v 0 0 0\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1" > file
    close(file)
    list = list (list ? ", " : "") "\"" file "\""
}
