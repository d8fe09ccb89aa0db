#!/bin/sh
# Figures of the settled and relaxed bodies, and the slopes of their surfaces.
#
#     CD_BIN=FOLDER ./figures.sh CASE...
#
# Reads: OUTBOX and POSTPRO of the cases settled-s1, relaxed-s1 and so on.
# Writes: CASE/POSTPRO/state-NNNNNN of the last states, and of the first of the bodies that relax; figures: semi-axes of the first
# filling, slope.csv and slope.svg of all last states, the same in start/ at the beginning of the spin, and in near/ of the last
# states by planes of a smaller reach.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh

relaxed=$(cases 'relaxed-*')
for case in $all_cases; do
    cd_post state $case --slope-reach 6
done
cd_post compare $all_cases -o figures/near --table state/slopes.csv
last_states $all_cases
cd_post compare $all_cases -o figures --table state/slopes.csv
if [ "$relaxed" ]; then
    for case in $relaxed; do
        cd_post state $case --snapshot 0
    done
    cd_post compare $relaxed -o figures/start --table state-000000/slopes.csv
fi
shown=$(cases '*-s1')
if [ "$shown" ]; then
    cd_post compare $shown -o figures --columns a,b,c,nu,Z,Ec_mean
fi
