#!/bin/sh
# Biases of the presets, and of the settings among which they were chosen.
#
#     CD_BIN=FOLDER ./presets.sh CASE...
#
# Reads: DATBOX, OUTBOX, POSTPRO, TIMER.csv and ERRORS.csv of the cases presets/SCENE-SEED/SETTING, and presets.csv.
# Writes: figures/SCENE/KIND: bias.csv, settings.csv and the other tables of `cd-post accuracy-study`; KIND is `chosen` for the
# candidates, on their seeds, and `validated` for the presets, on the other seeds.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh
. ./compare.sh

# start SCENE: time from which means are taken, s. All has come to rest, or to the motion that is studied.
start() {
    case $1 in
    collapse) echo 4000 ;;
    rest | spin) echo 400 ;;
    impact) echo 900 ;;
    bonds) echo 300 ;;
    heap) echo 4.8 ;;
    drum) echo 1.25 ;;
    triaxial) echo 100 ;;
    esac
}

for scene in collapse rest spin impact bonds heap drum triaxial; do
    candidates=$(cases "presets/$scene-*/[ab][0-9]*-t*")
    folders=$(printf '%s\n' $candidates | sed 's/[^/]*$//' | sort -u)
    compare presets.csv $scene chosen $(start $scene) $candidates $(printf '%sreference\n' $folders)
    compare presets.csv $scene validated $(start $scene) $(cases "presets/$scene-*/[dslr]*" | grep -v -F "$folders")
done
