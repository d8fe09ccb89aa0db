#!/usr/bin/env bash
# Seconds that the three programs take for scenes of growing size: a table.
#
#     bench/size.sh [SPHERES...]
#
# Clouds of so many spheres (10 000, 100 000) and monoliths of a hundredth as many fragments: all of cd-pre, cd-solve with
# two steps, of which the steps themselves are in brackets, and cd-post with its two snapshots. CD_BIN: where the
# programs are.
set -euo pipefail
[ $# -gt 0 ] || set -- 10000 100000
top=$(cd "$(dirname "$0")/.." && pwd)
bin=${CD_BIN:-$top/target/release}
work=$(mktemp -d)
trap 'status=$?; [ $status = 0 ] || cat "$work/log" >&2; rm -rf "$work"' EXIT
cat > "$work/monolith.ron" << 'SCENE'
(
    materials: [(name: "ROCKx", density: 2700.0)],
    laws: [(name: "rough", kind: IQS_CLB(friction: 0.7))],
    contacts: [(between: ("BLUEx", "BLUEx"), law: "rough")],
    grains: [(material: "ROCKx", colour: "BLUEx", number: 1, placement: Fragments(envelope: Ball(radius: 100.0)))],
    compute: (dt: 1.0, self_gravity: true),
)
SCENE

timed() { # timed COMMAND...: its seconds
    local start=$EPOCHREALTIME
    "$@" > "$work/log" 2>&1
    echo "$start $EPOCHREALTIME" | awk '{ printf "%.1f", $2 - $1 }'
}

row() { # row NAME SCENE NUMBER
    local pre solve steps post
    pre=$(timed "$bin/cd-pre" "$2" -o "$work/case" --set "grains.1.number=$3")
    solve=$(timed "$bin/cd-solve" "$work/case" --steps 2)
    steps=$(awk -F, 'NR > 1 { for (i = 2; i <= NF; i++) sum += $i } END { printf "%.1f", sum }' "$work/case/TIMER.csv")
    post=$(timed "$bin/cd-post" "$work/case")
    rm -r "$work/case"
    echo "| $3 $1 | $pre | $solve ($steps) | $post |"
}

echo "| scene | cd-pre, s | cd-solve, s | cd-post, s |"
echo "|---|---|---|---|"
for number in "$@"; do
    row spheres "$top/examples/accretion/scene.ron" "$number"
    row fragments "$work/monolith.ron" $((number / 100))
done
