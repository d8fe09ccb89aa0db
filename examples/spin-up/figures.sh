#!/bin/sh
# Figures and tables of the aggregates that are spun up.
#
#     CD_BIN=FOLDER ./figures.sh CASE...
#
# Reads: POSTPRO and OUTBOX of the cases.
# Writes: figures: a figure of each column against time, against-spin/ (semi-axes), slow/ and left/, all of the first seed; of all
# seeds limit.svg and limit.csv, the same in wide/, and secondaries.csv.
# shellcheck disable=SC2046,SC2086
set -eu
. ../cases.sh

# series_of CASE...: their tables.
series_of() {
    printf '%s/POSTPRO/series.csv\n' "$@"
}

# cohesions CASE...: labels, such as `100 N` for slow-f100-s1.
cohesions() {
    names 's/.*f\([0-9.]*\)-s[0-9]*$/\1 N/' "$@"
}

spun=$(cases 'f*-s1')
if [ "$spun" ]; then
    cd_post compare $spun -o figures --labels "$(cohesions $spun)" \
        --columns largest_a,largest_b,largest_c,nu,nu_sphere,pressure,pressure_sphere,tensile_fraction,largest_fraction,largest_spin,n_fragments,friction_angle
    cd_post compare $spun -o figures/against-spin --labels "$(cohesions $spun)" --against largest_spin \
        --columns largest_a,largest_b,largest_c
fi

# The limit of cohesive aggregates needs the angle of friction of that of the same seed without cohesion.
if [ "$(cases slow-f0-s1)" ]; then
    slow=$(cases 'slow-f*-s1')
    cd_post compare $slow -o figures/slow --labels "$(cohesions $slow)" --against largest_spin \
        --columns largest_a,largest_b,largest_c,friction_angle
    awk -v svg=figures/limit.svg -f limit.awk $(series_of $(cases 'slow-f*'))
    wide=$(cases 'wide-f*')
    if [ "$wide" ]; then
        mkdir -p figures/wide
        awk -v svg=figures/wide/limit.svg -f limit.awk $(series_of $(cases 'slow-f0-*') $wide)
    fi
fi

left=$(cases 'left-f*')
if [ "$left" ]; then
    shown=$(cases 'left-f*-s1')
    cd_post compare $shown -o figures/left --labels "$(cohesions $shown)" \
        --columns largest_fraction,bound_fraction,escaping_fraction,n_fragments
    last_states $left
    awk -v csv=figures/secondaries.csv -f secondaries.awk $(for case in $left; do echo $case/POSTPRO/state-*/fragments.csv; done)
fi
