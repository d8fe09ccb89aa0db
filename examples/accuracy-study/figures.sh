#!/bin/sh
# Compares the runs of each scene with the finest of them, and combines the seeds of a scene.
#
#     CD_BIN=FOLDER ./figures.sh CASE...
#
# Reads: DATBOX, OUTBOX, POSTPRO, TIMER.csv and ERRORS.csv of the cases SCENE-SEED/OPTION-VALUE and SCENE-SEED/SETTINGS.
# Writes: figures/SCENE-SEED and figures/SCENE: accuracy.csv, orders.csv, accuracy.svg.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh

# time_options SCENE CASE: time from which means are taken, and time at which positions are compared early, s. Of `collapse` and
# `heap` means are over the last fifth, of `rest` and `spin` over the second half, of `cloud` they are those of the last state.
time_options() {
    end=$(option "$2" end_time)
    case $1 in
    collapse) echo --from "$(calculation "0.8 * $end")" --early 1600 ;;
    rest | spin) echo --from "$(calculation "0.5 * $end")" --early 80 ;;
    heap) echo --from "$(calculation "0.8 * $end")" --early 0.6 ;;
    cloud) echo --from "$end" --early "$end" ;;
    esac
}

# values CASE...: values of the options, with commas; of theta the distance from 1/2, to which its error is proportional.
values() {
    for case; do
        run=${case##*/}
        case $run in
        theta-*) awk -v theta="${run#*-}" 'BEGIN { print theta - 0.5 }' ;;
        *-*) echo "${run#*-}" ;;
        *) echo nan ;;
        esac
    done | paste -s -d , -
}

folders=$(printf '%s\n' $all_cases | sed -n 's/\/.*//p' | sort -u) # not the aggregates
for folder in $folders; do
    runs=$(cases "$folder/*")
    options=$(names 's/.*\///; s/-.*//' $runs)
    cd_post accuracy-study $runs -o figures/$folder --groups "$options" --values "$(values $runs)" \
        $(time_options ${folder%-*} $(echo $runs | cut -d ' ' -f 1)) \
        --title "$folder: error against time"
done
for scene in collapse rest spin heap; do
    realisations=$(printf '%s\n' $folders | grep "^$scene-" | sed 's/^/figures\//' || true)
    count=$(echo $realisations | wc -w)
    if [ "$count" -gt 1 ]; then
        cd_post accuracy-study $realisations -o figures/$scene \
            --title "$scene: error against time, root mean square of $((count)) realisations"
    fi
done
