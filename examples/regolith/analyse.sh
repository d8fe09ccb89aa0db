#!/bin/sh
# Follows the bodies of a case that carry loads, and analyses its last state.
#
#     CD_BIN=FOLDER ./analyse.sh CASE
#
# Reads: DATBOX and OUTBOX of the case.
# Writes: CASE/POSTPRO/state-NNNNNN; for a strike lander/, the track of the lander under a name that does not depend on the
# number of grains in the bed; for a bed track-N/ of each of its plates.
set -eu
. ../cases.sh
case=$1

rm -rf "$case"/POSTPRO/state-* "$case"/POSTPRO/track-*
case $case in
*/bed*) # the plates, which come after the grains
    plates=$(awk '/PLANx/ { print body } /^\$bdyty/ { getline; body = $2 }' "$case/DATBOX/BODIES.DAT")
    for plate in $plates; do
        cd_post track "$case" --body "$plate"
    done ;;
*) # the lander, the last body
    cd_post track "$case" --body "$(tail -n 1 "$case/DATBOX/ORIGIN.csv" | cut -d, -f1)"
    rm -rf "$case/POSTPRO/lander"
    cp -r "$case"/POSTPRO/track-* "$case/POSTPRO/lander" ;;
esac
cd_post state "$case"
