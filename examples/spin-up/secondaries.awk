# Two-body orbits of the fragments about the largest remnant at the end:
#   awk -v csv=secondaries.csv -f secondaries.awk left-f0-s1/POSTPRO/state-020000/fragments.csv ...
# One row per fragment of two or more grains, or bound grain; distances over the remnant's radius (a b c)^(1/3), angles in degrees, periods in hours.
# Columns are found by their names.
#
# Reads: fragments.csv: grains, mass, a, b, c, bound, orbit_a, orbit_e, inclination, pericentre, orbit_period
# Writes: secondaries.csv: cohesion (N), seed, grains, mass_over_largest, bound, orbit_a, orbit_e, inclination, pericentre, period; the same on stdout

BEGIN {
    FS = ","; LEAST = 2; PI = atan2(0, -1)
    print "cohesion,seed,grains,mass_over_largest,bound,orbit_a,orbit_e,inclination,pericentre,period" > csv
    print "   f_c [N]  seed  grains  mass/largest  bound   a/R      e  inclination  pericentre/R  period [h]"
}

FNR == 1 {
    for (k = 1; k <= NF; k++) column[$k] = k
    name = FILENAME; sub(/\/POSTPRO.*/, "", name); sub(/.*left-f/, "", name)
    split(name, parts, /-s/)
    next
}
FNR == 2 { mass = $column["mass"]; radius = ($column["a"] * $column["b"] * $column["c"]) ^ (1 / 3); next }

$column["grains"] + 0 >= LEAST || $column["bound"] + 0 {
    share = $column["mass"] / mass
    a = $column["orbit_a"] / radius; e = $column["orbit_e"]; tilt = $column["inclination"] * 180 / PI
    near = $column["pericentre"] / radius; period = $column["orbit_period"] == "" ? "" : $column["orbit_period"] / 3600
    printf "%10g %5d %7d %13.4f %6s %5.1f %6.3f %12.1f %13.2f  %s\n", parts[1], parts[2], $column["grains"], share, $column["bound"] ? "yes" : "no", a, e, tilt, near, period == "" ? "-" : sprintf("%.1f", period)
    printf "%g,%d,%d,%.6g,%d,%.6g,%.6g,%.6g,%.6g,%s\n", parts[1], parts[2], $column["grains"], share, $column["bound"], a, e, tilt, near, period == "" ? "-" : sprintf("%.6g", period) > csv
}
