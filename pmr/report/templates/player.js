// The player of bodies: WebGL 2, seen without perspective, in the frame of what does not slide.
// Series are of 16 bits; a button starts time, and a slider sets it.
const unpack = (series) => {
  const bytes = Uint8Array.from(atob(series.data), (c) => c.charCodeAt(0));
  const counts = new DataView(bytes.buffer);
  return Float32Array.from({ length: bytes.length / 2 }, (_, i) => counts.getInt16(2 * i, true) * series.count);
};
const SHADERS = [
  `#version 300 es
  uniform vec3 right, above, towards, centre;
  uniform vec2 size;
  uniform float nearer, deep;
  in vec3 place;
  in float value;
  out vec3 seen;
  out float level;
  void main() {
    vec3 p = place - centre;
    seen = vec3(dot(p, right), dot(p, above), dot(p, towards));
    level = value;
    gl_Position = vec4(seen.xy / size, -(seen.z + nearer) / deep, 1.0);
  }`,
  `#version 300 es
  precision highp float;
  uniform vec3 ramp[5];
  uniform vec4 plain;
  uniform bool coloured, lit;
  in vec3 seen;
  in float level;
  out vec4 colour;
  void main() {
    float at = clamp(level, 0.0, 1.0) * 4.0;
    int k = min(int(at), 3);
    vec3 base = coloured ? mix(ramp[k], ramp[k + 1], at - float(k)) : plain.rgb;
    vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
    float light = lit ? 0.68 + 0.32 * abs(dot(normal, normalize(vec3(-0.4, 0.6, 0.8)))) : 1.0;
    colour = vec4(base * light, plain.a);
  }`,
];
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
const indices = (text) => new Uint32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const series = (packed) => ({ coefficients: packed.coefficients.map(unpack), shapes: packed.shapes.map(unpack) });
const HOME = { azimuth: -1.2, elevation: 0.31, zoom: 1 };

