#!/usr/bin/env bash
# Runs the scenes of tests/golden through the programs in $TARGET/debug and reads their ParaView files back with VTK.
#
# Where ParaView is installed, its script view.py must make a picture of each.
#
# VTK and numpy come from PyPI into $TARGET/vtk, once. A machine without python3, venv or network is told
# so, loudly, and the rest of the tests counts; with CD_REQUIRE_VTK=1 it is an error.
set -euo pipefail
cd "$(dirname "$0")/.."
TARGET=${TARGET:-$PWD/target}
PYTHON=${PYTHON:-python3}
PACKAGES="vtk==9.7.1 numpy==2.4.6"
VENV=$TARGET/vtk

not_run() {
    printf '\n********\n  VTK read-back NOT run: %s\n********\n\n' "$1" >&2
    [ "${CD_REQUIRE_VTK:-0}" = 1 ] && exit 1
    exit 0
}

if [ "$(cat "$VENV/.done" 2> /dev/null)" != "$PACKAGES" ]; then
    command -v "$PYTHON" > /dev/null || not_run "there is no $PYTHON"
    rm -rf "$VENV"
    "$PYTHON" -m venv "$VENV" || not_run "$PYTHON -m venv failed (on Debian: apt-get install python3-venv)"
    # Readers need nothing of what the vtk package depends on.
    # shellcheck disable=SC2086
    "$VENV/bin/pip" install --quiet --disable-pip-version-check --no-deps $PACKAGES || not_run "pip install $PACKAGES failed"
    "$VENV/bin/python" -c "import numpy, vtkmodules.vtkIOHDF, vtkmodules.vtkIOXML" || not_run "the installed VTK cannot be loaded"
    echo "$PACKAGES" > "$VENV/.done"
fi

PARAVIEW=false
if command -v pvbatch > /dev/null && command -v xvfb-run > /dev/null; then PARAVIEW=true; fi

for scene in tests/golden/*/scene.ron; do
    name=$(basename "$(dirname "$scene")")
    case=$TARGET/vtk-cases/$name
    rm -rf "$case"
    mkdir -p "$case"
    {
        "$TARGET/debug/cd-pre" "$scene" -o "$case"
        "$TARGET/debug/cd-solve" "$case"
        "$TARGET/debug/cd-post" --no-plots "$case"
    } > "$case/log" 2>&1 || { cat "$case/log" >&2; exit 1; }
    "$VENV/bin/python" tests/vtk_readback.py "$case"
    if $PARAVIEW; then
        xvfb-run -a pvbatch "$case/DISPLAY/view.py" "$case/view.png" > "$case/log" 2>&1 || true
        if [ ! -s "$case/view.png" ] || grep -E "ERR|Error|Traceback" "$case/log"; then cat "$case/log" >&2; exit 1; fi
    fi
    # Points of faces are compared by their numbers, and pieces repeat those of polyhedra: one piece for these.
    if [ -e "$case/DISPLAY/polyhedra.pvd" ]; then cells=1000000; else cells=7; fi
    "$TARGET/debug/cd-post" --no-plots --piece-cells "$cells" "$case" > "$case/log" 2>&1 || { cat "$case/log" >&2; exit 1; }
    "$VENV/bin/python" tests/vtk_readback.py "$case"
    "$TARGET/debug/cd-post" --no-plots --vtk-format vtkhdf "$case" > "$case/log" 2>&1 || { cat "$case/log" >&2; exit 1; }
    "$VENV/bin/python" tests/vtk_readback.py "$case"
done
$PARAVIEW || echo "view.py NOT run: there is no ParaView (on Debian: apt-get install paraview python3-paraview xvfb xauth)" >&2
