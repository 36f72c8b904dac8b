// The player of axes, of a body or of sections that slide in each other.  Models stand in lanes; a boom in a frame that
// moves is seen from the side, in the plane of luffing, and from above, where it slews.
const INK = "#1c2733", MUTED = "#5b6875", RULE = "#c9d1d9", GRID = "#e3e7eb", LOAD = "#7b2d8e", BAR = 32;
const unpackKeys = (part, ...keys) =>
  ({ ...part, ...Object.fromEntries(keys.filter((key) => part[key]).map((key) => [key, unpack(part[key])])) });

class AxisPlayer extends Playback {
  constructor(figure) {
    super(figure);
    const { lanes, pads, loads, angles, s } = this.data;
    this.overlay = figure.querySelector("input[type=checkbox]");
    this.models = lanes.map(({ label, beams }) => ({ label, beams: beams.map((beam) => unpackKeys(beam, "w", "v", "tail")) }));
    this.sections = this.models[0].beams.length > 1;
    this.pads = pads.map((pad) => unpackKeys(pad, "at", "force"));
    this.loads = loads.map((load) => unpackKeys(load, "force", "moment"));
    this.angles = angles.map(unpack);
    this.s = unpack(s);
    this.hoist = this.data.hoist && unpack(this.data.hoist);
    this.turns = this.angles.length > 0;
    const { beams } = this.models[0], tip = beams[beams.length - 1], frames = this.turns ? this.data.frames : 0;
    this.way = Array.from({ length: frames }, (_, k) => this.turned(this.point(tip, tip.x.length - 1, k), k));
    this.overlay?.addEventListener("change", () => this.resize());
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }

  // Where a point along the boom's axes is: distance in the plane of luffing and height, and X and Y.
  turned([x, y, z], frame) {
    const [c, s, cz, sz] = this.turns
      ? this.angles.flatMap((angle) => [Math.cos(angle[frame]), Math.sin(angle[frame])]) : [1, 0, 1, 0];
    const out = x * c - z * s;
    return { side: [out, x * s + z * c], plan: [out * cz - y * sz, out * sz + y * cz] };
  }

  tail(beam, frame) { return beam.tail ? beam.tail[frame] : 0; }

  point(beam, i, frame) {
    const k = frame * beam.x.length + i, [px, py, pz] = this.data.pivot, { scale } = this.data;
    return [px + this.tail(beam, frame) + beam.x[i], py + scale * (beam.v ? beam.v[k] : 0), pz + scale * beam.w[k]];
  }

  // The point `position` m from a body's tail, which bends as between the two points next to it.
  at(beam, position, frame) {
    const next = beam.x.findIndex((x) => x >= position), j = next < 0 ? beam.x.length - 1 : Math.max(next, 1);
    const [a, b] = [this.point(beam, j - 1, frame), this.point(beam, j, frame)];
    const part = Math.max(0, Math.min((position - beam.x[j - 1]) / (beam.x[j] - beam.x[j - 1]), 1));
    const [, y, z] = a.map((value, i) => value + part * (b[i] - value));
    return [this.data.pivot[0] + this.tail(beam, frame) + position, y, z];
  }

  lanes(width) {
    const [low, high, bottom, up] = this.data.views.side, metre = (width - 36) / (high - low), bars = this.pads.length ? BAR : 0;
    const above = up * metre + 40 + bars, tall = above - bottom * metre + 26 + bars;
    const groups = this.overlay?.checked ? [this.models] : this.models.map((model) => [model]);
    return groups.map((models, k) => {
      const top = k * tall, ends = { top, ceiling: top + 18, floor: top + tall };
      return { view: "side", models, metre, x: 16, y: top + above, low, high, bottom, up, ...ends, last: k === groups.length - 1 };
    });
  }

  seenFromSides(width) {
    const views = Object.entries(this.data.views), beside = views.length > 1 && width > 640, each = beside ? width / 2 : width;
    const metre = Math.min(...views.map(([, [low, high, bottom, up]]) =>
      Math.min((each - 74) / (high - low), 460 / Math.max(up - bottom, 1e-9))));
    let [left, top] = [0, 0];
    return views.map(([view, [low, high, bottom, up]]) => {
      const floor = top + Math.max((up - bottom) * metre, 60) + 44, ends = { top, ceiling: floor - (up - bottom) * metre, floor };
      const panel = { view, models: this.models, metre, x: left + 46 - low * metre, y: floor + bottom * metre };
      if (beside) left += each; else top = floor + 40;
      return { ...panel, low, high, bottom, up, ...ends, last: true };
    });
  }

