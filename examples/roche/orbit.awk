# The orbit of an aggregate past a planet at the origin, in the plane z = 0 with the pericentre on the x axis, and its outcome.
#
#   awk -v start=1 -v mass=5.972e24 -v radius=6.371e6 -v speed=0 -v before=10000 -v q=1.5 -f orbit.awk
#
# prints centre (m) and velocity (m/s) at the time -before (s), for study.ron; q is the pericentre in radii of the planet, `speed`
# that at infinity, 0 for a parabola.
#
#   awk -v mass=... -v radius=... -v speed=0 -v before=10000 -v csv=outcome.csv -f orbit.awk q1.5/POSTPRO/series.csv q1.5/.../fragments.csv ...
#
# makes the tables of the outcomes and of the orbits. Columns are found by their names; SI units.
#
# Reads: series.csv: time, mass, com_x, com_y, com_z, P_x, P_y, L_z, a, b, c, largest_a, largest_b, largest_c, largest_fraction, largest_period,
#   bound_fraction, escaping_fraction, n_fragments; fragments.csv: grains
# Writes: outcome.csv: case, q (radii), q_over_roche, class, largest, bound, escaping (shares of the mass), pieces, clumps, b_over_a, c_over_a,
#   period_hours; the same and the errors of the orbits on stdout

BEGIN {
    FS = ","; G = 6.6743e-11; PI = atan2(0, -1); mu = G * mass
    if (start) {
        conic(q * radius, before)
        printf "centre (%.17g, %.17g, 0.0) velocity (%.17g, %.17g, 0.0)\n", \
            r * cosine, -r * sine, mu / h * sine, mu / h * (e + cosine)
        exit
    }
}

function cosh(x) { return (exp(x) + exp(-x)) / 2 }
function sinh(x) { return (exp(x) - exp(-x)) / 2 }

# Time since the pericentre; x is the tangent of half the true anomaly of a parabola, the eccentric anomaly of a hyperbola.
function since(x, q) { return e > 1 ? sqrt((q / (e - 1)) ^ 3 / mu) * (e * sinh(x) - x) : sqrt(2 * q ^ 3 / mu) * (x + x ^ 3 / 3) }

# Eccentricity e, specific angular momentum h, distance r, cosine and sine of the true anomaly at a time after the pericentre.
function conic(q, time,    low, high, k, x) {
    e = 1 + q * speed * speed / mu
    low = 0; high = e > 1 ? 30 : 1e3
    for (k = 0; k < 100; k++) { x = (low + high) / 2; if (since(x, q) < time) low = x; else high = x }
    r = e > 1 ? q / (e - 1) * (e * cosh(x) - 1) : q * (1 + x * x)
    h = sqrt(mu * q * (1 + e))
    cosine = (q * (1 + e) / r - 1) / e; sine = sqrt(1 - cosine * cosine)
}

function larger(a, b) { return a > b ? a : b }
function magnitude(x, y, z) { return sqrt(x * x + y * y + z * z) }

FNR == 1 {
    split("", column)
    for (k = 1; k <= NF; k++) column[$k] = k
    fragments = FILENAME ~ /fragments/
    if (!fragments) {
        n++; name[n] = FILENAME; sub(/\/POSTPRO.*/, "", name[n])
        asked[n] = name[n]; sub(/^[a-z]+/, "", asked[n])
        nearest[n] = 1e300
    }
    next
}

# Clumps are groups of three grains or more.
fragments { if ($column["grains"] > 2) clumps[n]++; else stray[n] += $column["grains"]; next }

