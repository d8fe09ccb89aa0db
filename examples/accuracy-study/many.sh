#!/bin/sh
# many.sh FOLDER SCENE: runs with FOLDER/DATBOX for the presets but `reference`, for `standard` with a looser tolerance, and
# for LMGC90's parameters; FOLDER/runs.csv has a row of means each, FOLDER/times.csv the seconds of all stages except
# writing. The runs themselves are removed. SCENE and CD_BIN as in sweep.sh.
set -eu
folder=$1
read -r _ dt every from _ <<EOF
$(grep "^$2 " scenes.txt)
EOF
cases=
# Exit status 1 of cd-post: done, with something reported.
mkdir -p "$folder"
echo run,seconds > "$folder/times.csv"
for name in draft standard loose fine lmgc90; do
    case $name in loose) of=standard other='--tol 1e-2' ;; *) of=$name other= ;; esac
    flags="$(awk -v name="$of" '$1 == name { for (k = 5; k <= NF; k++) print $k }' runs.txt) $other"
    run=$folder/$name
    mkdir -p "$run"
    rm -rf "$run/DATBOX" && cp -r "$folder/DATBOX" "$run/DATBOX"
    # shellcheck disable=SC2086
    "$CD_BIN/cd-solve" --force --threads 1 --dt "$dt" --output-every "$every" $flags "$run" > "$run/log" 2>&1 || { cat "$run/log"; exit 1; }
    # Of the columns the first is the step, the last writing.
    awk -F, -v OFS=, -v run="$name" 'NR > 1 { for (k = 2; k < NF; k++) sum += $k } END { print run, sum }' "$run/TIMER.csv" >> "$folder/times.csv"
    "$CD_BIN/cd-post" --no-vtk --no-plots "$run" > "$run/post.log" 2>&1 || test $? -eq 1 || { cat "$run/post.log"; exit 1; }
    cases="$cases $run"
done
# shellcheck disable=SC2086
"$CD_BIN/cd-post" study $cases -o "$folder" --from "$from" > "$folder/study.log" 2>&1 || test $? -eq 1 || { cat "$folder/study.log"; exit 1; }
# shellcheck disable=SC2086
rm -r $cases
