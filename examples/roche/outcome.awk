# Outcome of the passages of an aggregate by a planet.
#
#   awk -v csv=outcome.csv -f ../datbox.awk -f outcome.awk q1.1/POSTPRO/series.csv q1.1/POSTPRO/state-020000/fragments.csv ...
#
# The number in the name of a case is its pericentre in radii of the planet. Columns are found by their names; SI units.
#
# Reads: DATBOX/COMPUTE.RON: mass of the planet and periapsis of its orbit; series.csv: mass, a, b, c, largest_a, largest_b, largest_c,
#   largest_fraction, largest_period, bound_fraction, escaping_fraction, n_fragments; fragments.csv: grains
# Writes: outcome.csv: case, q (radii), q_over_roche, class, largest, bound, escaping (shares of the mass), pieces, clumps, b_over_a, c_over_a,
#   period_hours; the same on stdout

BEGIN { FS = ","; PI = atan2(0, -1) }

FNR == 1 {
    split("", column)
    for (k = 1; k <= NF; k++) column[$k] = k
    fragments = FILENAME ~ /fragments.csv$/
    if (!fragments) {
        n++; name[n] = FILENAME; sub(/\/POSTPRO.*/, "", name[n])
        radii[n] = name[n]; sub(/^.*[a-z]/, "", radii[n])
        planet_mass[n] = option_number(name[n] "/DATBOX", "mass"); periapsis[n] = option_number(name[n] "/DATBOX", "periapsis")
    }
    next
}

# Clumps are groups of three grains or more.
fragments { if ($column["grains"] > 2) clumps[n]++; next }

# The first state.
FNR == 2 {
    mean_radius[n] = ($column["a"] * $column["b"] * $column["c"]) ^ (1 / 3)
    density[n] = $column["mass"] / (4 / 3 * PI * mean_radius[n] ^ 3)
}
# The last state.
{
    share[n] = $column["largest_fraction"]; bound[n] = $column["bound_fraction"]; escaping[n] = $column["escaping_fraction"]
    pieces[n] = $column["n_fragments"]; a[n] = $column["largest_a"]; b[n] = $column["largest_b"]; c[n] = $column["largest_c"]
    period[n] = $column["largest_period"]
}

# Richardson, Bottke & Love (1998) by the mass of the largest remnant; M and N by whether any is lost.
function class(share) { return share < 0.5 ? "S" : share < 0.9 ? "B" : share < 1 ? "M" : "N" }

# Roche limit of a fluid, m: 2.46 R (rho_P / rho)^(1/3), in which the radius of the planet cancels.
function roche_limit(k) { return 2.46 * (planet_mass[k] / (4 / 3 * PI * density[k])) ^ (1 / 3) }

END {
    radius = periapsis[1] / radii[1]
    limit = roche_limit(1) / radius
    printf "Bulk density %.0f kg/m^3, mean radius %.1f m; planet: radius R %.4g m, %.0f kg/m^3\n", density[1], mean_radius[1], \
        radius, planet_mass[1] / (4 / 3 * PI * radius ^ 3)
    printf "Fluid: Roche 2.46 R (rho_P/rho)^(1/3) = %.2f R; parabola, no spin (Sridhar & Tremaine 1992) 1.69 R (rho_P/rho)^(1/3) = %.2f R\n", limit, limit * 1.69 / 2.46
    print "case        q/R  q/Roche  class  largest  bound  escaping  pieces  clumps   b/a   c/a  period [h]"
    print "case,q,q_over_roche,class,largest,bound,escaping,pieces,clumps,b_over_a,c_over_a,period_hours" > csv
    for (k = 1; k <= n; k++) {
        hours = period[k] / 3600
        printf "%-10s %4.2f %8.3f %6s %8.3f %6.3f %9.3f %7d %7d %5.2f %5.2f %11.1f\n", name[k], radii[k], periapsis[k] / roche_limit(k), class(share[k]), share[k], bound[k], escaping[k], pieces[k], clumps[k], b[k] / a[k], c[k] / a[k], hours
        printf "%s,%g,%.6g,%s,%.6g,%.6g,%.6g,%d,%d,%.6g,%.6g,%.6g\n", name[k], radii[k], periapsis[k] / roche_limit(k), class(share[k]), share[k], bound[k], escaping[k], pieces[k], clumps[k], b[k] / a[k], c[k] / a[k], hours > csv
    }
}
