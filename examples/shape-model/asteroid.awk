# The surface of a fictitious asteroid, as an OBJ file in m: an ellipsoid of 230 by 150 by 120 m with a neck, a ridge
# round its waist and bumps. Made by this project, under its licences.
#
#     awk -f asteroid.awk > asteroid.obj
#
# Reads: nothing
# Writes: an OBJ file on stdout
BEGIN {
	pi = atan2(0, -1); rows = 16; columns = 32
	print "# Made by asteroid.awk; m"
	vertex(0, 0)
	for (i = 1; i < rows; i++) for (j = 0; j < columns; j++) vertex(pi * i / rows, 2 * pi * j / columns)
	vertex(pi, 0)
	last = 2 + (rows - 1) * columns
	for (j = 0; j < columns; j++) {
		print "f", 1, at(1, j), at(1, j + 1)
		for (i = 1; i < rows - 1; i++) print "f", at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
		print "f", at(rows - 1, j), last, at(rows - 1, j + 1)
	}
}
# Number of the vertex in a row and column.
function at(i, j) { return 2 + (i - 1) * columns + j % columns }
# From the angle to the axis z and the longitude.
function vertex(polar, east,    x, y, z, r) {
	x = sin(polar) * cos(east); y = sin(polar) * sin(east); z = cos(polar)
	r = 1 / sqrt((x / 230) ^ 2 + (y / 150) ^ 2 + (z / 120) ^ 2)
	r *= 1 - 0.22 * exp(-((x * r + 30) / 60) ^ 2)          # the neck, off the middle
	r *= 1 + 0.10 * exp(-(z / 0.18) ^ 2)                   # the ridge
	r *= 1 + 0.05 * cos(3 * east + 1) * sin(2 * polar) + 0.04 * cos(5 * x + 2) * cos(4 * y - 1) * cos(3 * z)
	printf "v %.4f %.4f %.4f\n", r * x, r * y, r * z
}
