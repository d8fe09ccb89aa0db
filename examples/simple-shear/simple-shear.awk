# Friction and solid fraction of sheared cells against the inertial number, means over seeds:
#
#   awk -v svg=simple-shear.svg -f ../datbox.awk -f ../inertial-number.awk -f simple-shear.awk rate0.3-s1 rate0.3-s2 ... rate3.0-s3
#
# Reads CASE/POSTPRO/series.csv and, from CASE/DATBOX, the rate of the cell, mean diameter and density of the beads. Means are over
# the states beyond the shear strain START, stresses those of contacts and of the motion about the affine field. Friction is the shear
# stress over the normal stress on the planes that slide, sigma_zz, and over the mean of the three normal stresses; experiments have the
# former, Chialvo et al. the latter. I = rate d sqrt(density/sigma_zz). Errors: a standard deviation of the seeds' means over the root of
# their number.
#
# Reads: series.csv: strain_xz, sigma_xx, sigma_yy, sigma_zz, sigma_xz, kinetic_xx, kinetic_yy, kinetic_zz, kinetic_xz, nu,
#   Z_no_rattlers; BODIES.DAT, BULK_BEHAV.DAT, COMPUTE.RON
# Writes: simple-shear.csv: rate (1/s), inertial_number, friction, friction_error, of_mean_stress, of_mean_stress_error, solid_fraction,
#   solid_fraction_error, coordination, coordination_error, normal_stress, mean_stress (Pa); the same on stdout, with the published laws;
#   the figure of friction and solid fraction (svg)

BEGIN {
    FS = ","; START = 1.5
    for (i = 1; i < ARGC; i++) read_case(ARGV[i])
    if (!points) { print "expected the folders of the cases" > "/dev/stderr"; exit 1 }
    table = svg; sub(/svg$/, "csv", table)
    print "rate,inertial_number,friction,friction_error,of_mean_stress,of_mean_stress_error,solid_fraction,solid_fraction_error,coordination,coordination_error,normal_stress,mean_stress" > table
    printf "%10s %8s %20s %10s %20s %10s %20s %10s %17s\n", "rate [1/s]", "I", "shear/normal stress", "published", "shear/mean stress", "published", "solid fraction", "published", "coordination"
    for (k = 1; k <= points; k++) {
        mu[k] = mean(friction, k); mu_error[k] = error(friction, k); nu[k] = mean(solid, k); nu_error[k] = error(solid, k)
        z = mean(coordination, k); z_error = error(coordination, k); p = mean(normal, k); inertial[k] = mean(number, k)
        q = mean(of_mean, k); q_error = error(of_mean, k); pressure = mean(mean_stress, k); other_inertial[k] = inertial[k] * sqrt(p / pressure)
        other_mu[k] = q; other_mu_error[k] = q_error
        printf "%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", rate[k], inertial[k], mu[k], mu_error[k], q, q_error, nu[k], nu_error[k], z, z_error, p, pressure > table
        printf "%10.4g %8.4f %11.4f ± %.4f %10.3f %11.4f ± %.4f %10.3f %11.4f ± %.4f %10.3f %10.2f ± %.2f\n", rate[k], inertial[k], mu[k], mu_error[k], friction_of_beads(inertial[k]), q, q_error, friction_of_cells(other_inertial[k]), nu[k], nu_error[k], fraction_of_beads(inertial[k]), z, z_error
    }
    close(table)
    add_curves()
    draw("A sheared cell against its inertial number")
    exit
}

# Glass beads on inclines, of the normal stress: friction of Jop et al. (2006), solid fraction of Pouliquen et al. (2006).
function friction_of_beads(i) { return 0.38 + 0.26 / (0.279 / i + 1) }
function fraction_of_beads(i) { return 0.6 - 0.2 * i }

# Simulated cells of spheres with friction 0.5, of the mean stress (Chialvo et al. 2012).
function friction_of_cells(i) { return 0.382 + 0.37 / ((0.32 / i) ^ 1.5 + 1) }

# The laws between the first and the last inertial number.
function add_curves(    m, i) {
    curves = 2; curve_label[1] = "glass beads on inclines"; curve_dash[1] = "none"; curve_label[2] = "simulated cells (hollow: over the mean stress)"; curve_dash[2] = "6 4"
    for (m = 0; m <= 40; m++) {
        i = inertial[1] * (inertial[points] / inertial[1]) ^ (m / 40)
        curve_inertial[1, m] = curve_inertial[2, m] = i
        curve_mu[1, m] = friction_of_beads(i); curve_mu[2, m] = friction_of_cells(i); curve_nu[1, m] = fraction_of_beads(i)
    }
}

function read_case(folder,    file, k, n, tau, p, trace, solid_sum, z_sum, shear_rate, column, j) {
    file = folder "/POSTPRO/series.csv"
    if ((getline < file) <= 0) { print file ": is not there" > "/dev/stderr"; exit 1 }
    for (j = 1; j <= NF; j++) column[$j] = j
    while ((getline < file) > 0) {
        if ($column["strain_xz"] < START) continue
        n++; solid_sum += $column["nu"]; z_sum += $column["Z_no_rattlers"]
        tau -= $column["sigma_xz"] + $column["kinetic_xz"]; p += $column["sigma_zz"] + $column["kinetic_zz"]
        trace += $column["sigma_xx"] + $column["sigma_yy"] + $column["sigma_zz"] + $column["kinetic_xx"] + $column["kinetic_yy"] + $column["kinetic_zz"]
    }
    close(file)
    if (n < 20) { print file ": fewer than 20 states beyond a shear strain of " START > "/dev/stderr"; exit 1 }
    read_bodies(folder "/DATBOX"); shear_rate = option_number(folder "/DATBOX", "shear_xz")
    for (k = 1; k <= points && rate[k] != shear_rate; k++);
    if (k > points) rate[points = k] = shear_rate
    j = ++seeds[k]
    friction[k, j] = tau / p; of_mean[k, j] = 3 * tau / trace; mean_stress[k, j] = trace / 3 / n; solid[k, j] = solid_sum / n; coordination[k, j] = z_sum / n; normal[k, j] = p / n
    number[k, j] = shear_rate * mean_diameter * sqrt(grain_density / (p / n))
}

# Mean over the seeds of a rate, and its error, 0 for one seed.
function mean(values, k,    j, sum) { for (j = 1; j <= seeds[k]; j++) sum += values[k, j]; return sum / seeds[k] }
function error(values, k,    j, sum, middle) {
    middle = mean(values, k)
    for (j = 1; j <= seeds[k]; j++) sum += (values[k, j] - middle) ^ 2
    return seeds[k] > 1 ? sqrt(sum / (seeds[k] - 1) / seeds[k]) : 0
}
