#!/usr/bin/env bash
# Microseconds of self-gravity per body and evaluation, for random points in a ball; into gravity.csv.
#
#     cargo build --release -p cd-solve --example gravity
#     bench/gravity.sh [BODIES...]
#
# BODIES: 8000 and 100 000 by default. One thread at four errors and by the direct sum (up to 10 000 bodies), and two
# threads at 1e-3; medians of eleven evaluations. MACHINE and RESULTS: see bench/record.sh.
set -euo pipefail
[ $# -gt 0 ] || set -- 8000 100000
bench=$(cd "$(dirname "$0")" && pwd)
program=${CARGO_TARGET_DIR:-$bench/../target}/release/examples/gravity
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

row() { # row BODIES THREADS QUANTITY OPTIONS...: a line with the time of one evaluation
    local size=$1 threads=$2 quantity=$3
    shift 3
    "$program" "$work/in.csv" --threads "$threads" --repeat 11 -o "$work/out.csv" "$@" |
        awk -v size="$size" -v threads="$threads" -v quantity="$quantity" '{ printf "ball,%d,%s,%.2g,us per body,%d\n", size, quantity, $3, threads }'
}

for size in "$@"; do
    awk -v n="$size" 'BEGIN {
        srand(1); print "x,y,z,m"
        while (n > 0) {
            x = 2 * rand() - 1; y = 2 * rand() - 1; z = 2 * rand() - 1
            if (x * x + y * y + z * z < 1) { printf "%.9g,%.9g,%.9g,1\n", x, y, z; n-- }
        }
    }' > "$work/in.csv"
    for error in 1e-2 1e-3 1e-4 1e-5; do row "$size" 1 "$error" --method fmm --error "$error"; done
    [ "$size" -gt 10000 ] || row "$size" 1 direct --method direct
    row "$size" 2 1e-3 --method fmm --error 1e-3
done > "$work/rows"
"$bench/record.sh" gravity < "$work/rows"
