# Surface of a conical hopper about the z axis, open above and below, in OBJ:
#
#   awk -v outlet=0.12 -f hopper.awk > hopper-0.12.obj
#
# The cone rises at 60 degrees from the outlet, of this diameter (m) at z = 0, to a cylinder of radius 0.2 m, which
# ends at z = 0.9 m. Its polygons have SIDES sides and the area of the circles, so that the outlet has the area of a round
# one.
#
# Reads: nothing
# Writes: the surface on stdout

BEGIN {
    SIDES = 96; pi = atan2(0, -1); wide = 0.2; top = 0.9; rise = sqrt(3)
    # Ratio of the radius of a circle to that of the corners of the polygon of the same area.
    corner = sqrt(2 * pi / SIDES / sin(2 * pi / SIDES))
    radius[0] = outlet / 2; z[0] = 0
    radius[1] = wide; z[1] = (wide - outlet / 2) * rise
    radius[2] = wide; z[2] = top
    for (ring = 0; ring < 3; ring++) for (k = 0; k < SIDES; k++) {
        angle = 2 * pi * k / SIDES
        printf "v %.12g %.12g %.12g\n", corner * radius[ring] * cos(angle), corner * radius[ring] * sin(angle), z[ring]
    }
    # Seen from the axis, triangles are counter-clockwise.
    for (ring = 0; ring < 2; ring++) for (k = 0; k < SIDES; k++) {
        a = ring * SIDES + k + 1; b = ring * SIDES + (k + 1) % SIDES + 1
        printf "f %d %d %d\nf %d %d %d\n", a, a + SIDES, b, b, a + SIDES, b + SIDES
    }
}
