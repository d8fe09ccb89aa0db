#!/usr/bin/env bash
# Milliseconds of a step by room, from a state on disk, on one thread and on two.
#
#     bench/step.sh CASE STEPS [OPTIONS OF cd-solve]
#
# CASE holds DATBOX, ours or LMGC90's. CD_SOLVE names another program; THREADS other numbers of threads.
set -euo pipefail
from=$1 steps=$2
shift 2
solve=${CD_SOLVE:-$(dirname "$0")/../target/release/cd-solve}
case=$(mktemp -d)
trap 'rm -rf "$case"' EXIT
cp -r "$from/DATBOX" "$case/"
for threads in ${THREADS:-1 2}; do
    "$solve" "$case" --force --steps "$steps" --output-every "$steps" --threads "$threads" "$@" > "$case/log" 2>&1 ||
        { cat "$case/log" >&2; exit 1; }
    awk -F, -v threads="$threads" '
        FNR == 1 { for (i = 1; i <= NF; i++) name[i] = $i; next }
        FILENAME ~ /TIMER/ { for (i = 2; i <= NF; i++) room[name[i]] += 1000 * $i; next }
        { n++; for (i = 1; i <= NF; i++) sum[name[i]] += $i; last = $0 }
        END {
            printf "%s threads:", threads
            for (i in room) if (i != "writing") { total += room[i]; printf " %s %.2f,", i, room[i] / n }
            printf " together %.2f ms a step; %.1f sweeps, %d unconverged steps\n", total / n, sum["sweeps"] / n, n - sum["converged"]
        }' "$case/TIMER.csv" "$case/OUTBOX/steps.csv"
done
