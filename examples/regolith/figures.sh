#!/bin/sh
# Figures and tables of the beds and of the strikes on them.
#
#     CD_BIN=FOLDER ./figures.sh CASE...
#
# Reads: POSTPRO and DATBOX of the cases, after analyse.sh.
# Writes: study/figures: gGRAVITY/ (strikes of the first seed by cohesion), beds/, layers/ (of the first seed), impacts.csv,
# touches.csv, rest.csv.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh
figures=study/figures

beds=$(cases 'study/s*/g*/bed')
other_beds=$(cases 'study/s*/g*/bed-*')
strikes=$(cases 'study/s*/g*/strike-f*')
other_strikes=$(cases 'study/s*/g*/strike-[!f]*') # on beds of polyhedra, on periodic beds, and of the sampler

for folder in $(printf '%s\n' $strikes | sed -n 's/^\(study\/s1\/.*\)\/strike.*/\1/p' | sort -u); do # study/s1/g9.81e-4
    strikes_here=$(cases "$folder/strike-f*")
    cohesions=$(names 's/.*strike-f\(.*\)/\1 N/' $strikes_here)
    cd_post compare $strikes_here -o "$figures/${folder#study/s1/}" --labels "$cohesions" \
        --columns largest_fraction,Ec_mean,Z,E_friction,E_shocks
    cd_post compare $strikes_here -o "$figures/${folder#study/s1/}" --labels "$cohesions" --table lander/track.csv
done
if [ "$beds" ]; then
    cd_post study $beds -o $figures/beds --groups "$(names 's/.*\/g\(.*\)\/bed/\1/' $beds)"
fi
layered=$(cases 'study/s1/g9.81e-4/bed*')
if [ "$layered" ]; then
    cd_post compare $layered -o $figures/layers --labels "$(names 's/.*\///' $layered)" --table state/layers.csv
fi
mkdir -p $figures
awk -v folder=$figures -f ../datbox.awk -f impacts.awk $other_beds $beds $strikes $other_strikes $(cases 'study/s*/g*/touch-*')
