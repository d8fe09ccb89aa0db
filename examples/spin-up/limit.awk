# The spin at which each aggregate fails, against the limits of Drucker and Prager:
#   awk -v svg=limit.svg -f limit.awk f0/POSTPRO/series.csv f100/POSTPRO/series.csv ...
# It fails when its largest remnant has lost a hundredth of the mass or is longer by a fifth than at the start; the spin is
# the largest that it had before. With svg=FOLDER/limit.svg the table is written to FOLDER/limit.csv too.
# Columns go by their names; SI units.

BEGIN {
    FS = ","; G = 6.6743e-11; PI = atan2(0, -1)
    for (k = 1; k < ARGC; k++) files[++cases] = ARGV[k]
}

FNR == 1 {
    c++
    for (k = 1; k <= NF; k++) column[$k] = k
    name = FILENAME; sub(/^.*\/?f/, "", name); sub(/\/.*/, "", name)
    cohesion[c] = name + 0
    next
}

FNR == 2 {
    # The aggregate at the start: volume of the ellipsoid of equal inertia, radius of the ball of that volume.
    volume = 4 / 3 * PI * $column["a"] * $column["b"] * $column["c"]
    long[c] = $column["a"]
    radius[c] = ($column["a"] * $column["b"] * $column["c"]) ^ (1 / 3)
    density[c] = $column["mass"] / volume
    grains[c] = $column["n_grains"]; z[c] = $column["Z"]
    # 500 grains of radii about r; solid volume over that of the ellipsoid
    solid[c] = $column["nu"] * (4 / 3 * PI * $column["R_enclosing"] ^ 3) / volume
    mean[c] = (solid[c] * volume / grains[c] / (4 / 3 * PI)) ^ (1 / 3)
}

!failed[c] {
    if ($column["largest_fraction"] < 0.99 || $column["largest_a"] > 1.2 * long[c]) { failed[c] = 1; time[c] = $column["time"] }
    else if ($column["largest_spin"] > spin[c]) {
        spin[c] = $column["largest_spin"]; axis_a[c] = $column["largest_a"]; axis_c[c] = $column["largest_c"]
    }
}

function sine(phi) { return sin(phi * PI / 180) }
# Coefficient of Drucker and Prager, and with it the spin over w_c without cohesion.
function s_of(phi) { return 2 * sine(phi) / (sqrt(3) * (3 - sine(phi))) }
function cohesionless(phi,    q) { q = 2 * sine(phi) / (3 - sine(phi)); return sqrt(3 * q / (1 + 2 * q)) }
# With a cohesion k (Pa) of the whole: w^2 (1/sqrt(3) + 2 s) = 4 pi G rho s + 5 k / (rho R^2).
function cohesive(phi, k, rho, r) { return sqrt((4 * PI * G * rho * s_of(phi) + 5 * k / (rho * r * r)) / (1 / sqrt(3) + 2 * s_of(phi))) }
# Tensile strength of grains that hold each other by f (Rumpf 1970): nu Z f / (pi d^2); k = 3 s times that.
function strength(c) { return solid[c] * z[c] * cohesion[c] / (4 * PI * mean[c] ^ 2) }

END {
    critical = sqrt(4 * PI * G * density[1] / 3)
    printf "Spin at failure; bulk density %.0f kg/m^3, R %.1f m, w_c %.3e rad/s (period %.2f h)\n", density[1], radius[1], critical, 2 * PI / critical / 3600
    print "   f_c [N]  strength [Pa]    w [rad/s]    w/w_c  period [h]   c/a   limits at phi = 30, 40 deg"
    for (c = 1; c <= cases; c++) {
        t = strength(c)
        printf "%10g %14.3f %12.3e %8.3f %11.2f %5.2f   %.3f %.3f%s\n", cohesion[c], t, spin[c], spin[c] / critical, \
            2 * PI / spin[c] / 3600, axis_c[c] / axis_a[c], cohesive(30, 3 * s_of(30) * t, density[c], radius[c]) / critical, \
            cohesive(40, 3 * s_of(40) * t, density[c], radius[c]) / critical, failed[c] ? "" : "  (held to the end)"
    }
    printf "Without cohesion, (w/w_c)^2 = 3 q / (1 + 2 q): %.3f at 30 deg, %.3f at 40 deg\n", cohesionless(30), cohesionless(40)
    if (svg != "") { write_table(); draw() }
}

