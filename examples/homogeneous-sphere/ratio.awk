# Table and picture of pressure over that of the homogeneous sphere, a case for each series.csv:
#   awk -v svg=ratio.svg -f ratio.awk N250/POSTPRO/series.csv N500/POSTPRO/series.csv ...
# The last row of each counts; columns are found by their names; SI units.
#
# Reads: series.csv: n_grains, mass, R_enclosing, nu_sphere, Z, pressure, pressure_sphere, pressure_virial, a, b, c, Ec_mean, E_grav
# Writes: a table on stdout: N, R (m), nu, Z, P (Pa), P of the virial (Pa), P/virial - 1, P/P0, R/R_i, E_kin/E_grav; the figure P/P0 against N (svg)

BEGIN {
    FS = ","; G = 6.6743e-11; PI = atan2(0, -1)
    for (k = 1; k < ARGC; k++) files[++cases] = ARGV[k]
}

FNR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; name[++c] = FILENAME; next }

{
    n[c] = $column["n_grains"]; p[c] = $column["pressure_sphere"]; virial[c] = $column["pressure_virial"] * p[c] / $column["pressure"] # over the ball, too
    radius[c] = $column["R_enclosing"]; nu[c] = $column["nu_sphere"]; z[c] = $column["Z"]
    volume = 4 / 3 * PI * radius[c] ^ 3
    density = $column["mass"] / volume                       # nu rho
    equal = radius[c] * nu[c] ^ (1 / 3)                      # radius of all grains melted into one
    sphere[c] = 4 * PI / 15 * G * density ^ 2 * radius[c] ^ 2
    # How far the shape and the edge go: enclosing ball over ball of the same moment of inertia.
    spread[c] = radius[c] / (($column["a"] ^ 2 + $column["b"] ^ 2 + $column["c"] ^ 2) / 3) ^ 0.5
    kinetic[c] = $column["E_grav"] != 0 ? -$column["Ec_mean"] * n[c] / $column["E_grav"] : 0
}

END {
    print "Pressure against the homogeneous sphere, P0 = (4 pi / 15) G (nu rho)^2 R^2, at the end:"
    print "     N   R [m]     nu      Z   P [Pa]   virial   P/virial-1    P/P0   R/R_i   E_kin/E_grav"
    for (c = 1; c <= cases; c++)
        printf "%6d %7.2f %6.4f %6.3f %8.5f %8.5f %+11.4f %8.4f %7.4f %12.1e\n", n[c], radius[c], nu[c], z[c], \
            p[c], virial[c], p[c] / virial[c] - 1, p[c] / sphere[c], spread[c], kinetic[c]
    print "R_i: radius of the homogeneous sphere of the same mass and moment of inertia."
    if (svg != "") draw()
}

function x(number) { return 60 + 320 * (log(number) - log(n[1]) + 0.3) / (log(n[cases]) - log(n[1]) + 0.6) }
function y(ratio) { return 240 - 200 * (ratio - 1) / 0.4 }

function draw(    c, tick) {
    printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"420\" height=\"300\" font-family=\"sans-serif\" font-size=\"12\">\n" > svg
    print "<rect width=\"420\" height=\"300\" fill=\"white\"/>" > svg
    for (tick = 1; tick < 1.41; tick += 0.1) {
        printf "<path d=\"M60 %.1f H380\" stroke=\"#ddd\"/>\n", y(tick) > svg
        printf "<text x=\"52\" y=\"%.1f\" text-anchor=\"end\">%.1f</text>\n", y(tick) + 4, tick > svg
    }
    print "<path d=\"M60 40 V240 H380\" fill=\"none\" stroke=\"black\"/>" > svg
    for (c = 1; c <= cases; c++) {
        printf "<text x=\"%.1f\" y=\"258\" text-anchor=\"middle\">%d</text>\n", x(n[c]), n[c] > svg
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"#1f5fa8\"/>\n", x(n[c]), y(p[c] / sphere[c]) > svg
    }
    print "<text x=\"220\" y=\"282\" text-anchor=\"middle\">grains N</text>" > svg
    print "<text x=\"60\" y=\"26\">pressure / (4π/15) G (νρ)² R²; homogeneous sphere: 1</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
