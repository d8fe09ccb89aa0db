#!/bin/sh
# sweep.sh FOLDER SCENE: makes all runs of runs.txt with FOLDER/DATBOX and compares them. SCENE: name of its row in
# scenes.txt. CD_BIN: folder of the programs.
set -eu
folder=$1
read -r _ dt every from early without <<EOF
$(grep "^$2 " scenes.txt)
EOF
# Exit status 1 of cd-post: done, with something reported.
cases= groups= values=
while read -r name group value factor flags; do
    case "$name" in '#'* | '') continue ;; esac
    echo "$group" | grep -qxE "$without" && continue
    run=$folder/$(echo "$name" | tr / _)
    mkdir -p "$run"
    rm -rf "$run/DATBOX" && cp -r "$folder/DATBOX" "$run/DATBOX"
    # shellcheck disable=SC2086
    "$CD_BIN/cd-solve" --force --threads 1 --dt "$(awk "BEGIN { printf \"%.12g\", $dt * $factor }")" \
        --output-every "$(awk "BEGIN { printf \"%d\", $every / $factor }")" $flags "$run" 2> "$run/log" || { cat "$run/log"; exit 1; }
    "$CD_BIN/cd-post" --no-vtk --no-plots "$run" > "$run/post.log" 2>&1 || test $? -eq 1 || { cat "$run/post.log"; exit 1; }
    cases="$cases $run" groups="$groups,$group" values="$values,$(echo "$value" | sed 's/^-$/nan/')"
done < runs.txt
# shellcheck disable=SC2086
"$CD_BIN/cd-post" accuracy-study $cases -o "$folder/errors" --groups "${groups#,}" --values "${values#,}" --from "$from" --early "$early" \
    --title "$folder: error against time" > "$folder/table.txt" || test $? -eq 1
cat "$folder/table.txt"
