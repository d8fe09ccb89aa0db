#!/bin/sh
# Errors and run times with target errors, and with options chosen by hand.
#
#     CD_BIN=FOLDER ./targets.sh CASE...
#
# Reads: the cases targets/SCENE-SEED/SETTING, and targets.csv.
# Writes: figures/SCENE/targets: bias.csv, settings.csv and the other tables of `cd-post accuracy-study`.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh
. ./compare.sh

# start SCENE: time from which means are taken, s; the first interval begins one interval before.
start() {
    case $1 in
    collapse) echo 4000 ;;
    rest | spin) echo 800 ;;
    impact) echo 900 ;;
    bonds) echo 400 ;;
    heap) echo 6 ;;
    drum) echo 2.25 ;;
    triaxial) echo 100 ;;
    rubble) echo 5000 ;;
    shear) echo 36 ;;
    merger) echo 6000 ;;
    column) echo 0.44 ;;
    whirl) echo 800 ;;
    mill) echo 2.25 ;;
    esac
}

scenes=$(printf '%s\n' $all_cases | sed -n 's/^targets\/\(.*\)-[0-9]*\/.*/\1/p' | awk '!seen[$0]++') # not the aggregates
for scene in $scenes; do
    compare targets.csv "$scene" targets "$(start "$scene")" $(cases "targets/$scene-*/*")
done
