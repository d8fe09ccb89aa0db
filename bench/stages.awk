# Time by stage of a run, for bench/record.sh:
#   awk -F, -v scene=NAME -v size=BODIES -v threads=N -v unit="ms a step" -f bench/stages.awk TIMER.csv OUTBOX/steps.csv
# Reads: TIMER.csv and OUTBOX/steps.csv of a run with `log_every` 1. Unit: "ms a step", without writing, or "s" of the run.
# Writes: lines scene,size,quantity,value,unit,threads to the standard output: stages, all, sweeps, time per body and step.

function row(quantity, format, value, unit) { printf "%s,%s,%s," format ",%s,%s\n", scene, size, quantity, value, unit, threads }

FNR == 1 { file++; fields = NF; for (k = 1; k <= NF; k++) { name[k] = $k; column[$k] = k } next }
file == 1 { for (k = 2; k <= fields; k++) { if (!(name[k] in seconds)) stage[++stages] = name[k]; seconds[name[k]] += $k } next }
{ steps++; sweeps += $column["sweeps"]; failed += !$column["converged"] }
END {
    whole = unit == "s"
    for (k = 1; k <= stages; k++) {
        if (stage[k] == "writing" && !whole) continue
        all += seconds[stage[k]]
        row(stage[k], "%.3g", whole ? seconds[stage[k]] : 1000 * seconds[stage[k]] / steps, unit)
    }
    row("all", "%.3g", whole ? all : 1000 * all / steps, unit)
    if (size > 0) row("time per body", "%.2g", 1e6 * all / steps / size, "us a step")
    if (whole) row("steps", "%d", steps, "")
    row("sweeps a step", "%.3g", sweeps / steps, "")
    row("unconverged steps", "%d", failed, "")
}