function write_table(    table, c, t) {
    table = svg; sub(/svg$/, "csv", table)
    print "cohesion,strength,spin,spin_over_critical,limit_30,limit_40,over_mean_limit,failed" > table
    for (c = 1; c <= cases; c++) {
        t = strength(c)
        low = cohesive(30, 3 * s_of(30) * t, density[c], radius[c]); high = cohesive(40, 3 * s_of(40) * t, density[c], radius[c])
        printf "%g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d\n", cohesion[c], t, spin[c], spin[c] / critical, low / critical, high / critical, 2 * spin[c] / (low + high), failed[c] > table
    }
    close(table)
}

function x(t) { return 70 + 400 * t / most }
function y(w) { return 270 - 220 * w / top }

# The largest of 1, 2 and 5 times a power of ten that is not above x > 0.
function round_part(x,    power) {
    power = 1
    while (power > x) power /= 10
    while (10 * power <= x) power *= 10
    return (x >= 5 * power ? 5 : x >= 2 * power ? 2 : 1) * power
}

function curve(phi,    k, t) {
    printf "<path fill=\"none\" stroke=\"#999\" d=\"" > svg
    for (k = 0; k <= 60; k++) {
        t = most * k / 60
        printf "%s%.1f %.1f", k ? "L" : "M", x(t), y(cohesive(phi, 3 * s_of(phi) * t, density[1], radius[1]) / critical) > svg
    }
    print "\"/>" > svg
    printf "<text x=\"%.1f\" y=\"%.1f\" fill=\"#666\">φ = %d°</text>\n", x(most) + 5, y(cohesive(phi, 3 * s_of(phi) * most, density[1], radius[1]) / critical) + 4, phi > svg
}

function draw(    c, k, tick) {
    most = 1.05 * strength(cases); if (most == 0) most = 1
    top = 0
    for (c = 1; c <= cases; c++) if (spin[c] / critical > top) top = spin[c] / critical
    tick = cohesive(40, 3 * s_of(40) * most, density[1], radius[1]) / critical; if (tick > top) top = tick
    top *= 1.1
    printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"560\" height=\"330\" font-family=\"sans-serif\" font-size=\"13\">\n" > svg
    print "<rect width=\"560\" height=\"330\" fill=\"white\"/>" > svg
    for (k = 0; k <= top; k += 0.5) {
        printf "<path d=\"M70 %.1f H470\" stroke=\"#e0e0e0\"/><text x=\"62\" y=\"%.1f\" text-anchor=\"end\">%.1f</text>\n", y(k), y(k) + 4, k > svg
    }
    tick = round_part(most / 3)
    for (k = 0; k * tick <= most; k++)
        printf "<text x=\"%.1f\" y=\"288\" text-anchor=\"middle\">%g</text>\n", x(k * tick), k * tick > svg
    curve(20); curve(30); curve(40)
    for (c = 1; c <= cases; c++)
        printf "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"5\" fill=\"%s\" stroke=\"#0072b2\" stroke-width=\"2\"/>\n", x(strength(c)), y(spin[c] / critical), failed[c] ? "#0072b2" : "white" > svg
    print "<path d=\"M70 40 V270 H470\" fill=\"none\" stroke=\"black\"/>" > svg
    print "<text x=\"270\" y=\"315\" text-anchor=\"middle\">tensile strength ν Z f / π d² (Pa)</text>" > svg
    print "<text x=\"22\" y=\"155\" text-anchor=\"middle\" transform=\"rotate(-90 22 155)\">spin at failure / √(4πGρ/3)</text>" > svg
    print "<text x=\"70\" y=\"25\">Dots: runs. Lines: Drucker and Prager, friction angle φ.</text>" > svg
    print "</svg>" > svg
    close(svg)
    print "drawn in " svg
}
