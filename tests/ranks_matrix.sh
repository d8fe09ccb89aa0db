#!/usr/bin/env bash
# Compares OUTBOX of seven scenes on 1 to 8 ranks of MPI and 1 or 2 threads with that of one process, byte for byte.
#
#   CD_BIN       folder of cd-pre and of a cd-solve that brings the scenes to their first contacts
#   SOLVE        cd-solve with the feature `mpi`, as `make ranks` builds it
#   LAUNCH       command that starts ranks, before `-n R`; default mpirun
#   LAYOUTS      ranks x threads
#   SCENES       names of the scenes
#   WORK         folder of the cases, which later calls use again
set -euo pipefail
cd "$(dirname "$0")/.."

: "${CD_BIN:=target/release}" "${SOLVE:=target/debug/cd-solve}" "${LAUNCH:=mpirun}" "${WORK:=target/ranks-matrix}"
: "${LAYOUTS:=1x1 1x2 2x1 2x2 3x1 3x2 4x1 4x2 8x1 8x2}"
: "${SCENES:=accretion box rocks drum shear bonds spin-up}"
# Open MPI: as root, with more ranks than processors. The smallest block, so that small scenes have many.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1
export OMPI_MCA_mpi_yield_when_idle=1 OMPI_MCA_hwloc_base_binding_policy=none CD_TESTS_BLOCK=${CD_TESTS_BLOCK:-8}
# A build without optimisation needs it for polyhedra.
export RUST_MIN_STACK=64000000

# scene NAME: its text, the number of steps to its first contacts and that on ranks.
scene() {
    case $1 in
        accretion) cat examples/accretion/scene.ron; steps=(1330 4) ;;
        box)
            sed 's/number: 10/number: 200/; s/min: 0.08, max: 0.12/min: 0.03, max: 0.045/' tests/golden/box/scene.ron
            steps=(100 8)
            ;;
        rocks) sed 's/number: 2000/number: 300/' examples/accretion-polyhedra/scene.ron; steps=(2950 4) ;;
        drum) cat examples/drum/scene.ron; steps=(900 4) ;;
        shear) cat examples/shear/scene.ron; steps=(2000 4) ;;
        bonds)
            sed 's/number: 4/number: 60/; s/place:/placement:/; s/most:/max_multiple:/' tests/fixtures/formats/1/monolith/scene.ron
            steps=(20 12)
            ;;
        spin-up)
            sed 's/(time: 5000.0, action: .*)\]/(time: 2660.0, every: 4.0, action: AddSpin((0.0, 0.0, 1.0e-4)))]/' \
                examples/spin-up/scene.ron
            steps=(1330 4)
            ;;
        *) echo "no scene $1" >&2; exit 2 ;;
    esac
}

failed=0
for name in $SCENES; do
    start=$WORK/$name/start one=$WORK/$name/one many=$WORK/$name/many
    mkdir -p "$WORK/$name"
    scene "$name" > "$WORK/$name/scene.ron"
    last=$((steps[0] + steps[1]))
    if [ ! -e "$start/done" ]; then
        rm -rf "$start" "$one"
        "$CD_BIN/cd-pre" "$WORK/$name/scene.ron" -o "$start" > "$WORK/$name/log"
        "$CD_BIN/cd-solve" "$start" --steps "${steps[0]}" > "$WORK/$name/log" 2>&1
        touch "$start/done"
    fi
    if [ ! -e "$one/done" ]; then
        rm -rf "$one"
        cp -r "$start" "$one"
        "$SOLVE" "$one" --resume --steps "$last" --output-every 2 --threads 1 > "$WORK/$name/log" 2>&1
        touch "$one/done"
    fi
    for layout in $LAYOUTS; do
        rm -rf "$many"
        cp -r "$start" "$many"
        # shellcheck disable=SC2086
        if ! $LAUNCH -n "${layout%x*}" "$SOLVE" "$many" --resume --steps "$last" --output-every 2 --threads "${layout#*x}" \
            > "$WORK/$name/log" 2>&1; then
            echo "$name, $layout: failed"; tail -5 "$WORK/$name/log"; failed=1
        elif ! diff -rq "$one/OUTBOX" "$many/OUTBOX"; then
            echo "$name, $layout: differs"; failed=1
        else
            echo "$name, $layout: equal bytes;$(grep '^ *ranks' "$WORK/$name/log" | sed 's/  */ /g' || true)"
        fi
    done
done
exit $failed
