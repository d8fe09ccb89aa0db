#!/usr/bin/env bash
# Seconds of whole runs by stage, and size of the last snapshot: clouds of an example, from their collapse to rest; into runs.csv.
#
#     bench/run.sh [EXAMPLE [GRAINS...]]
#
# EXAMPLE: accretion (spheres, the default) or accretion-polyhedra; GRAINS: numbers of grains, by default 1000. THREADS: the
# numbers of threads, by default 1 and 2. CD_BIN: folder of the programs. MACHINE and RESULTS: see bench/record.sh.
set -euo pipefail
example=${1:-accretion}
[ $# -gt 1 ] || set -- "$example" 1000
shift
bench=$(cd "$(dirname "$0")" && pwd)
bin=${CD_BIN:-${CARGO_TARGET_DIR:-$bench/../target}/release}
work=$(mktemp -d)
trap 'status=$?; [ $status = 0 ] || cat "$work/log" >&2; rm -rf "$work"' EXIT
for size in "$@"; do
    "$bin/cd-pre" "$bench/../examples/$example/scene.ron" -o "$work/case" --set "grains.1.number=$size" > "$work/log" 2>&1
    for threads in ${THREADS:-1 2}; do
        "$bin/cd-solve" "$work/case" --force --threads "$threads" > "$work/log" 2>&1
        awk -F, -v scene="$example" -v size="$size" -v threads="$threads" -v unit=s -f "$bench/stages.awk" \
            "$work/case/TIMER.csv" "$work/case/OUTBOX/steps.csv"
        find "$work/case/OUTBOX" -name 'snapshot-*' | sort | tail -n 1 | xargs cat | wc -c |
            awk -v scene="$example" -v size="$size" -v threads="$threads" \
                '{ printf "%s,%d,last snapshot,%.2g,kB per body,%d\n", scene, size, $1 / 1000 / size, threads }'
    done
    rm -r "$work/case"
done > "$work/rows"
"$bench/record.sh" runs < "$work/rows"
