#!/bin/bash
# Submits the cases of a study to Slurm: one job array for the cases with a scene of their own, then one for those that start from
# these, and so on; each array waits until the one before has succeeded.
#
#     ./submit.sh study.csv [OPTIONS OF sbatch]      such as --partition=short --time=01:00:00
#
# Reads: study.csv, written by cd-pre study.
# Writes: slurm-JOB_TASK.out in this folder, one for each case, besides the files of case.sbatch.
set -eu
[ $# -ge 1 ] || { echo "usage: ./submit.sh study.csv [OPTIONS OF sbatch]" >&2; exit 2; }
table=$1
shift
[ -r "$table" ] || { echo "submit.sh: $table: cannot be read; expected the table that cd-pre study writes" >&2; exit 2; }

# For each level the numbers of its rows: a case is one level after the case that it starts from. Cases that start from a folder
# outside of the study are at the first level.
levels=$(awk -F, '
    NR > 1 { from[$1] = $2; name[NR - 1] = $1 }
    function level(of) { return (from[of] in from) ? 1 + level(from[of]) : 0 }
    END {
        for (row = 1; row < NR; row++) {
            at = level(name[row])
            if (rows[at] != "") rows[at] = rows[at] ","
            rows[at] = rows[at] row
        }
        for (at = 0; at in rows; at++) print rows[at]
    }' "$table")
[ -n "$levels" ] || { echo "submit.sh: $table: no cases; expected the table that cd-pre study writes" >&2; exit 2; }

after=
for rows in $levels; do
    job=$(sbatch --parsable --array="$rows" ${after:+--dependency=afterok:"$after" --kill-on-invalid-dep=yes} "$@" case.sbatch "$table")
    after=${job%%;*}
    echo "job $after: rows $rows of $table"
done
