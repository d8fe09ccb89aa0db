// Grains as shaded balls and polyhedra, with walls, at some times of the run: WebGL 2, no library, no network. Drag turns, the
// wheel (or + and -) zooms, shift-drag moves, double click brings the start back, the space bar plays.
(function () {
  "use strict";
  const data = JSON.parse(document.getElementById("grain-data").textContent);
  const canvas = document.getElementById("view");
  const say = (text) => { document.getElementById("view-note").textContent = text; };
  const floats = (base64) => {
    const text = atob(base64), bytes = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
    return new Float32Array(bytes.buffer);
  };
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) { say("This browser has no WebGL 2: the grains cannot be shown."); return; }

  const shader = (kind, source) => {
    const made = gl.createShader(kind);
    gl.shaderSource(made, "#version 300 es\nprecision highp float;\n" + source);
    gl.compileShader(made);
    if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made));
    return made;
  };
  const program = (vertex, fragment) => {
    const made = gl.createProgram();
    gl.attachShader(made, shader(gl.VERTEX_SHADER, vertex));
    gl.attachShader(made, shader(gl.FRAGMENT_SHADER, fragment));
    gl.bindAttribLocation(made, 0, "place");
    gl.bindAttribLocation(made, 1, "value");
    gl.bindAttribLocation(made, 2, "side");
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return made;
  };
  // Viridis at 0, 1/4, ... 1, a little lighter at its dark end.
  // Negative values are those of walls.
  const colours = `vec3 ramp(float s) { if (s < -.5) return vec3(150., 156., 165.) / 255.;
    vec3 c[5] = vec3[5](vec3(90., 40., 120.), vec3(70., 92., 150.), vec3(40., 145., 140.), vec3(100., 200., 95.), vec3(250., 225., 50.));
    float p = clamp(s, 0., 1.) * 4.; int k = min(int(p), 3);
    return mix(c[k], c[k + 1], p - float(k)) / 255.; }
    vec3 lit(vec3 base, vec3 n) { return base * (.35 + .65 * max(dot(n, normalize(vec3(-.4, .5, .8))), 0.)); }`;
  // A ball is a square of two triangles; each of its pixels finds the ball's surface.
  const balls = program(
    `in vec4 place; in float value; in vec2 side; uniform mat3 turn; uniform vec4 scale; uniform vec2 shift;
     out vec2 corner; out float share; out float depth; out float deep;
     void main() { vec3 p = turn * place.xyz; corner = side; share = value;
       vec2 q = (p.xy + side * place.w) * scale.xy + shift; depth = p.z * scale.z; deep = place.w * scale.z;
       gl_Position = vec4(q, 0., 1.); }`,
    colours + `in vec2 corner; in float share; in float depth; in float deep; out vec4 colour;
     void main() { float rr = dot(corner, corner); if (rr > 1.) discard; vec3 n = vec3(corner, sqrt(1. - rr));
       gl_FragDepth = .5 - .5 * (depth + n.z * deep); colour = vec4(lit(ramp(share), n), 1.); }`);
  // Corners of triangles, each with the value of its grain.
  const faces = program(
    `in vec3 place; in float value; uniform mat3 turn; uniform vec4 scale; uniform vec2 shift; out float share; out vec3 seen;
     void main() { vec3 p = turn * place; share = value; seen = p;
       gl_Position = vec4(p.xy * scale.xy + shift, -p.z * scale.z, 1.); }`,
    colours + `in float share; in vec3 seen; out vec4 colour;
     void main() { vec3 n = normalize(cross(dFdx(seen), dFdy(seen))); if (n.z < 0.) n = -n; colour = vec4(lit(ramp(share), n), 1.); }`);

  // Walls: translucent faces and their edges.
  const flat = program(
    `in vec3 place; uniform mat3 turn; uniform vec4 scale; uniform vec2 shift;
     void main() { vec3 p = turn * place; gl_Position = vec4(p.xy * scale.xy + shift, -p.z * scale.z - scale.w, 1.); }`,
    `uniform vec4 ink; out vec4 colour; void main() { colour = ink; }`);

  // In the frames of the grains; a ball has its radius as well.
  const balls_there = floats(data.balls), corners_there = floats(data.corners);
  const fill = (buffer, values) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    return buffer;
  };
  const square = fill(gl.createBuffer(), new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]));
  const [where, which, cornerPlace, cornerValue] = [0, 0, 0, 0].map(() => gl.createBuffer());
  const walls = {};
  for (const [name, { corners, owners }] of Object.entries(data.walls)) {
    walls[name] = { there: floats(corners), owners, place: gl.createBuffer(), value: gl.createBuffer() };
    fill(walls[name].value, new Float32Array(owners.length).fill(-1));
  }
  let now = data.states.length - 1;
  // Points of the grains' frames, each of so many numbers, where a state has them.
  const placed = (points, each, owners, state) => {
    const places = floats(state.places), turns = floats(state.turns), made = new Float32Array(points);
    owners.forEach((owner, k) => {
      let [x, y, z] = points.subarray(each * k, each * k + 3);
      if (turns.length) {
        const [i, j, l, w] = turns.subarray(4 * owner, 4 * owner + 4);
        const [a, b, c] = [2 * (j * z - l * y), 2 * (l * x - i * z), 2 * (i * y - j * x)];
        [x, y, z] = [x + w * a + j * c - l * b, y + w * b + l * a - i * c, z + w * c + i * b - j * a];
      }
      made[each * k] = places[3 * owner] + x;
      made[each * k + 1] = places[3 * owner + 1] + y;
      made[each * k + 2] = places[3 * owner + 2] + z;
    });
    return made;
  };

  let turn, zoom, shift;
  const start = () => {
    // From the front, a little from the right and from above; z points up.
    const [sa, ca, sb, cb] = [Math.sin(0.5), Math.cos(0.5), Math.sin(0.35), Math.cos(0.35)];
    const x = [ca, sa, 0], up = [-sa * sb, ca * sb, cb], back = [sa * cb, -ca * cb, sb];
    turn = [x, up, back]; zoom = 1; shift = [0, 0];
  };
  const rotate = (dx, dy) => {
    const about = (i, j, angle) => {
      const [c, s] = [Math.cos(angle), Math.sin(angle)], [p, q] = [turn[i], turn[j]];
      turn[i] = p.map((v, k) => c * v - s * q[k]); turn[j] = p.map((v, k) => s * v + c * q[k]);
    };
    about(2, 0, dx); about(1, 2, dy);
  };
  const draw = () => {
    const ratio = window.devicePixelRatio || 1;
    const [w, h] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    gl.viewport(0, 0, w, h);
    gl.clearColor(1, 1, 1, 1);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const per = 0.9 * zoom / data.radius, wide = Math.max(1, w / h), high = Math.max(1, h / w);
    const at = (name) => gl.getUniformLocation(gl.getParameter(gl.CURRENT_PROGRAM), name);
    const use = (made, advance = 0) => {
      gl.useProgram(made);
      const [x, y, z] = turn;
      gl.uniformMatrix3fv(at("turn"), false, [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]]);
      gl.uniform4f(at("scale"), per / wide, per / high, 0.5 / data.reach, advance);
      gl.uniform2f(at("shift"), shift[0], shift[1]);
    };
    const bind = (index, made, size, each) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, made);
      gl.enableVertexAttribArray(index);
      gl.vertexAttribPointer(index, size, gl.FLOAT, false, 0, 0);
      gl.vertexAttribDivisor(index, each);
    };
    const drawBalls = (place, value, count) => {
      if (count === 0) return;
      use(balls); bind(0, place, 4, 1); bind(1, value, 1, 1); bind(2, square, 2, 0);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
    };
    const drawFaces = (place, value, count) => {
      if (count === 0) return;
      use(faces); bind(0, place, 3, 0); bind(1, value, 1, 0); gl.disableVertexAttribArray(2);
      gl.drawArrays(gl.TRIANGLES, 0, count);
    };
    drawBalls(where, which, data.ball_owners.length);
    drawFaces(cornerPlace, cornerValue, data.corner_owners.length);
    drawBalls(walls.balls.place, walls.balls.value, walls.balls.owners.length);
    drawFaces(walls.solid.place, walls.solid.value, walls.solid.owners.length);
    // Translucent walls do not hide each other; the picture itself stays opaque.
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ZERO, gl.ONE);
    gl.depthMask(false);
    const drawFlat = ({ place, owners }, kind, ink, advance) => {
      if (owners.length === 0) return;
      use(flat, advance); gl.uniform4f(at("ink"), ...ink);
      bind(0, place, 3, 0); gl.disableVertexAttribArray(1); gl.disableVertexAttribArray(2);
      gl.drawArrays(kind, 0, owners.length);
    };
    drawFlat(walls.glass, gl.TRIANGLES, [0.59, 0.61, 0.65, 0.12], 0);
    drawFlat(walls.lines, gl.LINES, [0.3, 0.31, 0.33, 0.8], 1e-5);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  };

  const choice = document.getElementById("view-quantity"), legend = document.getElementById("view-legend");
  const number = (x) => Number(x.toPrecision(3)).toString();
  const same = document.getElementById("view-same");
  const colour = () => {
    const quantity = data.quantities[choice.selectedIndex];
    const state = quantity.states[Math.min(now, quantity.states.length - 1)], values = floats(state.values);
    let { low, high: top } = same.checked ? quantity : state;
    if (!(top > low)) top = low + 1;
    const share = values.map((v) => (v - low) / (top - low));
    fill(which, Float32Array.from(data.ball_owners, (owner) => share[owner]));
    fill(cornerValue, Float32Array.from(data.corner_owners, (owner) => share[owner]));
    const unit = quantity.unit === "1" ? "" : " " + quantity.unit;
    legend.querySelector(".low").textContent = number(low) + unit;
    legend.querySelector(".high").textContent = number(top) + unit;
    draw();
  };
  for (const quantity of data.quantities) choice.add(new Option(quantity.name));
  choice.addEventListener("change", colour);
  same.addEventListener("change", colour);

  const slider = document.getElementById("view-time"), button = document.getElementById("view-play");
  const show = (k) => {
    now = k;
    const state = data.states[k];
    slider.value = k;
    document.getElementById("view-clock").textContent = `t = ${Number(state.time.toPrecision(6))} s, step ${state.step}`;
    fill(where, placed(balls_there, 4, data.ball_owners, state));
    fill(cornerPlace, placed(corners_there, 3, data.corner_owners, state));
    for (const [name, { there, owners, place }] of Object.entries(walls)) {
      fill(place, placed(there, name === "balls" ? 4 : 3, owners, state.walls));
    }
    colour();
  };
  let playing = null;
  const stop = () => { clearInterval(playing); playing = null; button.textContent = "Play"; };
  const play = () => {
    if (playing) { stop(); return; }
    if (now + 1 === data.states.length) show(0);
    button.textContent = "Stop";
    playing = setInterval(() => { if (now + 1 < data.states.length) show(now + 1); else stop(); }, 100);
  };
  slider.max = data.states.length - 1;
  slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
  button.addEventListener("click", play);
  if (data.states.length < 2) document.getElementById("view-player").hidden = true;

  let held = null;
  canvas.addEventListener("pointerdown", (e) => { held = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
  canvas.addEventListener("pointerup", () => { held = null; });
  canvas.addEventListener("pointermove", (e) => {
    if (!held) return;
    const [dx, dy] = [e.clientX - held[0], e.clientY - held[1]];
    held = [e.clientX, e.clientY];
    if (e.shiftKey) shift = [shift[0] + 2 * dx / canvas.clientWidth, shift[1] - 2 * dy / canvas.clientHeight];
    else rotate(-0.008 * dx, 0.008 * dy);
    draw();
  });
  const magnify = (factor) => { zoom = Math.min(200, Math.max(0.05, zoom * factor)); draw(); };
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); magnify(Math.exp(-0.0015 * e.deltaY)); }, { passive: false });
  canvas.addEventListener("dblclick", () => { start(); draw(); });
  canvas.addEventListener("keydown", (e) => {
    const turns = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
    if (turns) { e.preventDefault(); rotate(turns[0], turns[1]); draw(); }
    if (e.key === " ") { e.preventDefault(); play(); }
    if (e.key === "+") magnify(1.2);
    if (e.key === "-") magnify(1 / 1.2);
  });
  window.addEventListener("resize", draw);
  start();
  // A page of a running case is loaded again and again: the view stays.
  const kept = document.body.dataset.reload ? sessionStorage.getItem("view") : null;
  if (kept) {
    let quantity;
    ({ turn, zoom, shift, quantity } = JSON.parse(kept));
    if (quantity < data.quantities.length) choice.selectedIndex = quantity;
  }
  window.addEventListener("pagehide", () => {
    if (document.body.dataset.reload) {
      sessionStorage.setItem("view", JSON.stringify({ turn, zoom, shift, quantity: choice.selectedIndex }));
    }
  });
  show(now);
  say("");
  document.body.dataset.drawn = "yes";
})();
