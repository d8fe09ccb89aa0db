#!/usr/bin/env bash
# Opens the report of a small case in Chromium without a screen: its scripts must draw, save pictures and a film, and print
# no error.
#
# A machine without Chromium is told so, loudly, and the rest of the tests counts; with CD_REQUIRE_CHROMIUM=1 it is an error.
set -euo pipefail
cd "$(dirname "$0")/.."
TARGET=${TARGET:-$PWD/target}

not_run() {
    printf '\n********\n  report in a browser NOT tested: %s\n********\n\n' "$1" >&2
    [ "${CD_REQUIRE_CHROMIUM:-0}" = 1 ] && exit 1
    exit 0
}

browser=$(command -v chromium || command -v chromium-browser || command -v google-chrome) ||
    not_run "there is no chromium (on Debian: apt-get install chromium)"

case=$TARGET/report-case
rm -rf "$case"
mkdir -p "$case"
{
    "$TARGET/debug/cd-pre" tests/golden/rubble/scene.ron -o "$case"
    "$TARGET/debug/cd-solve" "$case"
    "$TARGET/debug/cd-post" report "$case"
} > "$case/log" 2>&1 || { cat "$case/log" >&2; exit 1; }

python3 tests/report_in_browser.py "$browser" "$case/POSTPRO/report.html" "$case/browser" || {
    tail -5 "$case/browser/stderr" >&2
    exit 1
}