// Reads the JSON in its figure; `draw` shows the frame, which may lie between two.
class Player {
  constructor(figure) {
    const find = (selector) => figure.querySelector(selector);
    this.data = JSON.parse(find("script").textContent);
    this.canvas = find("canvas");
    this.button = find("button");
    this.slider = find("input[type=range]");
    this.output = find("output");
    this.speed = find("select");
    this.frame = 0;
    this.playing = false;
    this.pen = this.canvas.getContext("webgl2", { alpha: false, preserveDrawingBuffer: true });
    if (!this.pen) {
      for (const part of figure.querySelectorAll("canvas, .controls, figcaption")) part.hidden = true;
      figure.querySelector(".absent").hidden = false;
      return;
    }
    this.magnify = figure.querySelector("select.scale");
    this.lines = figure.querySelector("input[type=checkbox]");
    this.path = unpack(this.data.path);
    this.bodies = this.data.bodies.map((body) => ({
      faces: body.faces,
      rest: unpack(body.points),
      along: unpack(body.along),
      triangles: indices(body.triangles),
      edges: indices(body.edges),
      motion: series(body.motion),
      stress: body.stress && series(body.stress),
    }));
    this.pose = this.data.pose && { ...this.data.pose, angles: this.data.pose.angles.map(unpack),
      rotation: unpack(this.data.pose.rotation), origin: unpack(this.data.pose.origin) };
    this.view = { ...HOME };
    this.frame = this.slider.value = this.data.first;
    this.prepare();
    this.listen();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  get last() { return this.data.frames - 1; }

  get time() { return this.between(this.data.moments); }

  get clock() { return `t = ${this.time.toFixed(this.data.times[1] < 1 ? 4 : 2)} s`; }

  say(text) {
    this.output.textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
  }

  toggle() {
    this.playing = !this.playing;
    this.button.textContent = this.playing ? "❚❚" : "▶";
    this.button.setAttribute("aria-label", this.playing ? "Pause" : "Play");
    if (!this.playing) return;
    if (this.frame >= this.last) this.frame = 0;
    this.before = null;
    requestAnimationFrame((now) => this.step(now));
  }

  step(now) {
    if (!this.playing) return;
    const [start, end] = this.data.times;
    const elapsed = this.before === null ? 0 : Math.min(now - this.before, 100) / 1000;
    this.before = now;
    this.frame = Math.min(this.frame + elapsed * Number(this.speed.value) * this.last / (end - start), this.last);
    this.slider.value = Math.round(this.frame);
    this.draw();
    if (this.frame >= this.last) this.toggle();
    else requestAnimationFrame((next) => this.step(next));
  }

  prepare() {
    const gl = this.pen, program = gl.createProgram();
    [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((kind, i) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, SHADERS[i]);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    gl.linkProgram(program);
    gl.useProgram(program);
    this.at = (name) => gl.getUniformLocation(program, name);
    this.places = gl.createBuffer();
    this.values = gl.createBuffer();
    [["place", this.places, 3], ["value", this.values, 1]].forEach(([name, buffer, size]) => {
      const where = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(where);
      gl.vertexAttribPointer(where, size, gl.FLOAT, false, 0, 0);
    });
    gl.uniform3fv(this.at("ramp"), this.data.ramp.flatMap(rgb));
    gl.clearColor(1, 1, 1, 1);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  listen() {
    this.button.addEventListener("click", () => this.toggle());
    this.slider.addEventListener("input", () => { this.frame = Number(this.slider.value); this.draw(); });
    const held = new Map(), canvas = this.canvas;
    const apart = () => { const [a, b] = [...held.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
    canvas.addEventListener("pointerdown", (event) => {
      held.set(event.pointerId, { x: event.clientX, y: event.clientY });
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const between = held.size === 2 ? apart() : 0;
      held.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (held.size === 2) this.closer(apart() / Math.max(between, 1));
      else this.turn((before.x - event.clientX) / 200, (event.clientY - before.y) / 200);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => held.delete(e.pointerId));
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return; // the page scrolls
      event.preventDefault();
      this.closer(Math.exp(-event.deltaY / 300));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => { this.view = { ...HOME }; this.draw(); });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
      const nearer = { "+": 1.2, "-": 1 / 1.2 }[event.key];
      if (step) this.turn(...step);
      if (nearer) this.closer(nearer);
      if (step || nearer) event.preventDefault();
    });
    this.magnify.addEventListener("change", () => this.draw());
    this.lines.addEventListener("change", () => this.draw());
  }

  turn(azimuth, elevation) {
    this.view.azimuth += azimuth;
    this.view.elevation = Math.max(-1.5, Math.min(1.5, this.view.elevation + elevation));
    this.draw();
  }

  closer(factor) {
    this.view.zoom = Math.max(0.5, Math.min(12, this.view.zoom * factor));
    this.draw();
  }

  // A quantity between two frames, from its shapes.
  sum({ coefficients, shapes }, length) {
    const k = Math.min(Math.floor(this.frame), this.last - 1), part = this.frame - k, total = new Float32Array(length);
    shapes.forEach((shape, i) => {
      const a = coefficients[i][k] * (1 - part) + coefficients[i][k + 1] * part;
      for (let j = 0; j < length; j++) total[j] += a * shape[j];
    });
    return total;
  }

  between(values) {
    const k = Math.min(Math.floor(this.frame), this.last - 1), part = this.frame - k;
    return values[k] * (1 - part) + values[k + 1] * part;
  }

  get back() { return this.between(this.path); }

  draw() {
    const gl = this.pen, width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!gl || !width) return;
    const ratio = window.devicePixelRatio || 1;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.look(height / width);
    for (const body of this.bodies) this.body(body, this.bent(body));
    for (const block of this.data.near) this.block(block, 0);
    for (const block of this.data.tail) this.block(block, this.back);
    for (const section of this.data.section) this.section(section);
    if (this.pose) this.ground();
    const way = `${(this.data.length - this.back).toFixed(2)} m`;
    const angles = this.pose ? this.pose.angles.map((angle, k) => this.turnedBy(angle, k)) : [];
    this.say(`${this.clock}, ${this.data.alone ? `${way} beyond the mouth` : `boom length ${way}`}${angles.join("")}`);
  }

  // By luffing and, where it changes, by slewing.
  turnedBy(angle, k) {
    if (k && angle.every((value) => value === angle[0])) return "";
    return `, ${k ? "slewed" : "raised"} by ${this.between(angle).toFixed(1)}°`;
  }

  // Places along the boom's axes, in space.
  inSpace(places) {
    if (!this.pose) return places;
    const of = (values, count) => Array.from({ length: count }, (_, i) => this.component(values, i, count));
    const R = of(this.pose.rotation, 9), o = of(this.pose.origin, 3), found = new Float32Array(places.length);
    for (let i = 0; i < places.length; i += 3) {
      const [x, y, z] = [places[i] + o[0], places[i + 1] + o[1], places[i + 2] + o[2]];
      for (let j = 0; j < 3; j++) found[i + j] = R[3 * j] * x + R[3 * j + 1] * y + R[3 * j + 2] * z;
    }
    return found;
  }

  component(values, i, count) {
    const k = Math.min(Math.floor(this.frame), this.last - 1), part = this.frame - k;
    return values[k * count + i] * (1 - part) + values[(k + 1) * count + i] * part;
  }

  // Lines every 2 m on the level of the pivot, below the motion.
  ground() {
    const [[left, right], [near, far]] = this.field, lines = [];
    for (let at = left; at <= right; at += 2) lines.push(at, near, 0, at, far, 0);
    for (let at = near; at <= far; at += 2) lines.push(left, at, 0, right, at, 0);
    this.over(() => this.show(this.pen.LINES, new Float32Array(lines), null, [...rgb("#9aa5b1"), 0.5], false, false));
  }

  get field() {
    const half = Math.ceil(this.pose.size / 5) * 2;
    return this.pose.centre.slice(0, 2).map((at) => [Math.round(at / 2) * 2 - half, Math.round(at / 2) * 2 + half]);
  }

  // Half of what is seen across at first, m: the motion, and the whole of the ground.
  wide(aspect) {
    const { azimuth, elevation } = HOME, { centre: [x, y, z], size } = this.pose, [across, along] = this.field;
    const [c, s, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const corners = across.flatMap((X) => along.map((Y) => [X - x, Y - y]));
    const reach = Math.max(...corners.map(([X, Y]) => Math.abs(c * Y - s * X)), size / 2);
    const tall = Math.max(...corners.map(([X, Y]) => Math.abs(-se * (c * X + s * Y) - ce * z)), 0.4 * size);
    return 1.02 * Math.max(reach, tall / aspect, 0.5);
  }

  look(aspect) {
    const gl = this.pen, { azimuth, elevation, zoom } = this.view;
    const [c, s, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const back = this.data.back, front = this.data.length - this.path.reduce((a, b) => Math.min(a, b));
    const half = Math.max((front - back) / 2 + 0.25, 0.5) / zoom;
    gl.uniform3f(this.at("towards"), ce * c, ce * s, se);
    gl.uniform3f(this.at("right"), -s, c, 0);
    gl.uniform3f(this.at("above"), -se * c, -se * s, ce);
    if (this.pose) {
      const [x, y, z] = this.pose.centre, wide = this.wide(aspect) / zoom;
      gl.uniform3f(this.at("centre"), x, y, z);
      gl.uniform1f(this.at("deep"), 4 * this.pose.size);
      gl.uniform2f(this.at("size"), wide, wide * aspect);
      return;
    }
    const away = 1 / Math.max(zoom, 1); // who comes closer comes closer to the mouth
    gl.uniform3f(this.at("centre"), away * (front + back) / 2, 0, -0.2 * away);
    gl.uniform1f(this.at("deep"), front - back);
    gl.uniform2f(this.at("size"), half, half * aspect);
  }

  bent(body) {
    const moved = this.sum(body.motion, body.rest.length), scale = Number(this.magnify.value);
    const along = this.between(body.along);
    return body.rest.map((x, i) => x + scale * moved[i] + (i % 3 ? 0 : along));
  }

  body({ faces, triangles: corners, edges, stress: shapes }, places) {
    const gl = this.pen, count = corners.length;
    const stress = shapes && this.sum(shapes, faces);
    places = this.inSpace(places);
    const spread = new Float32Array(3 * count), values = new Float32Array(count);
    for (let i = 0; i < count; i++) {
      for (let j = 0; j < 3; j++) spread[3 * i + j] = places[3 * corners[i] + j];
      if (stress) values[i] = stress[Math.floor(i / 3) % faces];
    }
    this.show(gl.TRIANGLES, spread, values, [...rgb("#b9c4cd"), 1], Boolean(stress), true);
    if (!this.lines.checked) return;
    const ends = new Float32Array(3 * edges.length);
    edges.forEach((point, i) => { for (let j = 0; j < 3; j++) ends[3 * i + j] = places[3 * point + j]; });
    this.over(() => this.show(gl.LINES, ends, null, [...rgb("#1c2733"), 0.3], false, false));
  }

  block({ corners, sides }, back, colour = [...rgb("#3b4a57"), 1]) {
    const order = sides.flatMap(([a, b, c, d]) => [a, b, c, a, c, d]);
    const places = order.flatMap((k) => [corners[3 * k] - back, corners[3 * k + 1], corners[3 * k + 2]]);
    this.show(this.pen.TRIANGLES, this.inSpace(new Float32Array(places)), null, colour, false, true);
  }

  section({ corners, sides }) {
    const gl = this.pen, point = (k) => corners.slice(3 * k, 3 * k + 3);
    const outline = sides.flatMap((side) => side.flatMap((k, i) => [...point(k), ...point(side[(i + 1) % 4])]));
    this.over(() => {
      this.block({ corners, sides }, 0, [...rgb("#9fb0bd"), 0.16]);
      this.show(gl.LINES, this.inSpace(new Float32Array(outline)), null, [...rgb("#5b6875"), 0.5], false, false);
    });
  }

  // What is seen through and hides nothing.
  over(draw) {
    const gl = this.pen;
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    draw();
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  show(kind, places, values, colour, coloured, lit) {
    const gl = this.pen, count = places.length / 3;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.places);
    gl.bufferData(gl.ARRAY_BUFFER, places, gl.DYNAMIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.values);
    gl.bufferData(gl.ARRAY_BUFFER, values || new Float32Array(count), gl.DYNAMIC_DRAW);
    gl.uniform4f(this.at("plain"), ...colour);
    gl.uniform1i(this.at("coloured"), coloured);
    gl.uniform1i(this.at("lit"), lit);
    gl.uniform1f(this.at("nearer"), kind === gl.LINES ? 0.02 : 0); // m: lines lie on surfaces
    gl.drawArrays(kind, 0, count);
  }
}

document.querySelectorAll("figure.animation").forEach((figure) => new Player(figure));
