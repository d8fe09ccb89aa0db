#!/usr/bin/env bash
# What a scene of spheres pays for polyhedra, self-gravity, cohesion and resistance to rolling, which it has not: the program
# against one that is built without them. Seconds a step of both in turn, instructions a step counted by valgrind, and
# whether the results are the same to the last bit.
#
#     bench/absence.sh CASE STEPS [OPTIONS OF cd-solve]
#
# CASE holds DATBOX of spheres and plates. FULL and BARE name programs that are already built; TURNS another number of runs.
set -euo pipefail
from=$1 steps=$2
shift 2
root=$(cd "$(dirname "$0")/.." && pwd)
if [ -z "${FULL:-}${BARE:-}" ]; then
    target=${CARGO_TARGET_DIR:-$root/target}
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" -p cd-solve --bin cd-solve
    cargo build --quiet --release --manifest-path "$root/Cargo.toml" -p cd-solve --bin cd-solve --features bare --target-dir "$target/bare"
    FULL=$target/release/cd-solve BARE=$target/bare/release/cd-solve
fi
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
for name in full bare; do
    mkdir "$scratch/$name"
    cp -r "$from/DATBOX" "$scratch/$name/"
done

run() { # run NAME PROGRAM STEPS [BEFORE...]: runs it on its copy of the case
    local name=$1 program=$2 count=$3
    shift 3
    "$@" "$program" "$scratch/$name" --force --threads 1 --steps "$count" --output-every "$count" "${options[@]}" \
        > "$scratch/log" 2>&1 || { cat "$scratch/log" >&2; exit 1; }
}
options=("$@")

seconds() { # of the last run of NAME, without writing
    awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) if ($i == "writing") writing = i; next }
        { for (i = 2; i <= NF; i++) if (i != writing) sum += $i } END { print sum }' "$scratch/$1/TIMER.csv"
}

for turn in $(seq "${TURNS:-7}"); do
    run full "$FULL" "$steps"
    run bare "$BARE" "$steps"
    echo "$(seconds full) $(seconds bare)"
done > "$scratch/times"
middle() { awk "{ print $1 }" "$scratch/times" | sort -g | awk '{ x[NR] = $1 } END { print x[int((NR + 1) / 2)], x[1], x[NR] }'; }
echo "time: $(middle "1000 * \$1 / $steps" | cut -d ' ' -f 1) ms a step, bare $(middle "1000 * \$2 / $steps" | cut -d ' ' -f 1);" \
    "median, least and largest ratio of two in turn: $(middle '$1 / $2')"
cmp "$scratch/full/OUTBOX/steps.csv" "$scratch/bare/OUTBOX/steps.csv" && echo "results: the same bits in steps.csv"

counted() { # counted NAME PROGRAM: instructions of ten steps
    local few many
    run "$1" "$2" 5 valgrind --tool=callgrind --callgrind-out-file=/dev/null
    few=$(awk '/Collected/ { print $NF }' "$scratch/log")
    run "$1" "$2" 15 valgrind --tool=callgrind --callgrind-out-file=/dev/null
    many=$(awk '/Collected/ { print $NF }' "$scratch/log")
    echo $(((many - few) / 10))
}

full=$(counted full "$FULL") bare=$(counted bare "$BARE")
awk -v full="$full" -v bare="$bare" 'BEGIN { printf "instructions: %d a step, bare %d; ratio %.4f\n", full, bare, full / bare }'