  resize() {
    const width = this.canvas.clientWidth, ratio = window.devicePixelRatio || 1;
    if (!width) return;
    this.panels = this.turns ? this.seenFromSides(width) : this.lanes(width);
    const height = Math.max(...this.panels.map(({ floor }) => floor)) + 40;
    [this.width, this.height, this.ratio] = [width, height, ratio];
    this.canvas.style.height = `${height}px`;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    this.draw();
  }

  draw() {
    const pen = this.canvas.getContext("2d"), frame = Math.round(this.frame);
    if (!this.panels) return;
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.font = "12px system-ui, sans-serif";
    for (const panel of this.panels) {
      const on = ([across, up]) => [panel.x + across * panel.metre, panel.y - up * panel.metre];
      const seen = (point) => on(this.turned(point, frame)[panel.view]);
      this.axes(pen, panel, on);
      this.line(pen, this.way.slice(0, frame + 1).map((at) => on(at[panel.view])), "#9aa5b1", 1, [4, 3]);
      this.fixtures(pen, on, frame);
      for (const model of panel.models) for (const beam of model.beams) this.beam(pen, panel, beam, seen, frame);
      const { beams } = panel.models[panel.models.length - 1];
      if (panel.view === "side") this.bars(pen, beams, seen, frame);
      this.arrows(pen, panel, beams, seen, frame);
      if (this.hoist) this.rope(pen, seen, frame);
      if (this.turns) this.pivot(pen, on([0, 0]), panel.view);
      this.names(pen, panel, frame);
    }
    const tip = this.turns && this.way[frame].side.map((value) => value.toFixed(1));
    this.say(tip ? `${this.clock}, tip ${tip[0]} m out, ${tip[1]} m up` : this.clock);
  }

  write(pen, text, x, y, align, colour = INK) {
    pen.fillStyle = colour;
    pen.textAlign = align;
    pen.fillText(text, x, y);
  }

  fill(pen, corners, colour) {
    pen.fillStyle = colour;
    pen.beginPath();
    for (const [x, y] of corners) pen.lineTo(x, y);
    pen.fill();
  }

  disc(pen, x, y, radius, colour) {
    pen.fillStyle = colour;
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.fill();
  }

  axes(pen, { view, metre, low, high, bottom, up, ceiling, floor, last }, on) {
    const most = Math.max(high - low, this.turns ? up - bottom : 0);
    const step = [1, 2, 5, 10, 20].map((f) => f * 10 ** Math.floor(Math.log10(most / 5)))
      .find((d) => most / d <= 6 && d * metre > 26) || most;
    const ticks = (from, to) => {
      const first = Math.ceil(from / step - 1e-9), count = Math.floor(to / step + 1e-9) - first + 1;
      return Array.from({ length: Math.max(count, 0) }, (_, i) => Number(((first + i) * step).toPrecision(6)));
    };
    for (const at of ticks(low, high)) {
      const [x] = on([at, 0]);
      this.line(pen, [[x, floor], [x, ceiling]], GRID, 1);
      if (last) this.write(pen, String(at), x, floor + 16, "center", MUTED);
    }
    for (const at of this.turns ? ticks(bottom, up) : []) {
      const [[x, y], end] = [on([low, at]), on([high, at])];
      this.line(pen, [[x, y], end], GRID, 1);
      this.write(pen, String(at), x - 6, y + 4, "right", MUTED);
    }
    if (last) this.write(pen, view === "side" ? this.data.label : "X and Y in m", on([(low + high) / 2, 0])[0], floor + 33, "center", MUTED);
    const ground = [on([low, 0]), on([high, 0])];
    if (view === "side") this.line(pen, ground, this.turns ? MUTED : RULE, this.turns ? 2 : 1, this.turns ? [] : [3, 3]);
  }

  beam(pen, { models }, beam, seen, frame) {
    const apart = models.length === 1, wider = this.sections ? 1 : 1.6;
    const width = apart && !this.sections ? 3 : wider * beam.width;
    this.line(pen, beam.x.map((_, i) => seen(this.point(beam, i, frame))), beam.colour, width, apart ? [] : beam.dash.map((d) => d * 1.6));
  }

