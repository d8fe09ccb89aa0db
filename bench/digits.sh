#!/usr/bin/env bash
# Sweeps and milliseconds that a residual takes: a table of scenes that flow and that rest, one thread.
#
#     bench/digits.sh [STEPS]
#
# Clouds of spheres and of rocks fall together; what they are when they meet and when they rest goes on for STEPS steps
# (10) at each tolerance. Unconverged steps, which stop after 20 000 sweeps, are counted. CD_BIN: where the programs are.
set -euo pipefail
steps=${1:-10}
top=$(cd "$(dirname "$0")/.." && pwd)
bin=${CD_BIN:-$top/target/release}
work=$(mktemp -d)
trap 'status=$?; [ $status = 0 ] || cat "$work/log" >&2; rm -rf "$work"' EXIT
echo "| scene | contacts with force | E | sweeps a step | ms a step, assembly and solve | unconverged |"
echo "|---|---|---|---|---|---|"

# name, example, number, time at which grains meet, time of rest
while read -r name example number meets rests; do
    "$bin/cd-pre" "$top/examples/$example/scene.ron" -o "$work/$name" --set "grains.1.number=$number" \
        --set "compute.end_time=$meets" > "$work/log" 2>&1
    "$bin/cd-solve" "$work/$name" > "$work/log" 2>&1
    "$bin/cd-pre" from-outbox "$work/$name" "$work/$name-flows" > "$work/log" 2>&1
    "$bin/cd-solve" "$work/$name" --resume --end-time "$rests" --quench=0.01 > "$work/log" 2>&1
    "$bin/cd-pre" from-outbox "$work/$name" "$work/$name-rests" > "$work/log" 2>&1
    for state in flows rests; do
        for tol in 1e-2 1e-4 1e-6 1e-8; do
            "$bin/cd-solve" "$work/$name-$state" --force --steps "$steps" --output-every "$steps" --threads 1 --quench=0 \
                --tol "$tol" > "$work/log" 2>&1
            awk -F, -v scene="$number $name, $state" -v tol="$tol" '
                FNR == 1 { for (i = 1; i <= NF; i++) at[FILENAME, $i] = i; next }
                FILENAME ~ /TIMER/ { time += 1000 * ($at[FILENAME, "assembly"] + $at[FILENAME, "solve"]); next }
                { n++; sweeps += $at[FILENAME, "sweeps"]; fails += 1 - $at[FILENAME, "converged"]; force = $at[FILENAME, "contacts_active"] }
                END { printf "| %s | %d | %s | %.1f | %.2f | %d |\n", scene, force, tol, sweeps / n, time / n, fails }
            ' "$work/$name-$state/TIMER.csv" "$work/$name-$state/OUTBOX/steps.csv"
        done
    done
done <<'SCENES'
spheres accretion 500 4000 14000
rocks accretion-polyhedra 250 6000 16000
SCENES
