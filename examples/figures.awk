# Final figures of a case:  awk -f figures.awk OUTBOX/steps.csv POSTPRO/series.csv
# Columns are found by their names in the first line; units are SI.
#
# Reads: steps.csv: step, sweeps, converged, penetration_largest, momentum_drift; series.csv: time, n_grains, mass, pressure, pressure_virial,
#   pressure_kinetic, pressure_sphere, E_grav, R_enclosing, Z, Z_no_rattlers, n_contacts, nu, nu_sphere, region, region_volume, a, b, c,
#   n_fragments, largest_fraction
# Writes: a list on stdout

BEGIN { FS = ","; G = 6.6743e-11; PI = atan2(0, -1) }

FNR == 1 {
    file++
    for (k = 1; k <= NF; k++) column[file, $k] = k
    next
}

function get(name) { return $column[file, name] }

# steps.csv: of all steps, and which of them did not converge
file == 1 {
    steps++
    sweeps += get("sweeps")
    if (get("converged") == 0) { unconverged++; last_unconverged = get("step") }
    if (get("penetration_largest") + 0 > penetration) penetration = get("penetration_largest") + 0
    drift = get("momentum_drift"); step = get("step")
}

# series.csv: the last row
file == 2 { n = get("n_grains"); for (key in column) { split(key, part, SUBSEP); if (part[1] == 2) row[part[2]] = get(part[2]) } }

function line(name, value) { printf "  %-24s %s\n", name, value }

END {
    if (file < 2) exit 1
    printf "At the end, t = %g s:\n", row["time"]
    line("grains", n)
    p = row["pressure"]; virial = row["pressure_virial"]; kinetic = row["pressure_kinetic"]
    line("pressure", sprintf("%.5g Pa from contacts; virial %.5g Pa%s", p, virial, virial != 0 ? sprintf(", %+.2f %%", 100 * (p / virial - 1)) : ""))
    # In steady rotation the contacts carry what the motion leaves of the virial.
    if (virial != 0 && kinetic > 0.001 * virial)
        line("", sprintf("virial less motion %.5g Pa, %+.2f %%", virial - kinetic, 100 * (p / (virial - kinetic) - 1)))
    if (row["E_grav"] != 0) {
        radius = row["R_enclosing"]
        density = row["mass"] / (4 / 3 * PI * radius ^ 3)
        line("homogeneous sphere", sprintf("pressure in the ball around all / (4 pi / 15) G (nu rho)^2 R^2 = %.4f", row["pressure_sphere"] / (4 * PI / 15 * G * density ^ 2 * radius ^ 2)))
    }
    z = row["Z_no_rattlers"]
    line("coordination Z", sprintf("%.3f, without rattlers %s", row["Z"], z == "" ? "not defined" : sprintf("%.3f", z)))
    line("contacts with force", sprintf("%d%s", row["n_contacts"], row["E_grav"] != 0 ? sprintf("; isostatic without friction: 3 N - 6 = %d", 3 * n - 6) : ""))
    line("solid fraction nu", sprintf("%.4f of the region of %.5g m^3 (number %d)%s", row["nu"], row["region_volume"], row["region"], row["nu_sphere"] == "" ? "" : sprintf("; %.4f in the ball around all, R = %.5g m", row["nu_sphere"], row["R_enclosing"])))
    line("semi-axes", sprintf("%.5g, %.5g, %.5g m", row["a"], row["b"], row["c"]))
    line("fragments", sprintf("%d, the largest with %.1f %% of the mass", row["n_fragments"], 100 * row["largest_fraction"]))
    line("steps", sprintf("%d, %.1f sweeps each, %d unconverged%s", steps, sweeps / (steps ? steps : 1), unconverged, unconverged ? ", the last at " last_unconverged : ""))
    line("largest penetration", sprintf("%.2e of the mean radius", penetration))
    line("momentum drift", sprintf("%.1e of sum m |v|", drift))
}