  // Supports, and sliders or pads that move along a body.
  fixtures(pen, on, frame) {
    for (const { at, kind } of this.data.supports) {
      const [x, y] = on([at, 0]);
      pen.fillStyle = INK;
      if (kind === "clamped") { pen.fillRect(x - 3, y - 12, 6, 24); continue; }
      this.fill(pen, [[x, y], [x - 7, y + 12], [x + 7, y + 12]], INK);
      if (kind === "roller") pen.fillRect(x - 8, y + 14, 16, 2);
    }
    for (const offset of this.data.offsets) for (const side of [-1, 1]) {
      const [x, y] = on([this.s[frame] + offset, 0]);
      this.disc(pen, x, y + side * 7, 5, MUTED);
      pen.fillRect(x - 9, y + side * 14 - 1, 18, 2);
    }
  }

  // Forces of pads below and above, across the boom.
  bars(pen, beams, seen, frame) {
    for (const pad of this.pads) {
      const beam = beams[pad.section], own = this.at(beam, pad.at[frame] - this.tail(beam, frame), frame);
      const [[x, y], [ux, uy]] = [seen(own), seen([own[0], own[1], own[2] + pad.way])];
      const size = Math.hypot(ux - x, uy - y) || 1, [nx, ny] = [(ux - x) / size, (uy - y) / size];
      const far = 8 + BAR * Math.abs(pad.force[frame]);
      this.line(pen, [[x + 8 * nx, y + 8 * ny], [x + far * nx, y + far * ny]], LOAD, 6);
    }
  }

  arrows(pen, { view, metre }, beams, seen, frame) {
    for (const load of this.loads) {
      const own = this.at(beams[load.section], load.at, frame), foot = seen(own);
      if (load.moment && view === "side") this.moment(pen, foot, load.moment[frame], load.name);
      if (!load.force) continue;
      const force = [0, 1, 2].map((i) => load.force[3 * frame + i]);
      const [dx, dy] = seen(own.map((value, i) => value + force[i])).map((value, i) => value - foot[i]);
      const size = Math.hypot(dx, dy), part = size / metre; // of the largest, as it is seen
      if (part < 0.02) continue;
      const [nx, ny] = [dx / size, dy / size], long = 10 + 26 * part;
      const [x, y] = [foot[0] + long * nx, foot[1] + long * ny];
      this.line(pen, [foot, [x, y]], LOAD, 1.5);
      this.fill(pen, [[0, 0], [-7, 3], [-7, -3]].map(([a, b]) => [x + a * nx - b * ny, y + a * ny + b * nx]), LOAD);
      this.write(pen, load.name, x - 6, y - 6, "right", LOAD);
    }
  }

  // The rope of a hoist from its head sheaves to its hook, and the payload.
  rope(pen, seen, frame) {
    const [head, hook] = [0, 1].map((end) => seen([0, 1, 2].map((i) => this.hoist[6 * frame + 3 * end + i])));
    this.line(pen, [head, hook], INK, 1);
    pen.fillStyle = INK;
    pen.fillRect(hook[0] - 5, hook[1] - 5, 10, 10);
  }

  moment(pen, [x, y], part, name) {
    if (Math.abs(part) < 0.02) return;
    const end = -part * 1.5 * Math.PI, radius = 12;
    pen.strokeStyle = LOAD;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.arc(x, y, radius, 0, end, end < 0);
    pen.stroke();
    this.disc(pen, x + radius * Math.cos(end), y + radius * Math.sin(end), 3, LOAD);
    this.write(pen, name, x - 6, y - 16, "right", LOAD);
  }

  pivot(pen, [x, y], view) {
    if (view === "plan") this.disc(pen, x, y, 5, INK);
    else this.fill(pen, [[x, y - 2], [x - 8, y + 12], [x + 8, y + 12]], INK);
  }

  names(pen, { view, models, x: origin, metre, low, top }, frame) {
    let x = origin + low * metre, y = top + 12;
    if (this.turns) {
      const [luffing, slewing] = this.angles.map((angle) => `${(angle[frame] * 180 / Math.PI).toFixed(1)}°`);
      this.write(pen, view === "side" ? `From the side, raised by ${luffing}` : `From above, slewed by ${slewing}`, x, y, "left");
      if (!this.sections || view !== "side") return;
      y += 16;
    } else if (this.sections && this.models.length > 1) {
      const text = `${models.map(({ label }) => label).join(", ")}:`;
      this.write(pen, text, x, y, "left");
      x += pen.measureText(text).width + 18;
    }
    for (const { label, colour } of this.sections ? models[0].beams : models.flatMap(({ beams }) => beams)) {
      this.line(pen, [[x, y - 4], [x + 14, y - 4]], colour, 3);
      this.write(pen, label, x + 19, y, "left");
      x += pen.measureText(label).width + 37;
    }
  }
}

document.querySelectorAll("figure.animation.axis").forEach((figure) => new AxisPlayer(figure));