{
    m = $column["mass"]; x = $column["com_x"]; y = $column["com_y"]; u = $column["P_x"] / m; v = $column["P_y"] / m
    distance = magnitude(x, y, $column["com_z"]); spin[n] = $column["L_z"]
    energy = (u * u + v * v) / 2 - mu / distance; moment = x * v - y * u
    if (FNR == 2) {
        energy0[n] = energy; moment0[n] = moment; spin0[n] = spin[n]
        longer0[n] = $column["largest_a"] / $column["largest_c"]
        ball = ($column["a"] * $column["b"] * $column["c"]) ^ (1 / 3)
        density[n] = m / (4 / 3 * PI * ball ^ 3); size[n] = ball
    }
    if (distance < nearest[n]) {
        nearest[n] = distance
        # Pericentre of the ellipse or hyperbola of this instant.
        pericentre[n] = moment * moment / mu / (1 + sqrt(larger(0, 1 + 2 * energy * moment * moment / (mu * mu))))
    }
    change[n] = energy - energy0[n]; turned[n] = m * (moment - moment0[n]); gained[n] = spin[n] - spin0[n]
    ended[n] = distance; time[n] = $column["time"]; whole[n] = m * moment0[n]
    share[n] = $column["largest_fraction"]; bound[n] = $column["bound_fraction"]; escaping[n] = $column["escaping_fraction"]
    pieces[n] = $column["n_fragments"]; a[n] = $column["largest_a"]; b[n] = $column["largest_b"]; c[n] = $column["largest_c"]
    period[n] = $column["largest_period"]
}

# Richardson, Bottke & Love (1998) by the mass of the largest remnant; M and N by whether any is lost.
function class(share) { return share < 0.5 ? "S" : share < 0.9 ? "B" : share < 1 ? "M" : "N" }

# Whether what the orbit lost is well above the rounding of its angular momentum.
function known(k) { return turned[k] < -1e-12 * whole[k] }

END {
    if (start) exit
    planet = mass / (4 / 3 * PI * radius ^ 3)
    ratio = (planet / density[1]) ^ (1 / 3)
    printf "Bulk density %.0f kg/m^3, mean radius %.1f m; planet %.0f kg/m^3\n", density[1], size[1], planet
    printf "Fluid: Roche 2.46 R (rho_P/rho)^(1/3) = %.2f R; parabola, no spin (Sridhar & Tremaine 1992) 1.69 R (rho_P/rho)^(1/3) = %.2f R\n", 2.46 * ratio, 1.69 * ratio
    print "case        q/R  q/Roche  class  largest  bound  escaping  pieces  clumps   b/a   c/a  period [h]"
    if (csv != "") print "case,q,q_over_roche,class,largest,bound,escaping,pieces,clumps,b_over_a,c_over_a,period_hours" > csv
    for (k = 1; k <= n; k++) {
        hours = period[k] / 3600
        printf "%-10s %4.2f %8.3f %6s %8.3f %6.3f %9.3f %7d %7d %5.2f %5.2f %11.1f\n", name[k], asked[k], asked[k] / (2.46 * ratio), class(share[k]), share[k], bound[k], escaping[k], pieces[k], clumps[k], b[k] / a[k], c[k] / a[k], hours
        if (csv != "") printf "%s,%g,%.6g,%s,%.6g,%.6g,%.6g,%d,%d,%.6g,%.6g,%.6g\n", name[k], asked[k], asked[k] / (2.46 * ratio), class(share[k]), share[k], bound[k], escaping[k], pieces[k], clumps[k], b[k] / a[k], c[k] / a[k], hours > csv
    }
    print "\nThe orbit of the centre of mass against that of a point: pericentre; distance at the end; energy over G m_P / q;"
    print "angular momentum; spin gained over orbital angular momentum lost"
    print "case       pericentre  distance    energy    moment    spin gained"
    for (k = 1; k <= n; k++) {
        q = asked[k] * radius; conic(q, time[k] - before)
        printf "%-10s %10.1e %9.1e %9.1e %9.1e %10s\n", name[k], pericentre[k] / q - 1, ended[k] / r - 1, change[k] / (mu / q), turned[k] / whole[k], known(k) ? sprintf("%.4f", -gained[k] / turned[k]) : "-"
    }
}
