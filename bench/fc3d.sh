#!/usr/bin/env bash
# Milliseconds and sweeps of stored contact problems by solver, on one thread; into fc3d.csv.
#
#     cargo build --release -p cd-solve --example fc3d
#     bench/fc3d.sh [FILE.fc3d...]
#
# By default the problems of solver/tests/fc3d, to a residual of 1e-8; the least of five runs, without reading. A solver that
# does not reach the residual in 3 s has no row. SOLVERS: other solvers. MACHINE and RESULTS: see bench/record.sh.
set -euo pipefail
bench=$(cd "$(dirname "$0")" && pwd)
[ $# -gt 0 ] || set -- "$bench"/../solver/tests/fc3d/*.fc3d
program=${CARGO_TARGET_DIR:-$bench/../target}/release/examples/fc3d
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for file in "$@"; do
    for solver in ${SOLVERS:-auto nlgs-anderson prox-newton admm interior-point}; do
        for _ in 1 2 3 4 5; do
            "$program" "$file" --solver "$solver" --max-time 3 -o "$work/solution" || break
        done > "$work/runs" 2> /dev/null
        awk -v scene="$(basename "$file" .fc3d)" -v solver="$solver" '
            NR == 1 || $3 < least { least = $3 }
            { size = $1; sweeps = $2 }
            END {
                if (NR < 5) exit
                printf "%s,%d,%s,%.2g,ms,1\n%s,%d,%s sweeps,%d,,1\n", scene, size, solver, 1000 * least, scene, size, solver, sweeps
            }' "$work/runs"
    done
done > "$work/rows"
"$bench/record.sh" fc3d < "$work/rows"
