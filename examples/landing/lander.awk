# Lander of two boxes: a body of 0.3 m x 0.3 m x 0.3 m under a deck of 0.9 m x 0.3 m x 0.06 m.
#
#   awk -f lander.awk
#
# Reads: nothing
# Writes: lander.obj, the closed surface of both; body.obj and deck.obj, its convex pieces.

BEGIN {
    # Outline in x and z, counterclockwise seen from -y.
    n = split("-0.15 0 0.15 0 0.15 0.3 0.45 0.3 0.45 0.36 -0.45 0.36 -0.45 0.3 -0.15 0.3", at, " ") / 2
    for (k = 1; k <= n; k++) { x[k] = at[2 * k - 1]; z[k] = at[2 * k] }
    split("1 2 3 1 3 8 7 8 5 8 3 5 3 4 5 7 5 6", cut, " "); extrude("lander.obj", 18)
    box("body.obj", -0.15, 0.15, 0, 0.3); box("deck.obj", -0.45, 0.45, 0.3, 0.36)
}

function box(file, left, right, low, high) {
    n = 4; x[1] = x[4] = left; x[2] = x[3] = right; z[1] = z[2] = low; z[3] = z[4] = high
    split("1 2 3 1 3 4", cut, " "); extrude(file, 6)
}

# Prism of the outline between y = -0.15 and 0.15, its ends cut into `corners`/3 triangles.
function extrude(file, corners,    k, next_k) {
    for (k = 1; k <= n; k++) printf "v %g -0.15 %g\n", x[k], z[k] > file
    for (k = 1; k <= n; k++) printf "v %g 0.15 %g\n", x[k], z[k] > file
    for (k = 1; k <= corners; k += 3) {
        printf "f %d %d %d\n", cut[k], cut[k + 1], cut[k + 2] > file
        printf "f %d %d %d\n", n + cut[k], n + cut[k + 2], n + cut[k + 1] > file
    }
    for (k = 1; k <= n; k++) {
        next_k = k % n + 1
        printf "f %d %d %d\nf %d %d %d\n", k, n + k, n + next_k, k, n + next_k, next_k > file
    }
    close(file)
}
