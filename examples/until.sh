#!/bin/sh
# Runs more and more seeds of a study, until the mean of a quantity is known in each parameter set: until half the width of
# its 95 % confidence interval is at most ERROR times the mean. Runs that are there are kept.
#
#     make until QUANTITY=Z ERROR=0.01 MAX_SEEDS=50        in the folder of an example; it calls
#     until.sh study.ron QUANTITY ERROR MAX_SEEDS
#
# Reads: the study, whose groups have seeds.
# Writes: the cases, and the tables of `cd-post study` in the folder `replicates`.
# Exit status 1: MAX_SEEDS are not enough.
set -eu
[ $# = 4 ] || { echo "usage: until.sh study.ron QUANTITY ERROR MAX_SEEDS" >&2; exit 2; }
study=$1 quantity=$2 error=$3 max=$4
name=${study%.ron}
# Before the first run, which may be long.
awk -v x="$error" 'BEGIN { exit !(x ~ /^[0-9]*\.?[0-9]+([eE][-+]?[0-9]+)?$/ && x > 0) }' ||
    { echo "until.sh: ERROR: $error; expected a number > 0, such as 0.01" >&2; exit 2; }
case $max in
'' | *[!0-9]* | 0* | 1 | ???????*) echo "until.sh: MAX_SEEDS: $max; expected an integer of 2 to 999999" >&2; exit 2 ;;
esac
case $quantity in
'' | *[!A-Za-z0-9_]*) echo "until.sh: QUANTITY: $quantity; expected one quantity of cd-post study, such as Z" >&2; exit 2 ;;
esac
# The deviation of fewer runs says little.
seeds=3
while :; do
    [ "$seeds" -le "$max" ] || seeds=$max
    rm -f "$name.mk" # as STUDY_FLAGS change
    $MAKE --no-print-directory STUDY_FLAGS="--replicates $seeds" post
    "$CD_BIN/cd-post" study "$name.csv" -o replicates --error "$error" || test $? = 1
    # Most replicates that a parameter set needs; `none` where the mean is 0 or not known.
    needed=$(awk -F, -v quantity="$quantity" '
        NR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }
        $column["quantity"] == quantity { rows++; n = $column["needed"]; if (n == "") none = 1; if (n + 0 > most) most = n + 0 }
        END { print rows == 0 ? "absent" : none ? "none" : most }' replicates/means.csv)
    case $needed in
    absent) echo "until.sh: QUANTITY: $quantity: is not in replicates/means.csv; expected a quantity of cd-post study" >&2; exit 2 ;;
    none) next=$((2 * seeds)) ;;
    *)
        if [ "$needed" -le "$seeds" ]; then
            echo "until.sh: $quantity is known to $error with $seeds seeds; means in replicates/means.csv"
            exit 0
        fi
        # No more than twice as many at once: the deviation of a few runs is an estimate.
        next=$((needed < 2 * seeds ? needed : 2 * seeds))
        ;;
    esac
    if [ "$seeds" -ge "$max" ]; then
        echo "until.sh: $quantity is not known to $error with $seeds seeds: $needed are needed; expected a larger MAX_SEEDS or ERROR" >&2
        exit 1
    fi
    seeds=$next
done
