#!/usr/bin/env bash
# Nanoseconds of the inner loops, by `cargo bench`; into sweep.csv or polyhedra.csv.
#
#     bench/kernels.sh sweep [FILTER]          per contact and sweep, on packings of touching spheres and cuboids
#     bench/kernels.sh polyhedra [FILTER]      per pair, direction and manifold
#
# FILTER: only benches whose name contains it. The fastest of the samples. MACHINE and RESULTS: see bench/record.sh.
set -euo pipefail
bench=$(cd "$(dirname "$0")" && pwd)
name=$1
shift
cargo bench --quiet --manifest-path "$bench/../Cargo.toml" -p cd-solve --bench "$name" -- "$@" |
    LC_ALL=C awk -f "$bench/kernels.awk" | "$bench/record.sh" "$name"
