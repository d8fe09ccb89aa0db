#!/bin/sh
# Figures of a study of clouds that fall together, of spheres here and of polyhedra in ../accretion-polyhedra.
#
#     CD_BIN=FOLDER FROM=7500 END=9000 SHOWN=0.4 LARGEST=2000 ../accretion/figures.sh CASE...
#
# FROM, END     means are taken between these times, s
# SHOWN         friction of the runs whose course is shown for every number of grains, without cohesion
# LARGEST       number of grains of the runs whose course is shown for every friction and cohesion
# SPHERES       folder of a study of spheres whose pressures are compared with these; default: none
#
# Reads: POSTPRO and OUTBOX of the cases study/N250-mu0.4-f0 and so on, and study/still-N250.
# Writes: study/figures: means before the grains are brought to rest, rest/ at rest, still/ at true rest, compared/ with the
# spheres, by-number/ and by-law/ against time.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh
figures=study/figures
columns=Ec_mean,Z_all,nu_sphere,pressure_sphere

runs=$(cases 'study/N*')
laws=$(names 's/.*-\(mu[^-]*-f[^-]*\)$/\1/' $runs) # mu0.4-f0 of study/N250-mu0.4-f0
cd_post study $runs -o $figures --from "$FROM" --until "$END" --groups "$laws"
cd_post study $runs -o $figures/rest --groups "$laws"

still=$(cases 'study/still-*')
if [ "$still" ]; then
    cd_post study $still -o $figures/still
fi

spheres=
if [ "${SPHERES:-}" ]; then
    spheres=$(for done in "$SPHERES"/N*/POSTPRO/.done; do test -e "$done" && echo "${done%/POSTPRO/.done}"; done || true)
fi
if [ "$spheres" ]; then
    cd_post study $runs $spheres -o $figures/compared \
        --groups "$(names 's/.*/polyhedra/' $runs),$(names 's/.*/spheres/' $spheres)"
fi

by_number=$(cases "study/N*-mu$SHOWN-f0")
if [ "$by_number" ]; then
    cd_post compare $by_number -o $figures/by-number --columns $columns
fi
by_law=$(cases "study/N$LARGEST-*")
if [ "$by_law" ]; then
    cd_post compare $by_law -o $figures/by-law --columns $columns
fi
