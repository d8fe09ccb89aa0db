#!/bin/sh
# Figures and tables of the beds and of the strikes on them.
#
#     CD_BIN=FOLDER ./figures.sh CASE...
#
# Reads: POSTPRO and DATBOX of the cases, after analyse.sh.
# Writes: study/figures: gGRAVITY/ (strikes by cohesion), beds/, layers/, impacts.csv, touches.csv, rest.csv.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh
figures=study/figures

beds=$(cases 'study/g*/bed')
other_beds=$(cases 'study/g*/bed-*')
strikes=$(cases 'study/g*/strike-f*')
other_strikes=$(cases 'study/g*/strike-[!f]*') # on beds of polyhedra, on periodic beds, and of the sampler

for folder in $(printf '%s\n' $strikes | sed 's/\/strike.*//' | sort -u); do # study/g9.81e-4
    strikes_here=$(cases "$folder/strike-f*")
    cohesions=$(names 's/.*strike-f\(.*\)/\1-N/' $strikes_here)
    cd_post compare $strikes_here -o "$figures/${folder#study/}" --labels "$cohesions" \
        --columns largest_fraction,Ec_mean,Z,E_friction,E_shocks
    cd_post compare $strikes_here -o "$figures/${folder#study/}" --labels "$cohesions" --table lander/track.csv
done
if [ "$beds" ]; then
    cd_post study $beds -o $figures/beds --groups "$(names 's/.*\/g\(.*\)\/bed/\1/' $beds)"
fi
if [ "$other_beds" ]; then
    # With the first bed of spheres between walls, which has the same gravity.
    cd_post compare $(echo $beds | cut -d ' ' -f 1) $other_beds -o $figures/layers --table state/layers.csv
fi
mkdir -p $figures
awk -v folder=$figures -f ../datbox.awk -f impacts.awk $other_beds $beds $strikes $other_strikes $(cases 'study/g*/touch-*')
