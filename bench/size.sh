#!/usr/bin/env bash
# Seconds, memory and files of the three programs for scenes of growing size, and the time of a step by stage; into
# size.csv, footprint.csv and growth.csv.
#
#     bench/size.sh [SPHERES...]
#
# Clouds of so many spheres (10 000, 100 000) and monoliths of a hundredth as many fragments: all of cd-pre, cd-solve with
# two steps, and cd-post with its two snapshots. Memory and files do not depend on the load of the machine. With 1 000 000
# spheres it needs 4 GB of memory, 3 GB in the temporary folder and, on two cores, some three minutes. CD_BIN: folder of the
# programs. MACHINE and RESULTS: see bench/record.sh.
set -euo pipefail
[ $# -gt 0 ] || set -- 10000 100000
bench=$(cd "$(dirname "$0")" && pwd)
bin=${CD_BIN:-${CARGO_TARGET_DIR:-$bench/../target}/release}
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
cat > "$work/measure.py" << 'PYTHON'
# Seconds and peak of memory, in bytes, of a command.
import resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=sys.stderr)
seconds = time.perf_counter() - start
peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
print(f"{seconds:.2g}" if seconds < 99.5 else f"{seconds:.0f}", peak)
PYTHON

row() { # row FILE SCENE NUMBER QUANTITY VALUE UNIT: a line of FILE
    echo "$2,$3,$4,$5,$6,$threads" >> "$work/$1"
}

per_body() { # per_body QUANTITY BYTES
    row footprint "$name" "$number" "$1" \
        "$(awk -v x="$2" -v n="$number" 'BEGIN { x /= 1000 * n; printf (x < 99.5 ? "%.2g" : "%.0f"), x }')" "kB per body"
}

measured() { # measured PROGRAM ARGUMENTS...: its seconds and memory as lines
    local program=$1 found
    shift
    found=$(python3 "$work/measure.py" "$bin/$program" "$@" 2> "$work/log")
    row size "$name" "$number" "$program" "${found% *}" s
    per_body "memory of $program" "${found#* }"
}

bytes() { # bytes PATHS...: their sum
    find "$@" -type f -exec cat {} + | wc -c
}

threads=$(getconf _NPROCESSORS_ONLN)
scene() { # scene NAME SCENE NUMBER
    name=$1 number=$3
    measured cd-pre "$2" -o "$work/case" --set "grains.1.number=$number"
    measured cd-solve "$work/case" --steps 2
    row size "$name" "$number" "two steps" \
        "$(awk -F, 'NR > 1 { for (i = 2; i <= NF; i++) sum += $i } END { printf (sum < 99.5 ? "%.2g" : "%.0f"), sum }' "$work/case/TIMER.csv")" s
    awk -F, -v n="$3" 'NR == 1 { for (i = 2; i <= NF; i++) stage[i] = $i }
        NR == 3 { for (i = 2; i < NF; i++) printf "%s,%.2g\n", stage[i], 1e9 * $i / n }' "$work/case/TIMER.csv" |
        while IFS=, read -r stage time; do row growth "$name" "$number" "$stage" "$time" "ns per body and step"; done
    measured cd-post "$work/case"
    per_body DATBOX "$(bytes "$work/case/DATBOX")"
    per_body snapshot "$(bytes "$work/case/OUTBOX/"snapshot-*2.npz)"
    per_body "DISPLAY of a snapshot" "$(($(bytes "$work/case/DISPLAY") / 2))"
    rm -r "$work/case"
}

for number in "$@"; do
    scene spheres "$bench/../examples/accretion/scene.ron" "$number"
    scene fragments "$work/monolith.ron" $((number / 100))
done
for file in size footprint growth; do "$bench/record.sh" "$file" < "$work/$file"; done
