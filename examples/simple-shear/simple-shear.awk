# Friction and solid fraction of sheared cells against the inertial number, means over seeds:
#
#   awk -v svg=simple-shear.svg -f ../datbox.awk -f ../inertial-number.awk -f simple-shear.awk rate0.3-s1 rate0.3-s2 ... rate3.0-s3
#
# Reads CASE/POSTPRO/series.csv and, from CASE/DATBOX, the rate of the cell, mean diameter and density of the beads. Means are over
# the states beyond the shear strain START, stresses those of contacts and of the motion about the affine field. I = rate d
# sqrt(density/normal stress). Errors: a standard deviation of the seeds' means over the root of their number.
#
# Reads: series.csv: strain_xz, sigma_xz, sigma_zz, kinetic_xz, kinetic_zz, nu, Z_no_rattlers; BODIES.DAT, BULK_BEHAV.DAT, COMPUTE.RON
# Writes: simple-shear.csv: rate (1/s), inertial_number, friction, friction_error, solid_fraction, solid_fraction_error,
#   coordination, coordination_error, normal_stress (Pa); the same on stdout; the figure of friction and solid fraction (svg)

BEGIN {
    FS = ","; START = 1.5
    for (i = 1; i < ARGC; i++) read_case(ARGV[i])
    if (!points) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    table = svg; sub(/svg$/, "csv", table)
    print "rate,inertial_number,friction,friction_error,solid_fraction,solid_fraction_error,coordination,coordination_error,normal_stress" > table
    printf "%10s %16s %18s %18s %16s %19s\n", "rate [1/s]", "inertial number", "friction", "solid fraction", "coordination", "normal stress [Pa]"
    for (k = 1; k <= points; k++) {
        mu[k] = mean(friction, k); mu_error[k] = error(friction, k); nu[k] = mean(solid, k); nu_error[k] = error(solid, k)
        z = mean(coordination, k); z_error = error(coordination, k); p = mean(normal, k); inertial[k] = mean(number, k)
        printf "%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", rate[k], inertial[k], mu[k], mu_error[k], nu[k], nu_error[k], z, z_error, p > table
        printf "%10.4g %16.4g %10.4f ± %.4f %10.4f ± %.4f %9.2f ± %.2f %19.2f\n", rate[k], inertial[k], mu[k], mu_error[k], nu[k], nu_error[k], z, z_error, p
    }
    close(table)
    draw("A sheared cell against its inertial number")
    exit
}

function read_case(folder,    file, k, n, tau, p, solid_sum, z_sum, shear_rate, column, j) {
    file = folder "/POSTPRO/series.csv"
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    for (j = 1; j <= NF; j++) column[$j] = j
    while ((getline < file) > 0) {
        if ($column["strain_xz"] < START) continue
        n++; solid_sum += $column["nu"]; z_sum += $column["Z_no_rattlers"]
        tau -= $column["sigma_xz"] + $column["kinetic_xz"]; p += $column["sigma_zz"] + $column["kinetic_zz"]
    }
    close(file)
    if (n < 20) { print file ": fewer than 20 states beyond a shear strain of " START > "/dev/stderr"; exit 1 }
    read_bodies(folder "/DATBOX"); shear_rate = option_number(folder "/DATBOX", "shear_xz")
    for (k = 1; k <= points && rate[k] != shear_rate; k++);
    if (k > points) rate[points = k] = shear_rate
    j = ++seeds[k]
    friction[k, j] = tau / p; solid[k, j] = solid_sum / n; coordination[k, j] = z_sum / n; normal[k, j] = p / n
    number[k, j] = shear_rate * mean_diameter * sqrt(grain_density / (p / n))
}

# Mean over the seeds of a rate, and its error, 0 for one seed.
function mean(values, k,    j, sum) { for (j = 1; j <= seeds[k]; j++) sum += values[k, j]; return sum / seeds[k] }
function error(values, k,    j, sum, middle) {
    middle = mean(values, k)
    for (j = 1; j <= seeds[k]; j++) sum += (values[k, j] - middle) ^ 2
    return seeds[k] > 1 ? sqrt(sum / (seeds[k] - 1) / seeds[k]) : 0
}
