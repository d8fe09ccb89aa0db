// Files from this page: tables as CSV, each figure and the view of the grains as PNG, and a film of the view. Files are named
// after the case, which is the title of the page.
(function () {
  "use strict";
  const FRAME_MILLISECONDS = 100, DRAIN_MILLISECONDS = 1000, QUIET_DRAINS = 3;
  const FIGURE_SCALE = 2;
  const save = (name, blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `${document.title}${name}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  };
  const addButton = (parent, text, title, action) => {
    const button = document.createElement("button");
    Object.assign(button, { textContent: text, title, className: "export" });
    button.addEventListener("click", () => action(button));
    parent.append(" ", button);
  };

  for (const table of document.querySelectorAll("script[data-table]")) {
    const text = table.textContent, name = table.dataset.table;
    const label = `${name} (${Math.ceil(text.length / 1024)} KiB)`;
    addButton(document.getElementById("table-exports"), label, "Save this table", () =>
      save(`-${name}`, new Blob([text], { type: "text/csv" })));
  }

  const saveFigure = async (figure) => {
    const svg = figure.querySelector("svg"), copy = svg.cloneNode(true);
    const canvas = document.createElement("canvas");
    canvas.width = FIGURE_SCALE * svg.width.baseVal.value;
    canvas.height = FIGURE_SCALE * svg.height.baseVal.value;
    copy.setAttribute("width", canvas.width);
    copy.setAttribute("height", canvas.height);
    const image = new Image();
    image.src = "data:image/svg+xml," + encodeURIComponent(new XMLSerializer().serializeToString(copy));
    await image.decode();
    const context = canvas.getContext("2d");
    context.fillStyle = "white";
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.drawImage(image, 0, 0);
    canvas.toBlob((blob) => save(`-${figure.dataset.name}.png`, blob));
  };
  for (const figure of document.querySelectorAll("figure")) {
    addButton(figure.querySelector("figcaption"), "PNG", "Save this figure", () => saveFigure(figure));
  }

  const view = document.getElementById("view"), slider = document.getElementById("view-time");
  const bar = document.getElementById("view-exports");
  if (!document.body.dataset.drawn) return;
  bar.append("Save as");
  addButton(bar, "PNG", "Save this view", () => view.toBlob((blob) => save("-view.png", blob)));
  if (Number(slider.max) < 1) return;
  const type = window.MediaRecorder && view.captureStream &&
    ["video/webm", "video/mp4"].find((type) => MediaRecorder.isTypeSupported(type));
  if (!type) { bar.append(" (this browser cannot record a film)"); return; }

  const show = (k) => { slider.value = k; slider.dispatchEvent(new Event("input")); };
  const pause = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
  // A callback of requestAnimationFrame comes before the frame, the next one after it: the state has then been recorded.
  const frameShown = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const film = async (button) => {
    const before = Number(slider.value), count = Number(slider.max) + 1, text = button.textContent;
    button.disabled = true;
    // Without requestFrame each change of the canvas is a frame.
    let stream = view.captureStream(0);
    const track = stream.getVideoTracks()[0];
    if (!track.requestFrame) stream = view.captureStream();
    const recorder = new MediaRecorder(stream, { mimeType: type, videoBitsPerSecond: 8e6 }), parts = [];
    recorder.addEventListener("dataavailable", (e) => { if (e.data.size > 0) parts.push(e.data); });
    const stopped = new Promise((done) => recorder.addEventListener("stop", done));
    const record = async (k) => {
      const shown = Math.min(k, count - 1), next = Promise.all([pause(FRAME_MILLISECONDS), frameShown()]);
      show(shown);
      if (track.requestFrame) track.requestFrame();
      button.textContent = `Film: ${shown + 1} of ${count}`;
      await next;
    };
    recorder.start(FRAME_MILLISECONDS);
    // An encoder that starts loses frames: the first state lasts until there are data.
    for (let tries = 0; tries < 50 && parts.length === 0; tries++) await record(0);
    // The last state comes twice: a frame lasts until the next.
    for (let k = 1; k <= count; k++) await record(k);
    // A slow encoder loses the frames that it has when it is stopped: it gets time until there have been no more data for a while.
    for (let quiet = 0, tries = 0; (quiet < QUIET_DRAINS || parts.length === 0) && tries < 60; tries++) {
      const known = parts.length;
      await pause(DRAIN_MILLISECONDS);
      quiet = parts.length > known ? 0 : quiet + 1;
    }
    recorder.stop();
    await stopped;
    save(type === "video/webm" ? ".webm" : ".mp4", new Blob(parts, { type }));
    show(before);
    Object.assign(button, { textContent: text, disabled: false });
  };
  addButton(bar, "Film", "Save a film of this view, 10 states per second; keep the page visible meanwhile", film);
})();

// The page of a running case is loaded again; its last version is not.
(function () {
  "use strict";
  const seconds = Number(document.body.dataset.reload);
  const box = document.getElementById("reload");
  if (seconds > 0) setInterval(() => { if (box.checked) location.reload(); }, 1000 * seconds);
})();
