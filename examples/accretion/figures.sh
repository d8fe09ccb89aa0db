#!/bin/sh
# Figures of a study of clouds that fall together, of spheres here and of polyhedra in ../accretion-polyhedra.
#
#     CD_BIN=FOLDER WINDOW=1500 SHOWN=0.4 ../accretion/figures.sh CASE...
#
# WINDOW        time before the event that brings the grains to rest over which means are taken, s
# SHOWN         friction of the runs whose course is shown for every number of grains, without cohesion; of the first seed
# SPHERES       folder of a study of spheres whose pressures are compared with these; default: none
#
# Reads: DATBOX, OUTBOX and POSTPRO of the cases study/N250-mu0.4-f0-s1 and so on, study/still-N250-s1, study/every-N8000-s1; study.csv.
# Writes: study/figures: means before the grains are brought to rest, rest/ at rest, still/ at true rest, every/ with gravity in each
# step, compared/ with the spheres, by-number/ and by-law/ against time, of the first seed.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh
figures=study/figures
columns=Ec_mean,Z_all,nu_sphere,pressure_sphere

runs=$(cases 'study/N*')
laws=$(names 's/.*-\(mu[^-]*-f[^-]*\)-s[0-9]*$/\1/' $runs) # mu0.4-f0 of study/N250-mu0.4-f0-s1
end=$(option "$(echo $runs | cut -d ' ' -f 1)" time) # of the event, the same in all runs
cd_post study $runs -o $figures --parameters study.csv --from "$(calculation "$end - $WINDOW")" --until "$end" --groups "$laws"
cd_post study $runs -o $figures/rest --parameters study.csv --groups "$laws"

still=$(cases 'study/still-*')
if [ "$still" ]; then
    cd_post study $still -o $figures/still --parameters study.csv
fi

every=$(cases 'study/every-*')
if [ "$every" ]; then
    cd_post study $every -o $figures/every --parameters study.csv
fi

spheres=
if [ "${SPHERES:-}" ]; then
    spheres=$(for done in "$SPHERES"/N*/POSTPRO/.done; do test -e "$done" && echo "${done%/POSTPRO/.done}"; done || true)
fi
if [ "$spheres" ]; then
    cd_post study $runs $spheres -o $figures/compared \
        --groups "$(names 's/.*/polyhedra/' $runs),$(names 's/.*/spheres/' $spheres)"
fi

by_number=$(cases "study/N*-mu$SHOWN-f0-s1")
if [ "$by_number" ]; then
    cd_post compare $by_number -o $figures/by-number --columns $columns
fi
# All frictions and cohesions of the largest number of grains that has runs with cohesion.
largest=$(cases 'study/N*-f[!0]*' | sed 's/.*\/N\([0-9]*\)-.*/\1/' | sort -n | tail -n 1)
by_law=$(cases "study/N$largest-*-s1")
if [ "$by_law" ]; then
    cd_post compare $by_law -o $figures/by-law --columns $columns
fi
