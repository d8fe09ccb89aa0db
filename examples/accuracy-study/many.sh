#!/bin/sh
# Means of the runs of many clouds and heaps, and their times.
#
#     CD_BIN=FOLDER ./many.sh CASE...
#
# Reads: DATBOX, OUTBOX, POSTPRO and TIMER.csv of the cases many/SCENE-SEED/SETTINGS.
# Writes: many/SCENE-SEED/runs.csv: means of each run; times.csv: its seconds in all stages except writing.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh

for folder in $(printf '%s\n' $all_cases | sed 's/\/[^/]*$//' | sort -u); do
    runs=$(cases "$folder/*")
    # Means over the last fifth.
    end=$(option "$(echo $runs | cut -d ' ' -f 1)" end_time)
    cd_post study $runs -o $folder --from "$(calculation "0.8 * $end")" > $folder/study.log
    echo run,seconds > $folder/times.csv
    for run in $runs; do
        # The first column is the step, the last is writing.
        awk -F , -v OFS=, -v run="${run##*/}" 'NR > 1 { for (k = 2; k < NF; k++) sum += $k } END { print run, sum }' $run/TIMER.csv
    done >> $folder/times.csv
done
