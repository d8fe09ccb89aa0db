#!/usr/bin/env bash
# Instructions of a fixed run, by function; the sum into instructions.csv. Other programs on the machine do not change it.
#
#     bench/callgrind.sh [CD_SOLVE]
#
# Needs valgrind, which has no AVX-512: the run uses AVX2. MACHINE and RESULTS: see bench/record.sh.
set -euo pipefail
cd "$(dirname "$0")/.."
solve=${1:-${CARGO_TARGET_DIR:-target}/release/cd-solve}
case=$(mktemp -d)
trap 'rm -rf "$case"' EXIT
cp -r tests/golden/rubble/expected/pre/DATBOX "$case/"
valgrind --tool=callgrind --callgrind-out-file="$case/out" "$solve" "$case" --steps 100 --threads 1 > "$case/log" 2>&1 ||
    { cat "$case/log" >&2; exit 1; }
awk '/Collected/ { print "12 spheres,12,100 steps," $NF ",instructions,1" }' "$case/log" | bench/record.sh instructions
callgrind_annotate "$case/out" | sed -n '/^Ir/,$p' | cut -c 1-120 | head -25
