#!/usr/bin/env bash
# Opens the report of a small case in Chromium without a screen: its script must run, draw and print no error.
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

page=$case/POSTPRO/report.html
in_browser() { # in_browser OPTION...: opens $page; stdout and stderr of the browser go to files
    timeout 300 "$browser" --headless --no-sandbox --disable-dev-shm-usage --use-angle=swiftshader --enable-unsafe-swiftshader \
        --user-data-dir="$case/profile" --window-size=1200,900 --virtual-time-budget=10000 --enable-logging=stderr --v=0 \
        "$@" "file://$(realpath "$page")" > "$case/stdout" 2> "$case/stderr" ||
        { tail -5 "$case/stderr" >&2; echo "the browser failed" >&2; exit 1; }
}

in_browser --dump-dom
grep -q 'data-drawn="yes"' "$case/stdout" || { grep CONSOLE "$case/stderr" >&2; echo "report.html: nothing was drawn" >&2; exit 1; }
if grep CONSOLE "$case/stderr" | grep -iE 'error|exception' >&2; then
    echo "report.html: the page has printed errors" >&2
    exit 1
fi
in_browser --screenshot="$case/report.png"
# The same page, sent to its first state as a hand on the slider would.
page=$case/first.html
{
    cat "$case/POSTPRO/report.html"
    echo '<script>{ const s = document.getElementById("view-time"); s.value = 0; s.dispatchEvent(new Event("input")); }</script>'
} > "$page"
in_browser --dump-dom
grep -q '<output id="view-clock">t = 0 s, step 0</output>' "$case/stdout" || { echo "report.html: the slider does not lead to the first state" >&2; exit 1; }
in_browser --screenshot="$case/first.png"
cmp --silent "$case/report.png" "$case/first.png" && { echo "report.html: the first state looks as the last" >&2; exit 1; }
for picture in report first; do python3 - "$case/$picture.png" <<'PYTHON'
# The view holds many colours in its middle: grains and not an empty canvas.
import struct, sys, zlib
data = open(sys.argv[1], "rb").read()
width, height, depth, kind = struct.unpack(">IIBB", data[16:26])
assert depth == 8 and kind in (2, 6), (depth, kind)
size, at, packed = {2: 3, 6: 4}[kind], 8, b""
while at < len(data):
    length, name = struct.unpack(">I4s", data[at:at + 8])
    packed += data[at + 8:at + 8 + length] if name == b"IDAT" else b""
    at += 12 + length
raw, stride, above, rows = zlib.decompress(packed), width * size, bytearray(width * size), []
for y in range(height):
    mode, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
    for i in range(stride):
        a, b = (line[i - size] if i >= size else 0), above[i]
        c = above[i - size] if i >= size else 0
        p = a + b - c
        paeth = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
        line[i] = (line[i] + (0, a, b, (a + b) // 2, paeth)[mode]) & 255
    rows.append(line)
    above = line
colours = {bytes(row[x * size:x * size + 3]) for row in rows[height // 2 - 100:height // 2 + 100]
           for x in range(width // 2 - 150, width // 2 + 150)}
assert len(colours) > 50, f"only {len(colours)} colours in the middle of the view"
print(f"report.html: drawn, {len(colours)} colours in the middle of the view")
PYTHON
done
