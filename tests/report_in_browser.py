"""Opens a report in Chromium without a screen, uses it, and checks the screen and the files that the page saves.

Arguments: browser, page, and a folder for the files, which must not exist. The browser runs in real time, since a film
records the page as time passes; it is driven by its debugging pipe: messages in JSON that end with a zero byte.
"""
import atexit
import base64
import json
import os
import pathlib
import struct
import subprocess
import sys
import threading
import time
import zlib

MAX_SECONDS = 240  # after which the browser is ended
OPTIONS = "--headless --no-sandbox --disable-dev-shm-usage --use-angle=swiftshader --enable-unsafe-swiftshader"


class Browser:
    """A browser that commands of its debugging pipe drive, with an empty page."""

    def __init__(self, program, folder):
        (from_here, self.commands), (self.answers, to_here) = os.pipe(), os.pipe()
        # The browser reads from descriptor 3 and writes to 4.
        redirected = ["bash", "-c", f'exec "$@" 3<&{from_here} 4>&{to_here}', "bash", program, *OPTIONS.split()]
        self.process = subprocess.Popen(
            [*redirected, "--remote-debugging-pipe", f"--user-data-dir={folder}/profile"], pass_fds=(from_here, to_here),
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=open(folder / "stderr", "w"))
        os.close(from_here)
        os.close(to_here)
        atexit.register(self.end)
        limit = threading.Timer(MAX_SECONDS, self.process.kill)
        limit.daemon = True
        limit.start()
        self.unread, self.events, self.count, self.session = b"", [], 0, None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def end(self):
        self.process.kill()
        self.process.wait()

    def message(self):
        """The next message of the browser; waits for it."""
        while b"\0" not in self.unread:
            read = os.read(self.answers, 1 << 20)
            assert read, f"the browser ended, or took more than {MAX_SECONDS} s"
            self.unread += read
        text, self.unread = self.unread.split(b"\0", 1)
        return json.loads(text)

    def call(self, method, **parameters):
        """Result of a command; events that arrive before it are kept in `events`."""
        self.count += 1
        command = {"id": self.count, "method": method, "params": parameters}
        if self.session:
            command["sessionId"] = self.session
        data = json.dumps(command).encode() + b"\0"
        while data:
            data = data[os.write(self.commands, data):]
        while (answer := self.message()).get("id") != self.count:
            self.events.append(answer)
        assert "error" not in answer, (method, answer["error"])
        return answer["result"]

    def open(self, path):
        """Opens a file and waits until it is loaded."""
        self.events.clear()
        self.call("Page.navigate", url=path.as_uri())
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(self.message())

    def value(self, script):
        """Value of an expression, or of its promise."""
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True, userGesture=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def check_errors(self):
        """Fails if the page has thrown or printed an error since the last action."""
        for event in self.events:
            parameters = event.get("params", {})
            level = parameters.get("type") or parameters.get("entry", {}).get("level")
            thrown = event.get("method") == "Runtime.exceptionThrown" or level == "error"
            assert not thrown, f"the page has printed an error: {json.dumps(parameters)[:500]}"


def pixel_rows(data):
    """Width, height, bytes of a pixel, and rows of pixels of a PNG (ISO/IEC 15948), with the filters of its rows undone."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
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
    return width, height, size, rows


def check_picture(name, data, least_colours):
    """Width and height of a picture, which must be opaque, with white corners and many colours in its middle."""
    width, height, size, rows = pixel_rows(data)
    colours = {bytes(row[x * size:x * size + 3]) for row in rows[height // 2 - 100:height // 2 + 100]
               for x in range(width // 2 - 150, width // 2 + 150)}
    assert len(colours) >= least_colours, f"{name}: only {len(colours)} colours in the middle"
    assert bytes(rows[1][size:size + 3]) == b"\xff\xff\xff", f"{name}: its corner is not white"
    if size == 4:
        assert all(row[3::4] == b"\xff" * width for row in rows), f"{name}: parts of it are transparent"
    print(f"report.html: {name}: {width} x {height}, {len(colours)} colours in the middle")
    return width, height


def main(program, page, folder):
    folder.mkdir()
    browser = Browser(program, folder)
    browser.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder),
                 eventsEnabled=True)
    browser.call("Emulation.setDeviceMetricsOverride", width=1280, height=900, deviceScaleFactor=1, mobile=False)

    def screenshot(name):
        data = base64.b64decode(browser.call("Page.captureScreenshot")["data"])
        (folder / name).write_bytes(data)
        return data

    def saved(button, name):
        """Presses a button and returns the file that it saves."""
        browser.events.clear()
        browser.value(f"document.querySelector({json.dumps(button)}).click()")
        while not any(event.get("params", {}).get("state") == "completed" for event in browser.events):
            browser.events.append(browser.message())
            browser.check_errors()
        return (folder / name).read_bytes()

    browser.open(page)
    browser.check_errors()
    assert browser.value("document.body.dataset.drawn") == "yes", "nothing was drawn"
    last = screenshot("last.screenshot.png")
    check_picture("the screen", last, 50)

    case = page.parent.parent.name
    check_picture("view", saved("#view-exports button", f"{case}-view.png"), 50)
    names = browser.value("[...document.querySelectorAll('figure')].map((figure) => figure.dataset.name)")
    assert len(set(names)) == len(names), names
    for name in ("energy", "aggregate"):
        size = browser.value(f"(({{ width, height }}) => [width, height].map((length) => 2 * length.baseVal.value))"
                             f"(document.querySelector('[data-name={name}] svg'))")
        png = saved(f"[data-name={name}] button", f"{case}-{name}.png")
        assert list(check_picture(name, png, 3)) == size, f"{name}: its size should be {size}"

    count = browser.value("Number(document.getElementById('view-time').max) + 1")
    film = saved("#view-exports button:nth-of-type(2)", f"{case}.webm")
    assert browser.value("document.getElementById('view-time').value") == str(count - 1), "the film moves the view"
    assert len(film) > 1000, f"a film of {len(film)} bytes"

    browser.value("""{ const slider = document.getElementById("view-time");
        slider.value = 0; slider.dispatchEvent(new Event("input")); }""")
    clock = browser.value("document.getElementById('view-clock').textContent")
    assert clock == "t = 0 s, step 0", f"the slider leads to {clock}, not to the first state"
    first = screenshot("first.screenshot.png")
    assert first != last, "the first state looks like the last"
    browser.check_errors()

    browser.open(folder / f"{case}.webm")
    seconds, width, height = browser.value("""new Promise((done) => {
        const film = document.querySelector("video");
        film.addEventListener("seeked", () => done([film.duration, film.videoWidth, film.videoHeight]));
        film.currentTime = 1e6;
    })""")
    print(f"report.html: film of {count} states: {seconds:.2f} s, {width} x {height}, {len(film)} bytes")
    assert seconds > 0.1 * count - 0.05, f"a film of {count} states takes {seconds} s"


try:
    main(sys.argv[1], *(pathlib.Path(path).resolve() for path in sys.argv[2:]))
except AssertionError as fault:
    sys.exit(f"report.html: {fault}")
