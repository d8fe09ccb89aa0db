#!/usr/bin/env bash
# Cost of the models that a scene of spheres does not have (polyhedra, self-gravity, cohesion, rolling resistance); into
# absence.csv.
#
#     bench/absence.sh CASE STEPS [OPTIONS OF cd-solve]
#
# Compares the program with one that is built without these models: milliseconds a step in alternating runs, instructions a
# step counted by valgrind, and whether results are the same to the last bit. CASE holds a DATBOX of spheres and plates; its
# name, or SCENE, is that of the rows. FULL and BARE name programs that are already built; TURNS another number of runs.
# MACHINE and RESULTS: see bench/record.sh.
set -euo pipefail
from=$1 steps=$2
shift 2
bench=$(cd "$(dirname "$0")" && pwd)
root=$bench/..
scene=${SCENE:-$(basename "$from")} size=$(grep -c '^ *RBDY3' "$from/DATBOX/BODIES.DAT")
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
row() { # row QUANTITY VALUE UNIT: a line of absence.csv
    echo "$scene,$size,$1,$2,$3,1" >> "$scratch/rows"
}

median() { # median EXPRESSION: of the alternating runs
    awk "{ print $1 }" "$scratch/times" | sort -g | awk '{ x[NR] = $1 } END { printf "%.4g", x[int((NR + 1) / 2)] }'
}

row "the program" "$(median "1000 * \$1 / $steps")" "ms a step"
row "without the models" "$(median "1000 * \$2 / $steps")" "ms a step"
row "ratio of times" "$(median '$1 / $2')" ""
cmp "$scratch/full/OUTBOX/steps.csv" "$scratch/bare/OUTBOX/steps.csv"

counted() { # counted NAME PROGRAM: instructions of ten steps
    local few many
    run "$1" "$2" 5 valgrind --tool=callgrind --callgrind-out-file=/dev/null
    few=$(awk '/Collected/ { print $NF }' "$scratch/log")
    run "$1" "$2" 15 valgrind --tool=callgrind --callgrind-out-file=/dev/null
    many=$(awk '/Collected/ { print $NF }' "$scratch/log")
    echo $(((many - few) / 10))
}

full=$(counted full "$FULL") bare=$(counted bare "$BARE")
row "ratio of instructions" "$(awk -v full="$full" -v bare="$bare" 'BEGIN { printf "%.4f", full / bare }')" ""
row "instructions a step" "$full" ""
"$bench/record.sh" absence < "$scratch/rows"
