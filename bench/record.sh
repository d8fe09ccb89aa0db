#!/usr/bin/env bash
# Adds measurements to bench/results/MACHINE/NAME.csv, from which docs/explanation/performance.md is drawn.
#
#     ... | bench/record.sh NAME
#
# Reads lines scene,size,quantity,value,unit,threads[,program], without commas inside of a field; `program` is cd-solve of
# this version if absent. Adds the commit, and prints the lines with it. Lines of the file that have the same scene, size,
# threads and program are replaced. MACHINE: see bench/machine.sh; RESULTS: another folder than bench/results.
set -euo pipefail
bench=$(cd "$(dirname "$0")" && pwd)
folder=${RESULTS:-$bench/results}/$("$bench/machine.sh")
file=$folder/$1.csv
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$bench/../Cargo.toml")
commit=$(git -C "$bench" describe --always --dirty --exclude '*' 2> /dev/null || true)
mkdir -p "$folder"
[ -f "$folder/machine.txt" ] || "$bench/machine.sh" --describe > "$folder/machine.txt"

trap 'rm -f "$file.new" "$file.part"' EXIT
awk -F, -v OFS=, -v program="cd-solve $version" -v commit="$commit" '
    NF < 6 || NF > 7 { print "bench/record.sh: line of " NF " fields: " $0 "; expected 6 or 7" > "/dev/stderr"; exit 1 }
    { print $1, $2, $3, $4, $5, $6, NF == 7 ? $7 : program, commit }' > "$file.new"
cat "$file.new"
[ -f "$file" ] || echo "scene,size,quantity,value,unit,threads,program,commit" > "$file"
awk -F, '
    { key = $1 "," $2 "," $6 "," $7 }
    FILENAME ~ /new$/ { lines[key] = lines[key] $0 "\n"; if (!(key in seen)) { seen[key]; order[++groups] = key } next }
    !(key in seen) { print; next }
    { printf "%s", lines[key]; lines[key] = "" }
    END { for (k = 1; k <= groups; k++) printf "%s", lines[order[k]] }
' "$file.new" "$file" > "$file.part"
mv "$file.part" "$file"
