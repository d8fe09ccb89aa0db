#!/usr/bin/env bash
# Sweeps and milliseconds that a residual costs, for scenes that flow and that rest, on one thread; into digits.csv.
#
#     bench/digits.sh [STEPS]
#
# Clouds of spheres and of rocks collapse; from the states during the collapse and at rest, STEPS steps (10) are made at
# each tolerance. Unconverged steps, which stop after 20 000 sweeps, are counted. CD_BIN: folder of the programs. MACHINE
# and RESULTS: see bench/record.sh.
set -euo pipefail
steps=${1:-10}
bench=$(cd "$(dirname "$0")" && pwd)
bin=${CD_BIN:-${CARGO_TARGET_DIR:-$bench/../target}/release}
work=$(mktemp -d)
trap 'status=$?; [ $status = 0 ] || cat "$work/log" >&2; rm -rf "$work"' EXIT

# name, example, number, time at which grains meet, time of rest
while read -r name example number meets rests; do
    "$bin/cd-pre" "$bench/../examples/$example/scene.ron" -o "$work/$name" --set "grains.1.number=$number" \
        --set "compute.end_time=$meets" > "$work/log" 2>&1
    "$bin/cd-solve" "$work/$name" > "$work/log" 2>&1
    "$bin/cd-pre" from-outbox "$work/$name" "$work/$name-flow" > "$work/log" 2>&1
    "$bin/cd-solve" "$work/$name" --resume --end-time "$rests" --quench=0.01 > "$work/log" 2>&1
    "$bin/cd-pre" from-outbox "$work/$name" "$work/$name-rest" > "$work/log" 2>&1
    for state in flow rest; do
        for tol in 1e-2 1e-4 1e-6 1e-8; do
            "$bin/cd-solve" "$work/$name-$state" --force --steps "$steps" --output-every "$steps" --threads 1 --quench=0 \
                --tol "$tol" > "$work/log" 2>&1
            awk -F, -v scene="$name $state" -v size="$number" -v tol="$tol" '
                FNR == 1 { for (i = 1; i <= NF; i++) at[FILENAME, $i] = i; next }
                FILENAME ~ /TIMER/ { time += 1000 * ($at[FILENAME, "assembly"] + $at[FILENAME, "solve"]); next }
                { n++; sweeps += $at[FILENAME, "sweeps"]; fails += 1 - $at[FILENAME, "converged"]; force = $at[FILENAME, "contacts_active"] }
                function row(quantity, value, unit) { printf "%s at %s,%d,%s,%s,%s,1\n", scene, tol, size, quantity, value, unit }
                END {
                    row("contacts with force", force, "")
                    row("sweeps a step", sprintf("%.1f", sweeps / n), "")
                    row("assembly and solve", sprintf("%.2f", time / n), "ms a step")
                    row("unconverged steps", fails, "")
                }
            ' "$work/$name-$state/TIMER.csv" "$work/$name-$state/OUTBOX/steps.csv"
        done
    done
done > "$work/rows" <<'SCENES'
spheres accretion 500 4000 14000
rocks accretion-polyhedra 250 6000 16000
SCENES
"$bench/record.sh" digits < "$work/rows"
