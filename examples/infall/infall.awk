# Grains and mass that enter, leave, and are near the aggregate, from the rows of three probes:
#
#   awk -f infall.awk POSTPRO/probe-entered.csv POSTPRO/probe-lost.csv POSTPRO/probe-near.csv
#
# Reads: probe-*.csv: number, passed_mass, passed_momentum_z
# Writes: a line for each probe on stdout: sums of grains, of mass (kg) and of momentum along z (kg m/s)

BEGIN { FS = ","; printf "%-8s %7s %12s %16s\n", "probe", "grains", "mass [kg]", "momentum [kg m/s]" }
FNR == 1 { report(); grains = mass = momentum = 0; name = FILENAME; sub(/.*probe-/, "", name); sub(/.csv/, "", name)
           for (k = 1; k <= NF; k++) place[$k] = k; next }
{ grains += $place["number"]; mass += $place["passed_mass"]; momentum += $place["passed_momentum_z"] }
END { report() }

function report() {
    if (name != "") printf "%-8s %7d %12.4e %16.4e\n", name, grains, mass, momentum
}
