#!/usr/bin/env bash
# Milliseconds of a step by stage, from a state on disk, on one thread and on two; into step.csv.
#
#     bench/step.sh CASE STEPS [OPTIONS OF cd-solve]
#
# CASE holds a DATBOX of cd-pre or LMGC90; its name, or SCENE, is that of the rows. CD_SOLVE names another program, THREADS
# other numbers of threads, TURNS a number of alternating runs. MACHINE and RESULTS: see bench/record.sh.
set -euo pipefail
from=$1 steps=$2
shift 2
bench=$(cd "$(dirname "$0")" && pwd)
solve=${CD_SOLVE:-${CARGO_TARGET_DIR:-$bench/../target}/release/cd-solve}
size=$(grep -c '^ *RBDY3' "$from/DATBOX/BODIES.DAT")
case=$(mktemp -d)
trap 'rm -rf "$case"' EXIT
cp -r "$from/DATBOX" "$case/"
for _ in $(seq "${TURNS:-1}"); do
    for threads in ${THREADS:-1 2}; do
        "$solve" "$case" --force --steps "$steps" --output-every "$steps" --threads "$threads" "$@" > "$case/log" 2>&1 ||
            { cat "$case/log" >&2; exit 1; }
        awk -F, -v scene="${SCENE:-$(basename "$from")}" -v size="$size" -v threads="$threads" -v unit="ms a step" \
            -f "$bench/stages.awk" "$case/TIMER.csv" "$case/OUTBOX/steps.csv"
    done
done > "$case/rows"
"$bench/record.sh" step < "$case/rows"
