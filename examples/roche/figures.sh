#!/bin/sh
# Figures and table of the fly-bys.
#
#     CD_BIN=FOLDER ./figures.sh CASE...
#
# Reads: DATBOX, OUTBOX and POSTPRO of the cases.
# Writes: figures: a figure of each column by the distance of the pericentre, cohesion/ with and without cohesion, outcome.csv.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh

# compare_cases FOLDER CASE...
compare_cases() {
    folder=$1
    shift
    cd_post compare "$@" -o "$folder" --labels "$(names '' "$@")" \
        --columns largest_fraction,bound_fraction,n_fragments,largest_a,largest_b,largest_c,largest_spin
}

cohesionless=$(cases 'q*')
cohesive=$(cases 'cohesive*')
if [ "$cohesionless" ]; then
    compare_cases figures $cohesionless
fi
if [ "$cohesive" ]; then
    # cohesive1.1 with q1.1
    same_distance=$(for case in $cohesive; do cases "q${case#cohesive}"; done)
    compare_cases figures/cohesion $same_distance $cohesive
fi
flybys=$(cases '[!a]*') # all but `accreted`
last_states $flybys
if [ "$flybys" ]; then
    mkdir -p figures
    awk -v csv=figures/outcome.csv -f ../datbox.awk -f outcome.awk \
        $(for case in $flybys; do echo $case/POSTPRO/series.csv $case/POSTPRO/state-*/fragments.csv; done)
fi
