// The player of a boom in a frame that moves: from the side, in the plane of luffing, and from above, where it slews.
class SpacePlayer extends Playback {
  constructor(figure) {
    super(figure);
    const { lanes: [{ beams }], pads, loads, angles } = this.data;
    this.beams = beams.map((beam) =>
      ({ ...beam, w: unpack(beam.w), v: beam.v && unpack(beam.v), tail: beam.tail && unpack(beam.tail) }));
    this.pads = pads.map((pad) => ({ ...pad, at: unpack(pad.at), force: unpack(pad.force) }));
    this.loads = loads.filter((load) => load.force).map((load) => ({ ...load, force: unpack(load.force) }));
    this.angles = angles.map(unpack);
    const tip = this.beams[this.beams.length - 1];
    this.way = Array.from({ length: this.data.frames }, (_, k) => this.place(tip, tip.x.length - 1, k));
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }

  // Where a point along the boom's axes is: distance in the plane of luffing, height, X, Y.
  turned([x, y, z], frame) {
    const [c, s, cz, sz] = this.angles.flatMap((angle) => [Math.cos(angle[frame]), Math.sin(angle[frame])]);
    const out = x * c - z * s;
    return { side: [out, x * s + z * c], plan: [out * cz - y * sz, out * sz + y * cz] };
  }

  own(beam, i, frame) {
    const k = frame * beam.x.length + i, [px, py, pz] = this.data.pivot, { scale } = this.data;
    return [px + (beam.tail ? beam.tail[frame] : 0) + beam.x[i], py + scale * (beam.v ? beam.v[k] : 0), pz + scale * beam.w[k]];
  }

  place(beam, i, frame) { return this.turned(this.own(beam, i, frame), frame); }

  // Between two points of a body, `position` m from its tail.
  at(beam, position, frame) {
    const next = beam.x.findIndex((x) => x >= position), j = next < 0 ? beam.x.length - 1 : Math.max(next, 1);
    const [a, b] = [this.own(beam, j - 1, frame), this.own(beam, j, frame)];
    const part = (position - beam.x[j - 1]) / (beam.x[j] - beam.x[j - 1]);
    return a.map((value, i) => value + Math.max(0, Math.min(part, 1)) * (b[i] - value));
  }

  resize() {
    const width = this.canvas.clientWidth, { side, plan } = this.data;
    if (!width) return;
    const beside = plan && width > 640, each = beside ? width / 2 : width, tallest = 460;
    this.views = [["side", side], ["plan", plan]].filter(([, reached]) => reached);
    let [left, top] = [0, 0];
    const metre = Math.min(...this.views.map(([, [low, high, bottom, up]]) =>
      Math.min((each - 74) / (high - low), tallest / Math.max(up - bottom, 1e-9))));
    this.views = this.views.map(([name, [low, high, bottom, up]]) => {
      const tall = Math.max((up - bottom) * metre, 60) + 84;
      const view = { name, metre, x: left + 46 - low * metre, y: top + tall - 40 + bottom * metre, low, high, bottom, up };
      if (beside) left += each; else top += tall;
      return { ...view, tall };
    });
    const height = beside ? Math.max(...this.views.map(({ tall }) => tall)) : top;
    const ratio = window.devicePixelRatio || 1;
    [this.width, this.height, this.ratio] = [width, height, ratio];
    this.canvas.style.height = `${height}px`;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    this.draw();
  }

  draw() {
    const pen = this.canvas.getContext("2d"), frame = Math.round(this.frame);
    if (!this.views) return;
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.font = "12px system-ui, sans-serif";
    const degrees = this.angles.map((angle) => `${(angle[frame] * 180 / Math.PI).toFixed(1)}°`);
    for (const view of this.views) {
      const on = ([across, up]) => [view.x + across * view.metre, view.y - up * view.metre];
      const seen = (own) => on(this.turned(own, frame)[view.name]);
      this.axes(pen, view, on);
      this.line(pen, this.way.slice(0, frame + 1).map((at) => on(at[view.name])), "#9aa5b1", 1, [4, 3]);
      for (const beam of this.beams) {
        this.line(pen, beam.x.map((_, i) => on(this.place(beam, i, frame)[view.name])), beam.colour, beam.width);
      }
      if (view.name === "side") this.bars(pen, seen, frame);
      this.arrows(pen, seen, frame, view.metre);
      this.pivot(pen, on([0, 0]), view.name);
      const said = view.name === "side" ? `From the side, raised by ${degrees[0]}` : `From above, slewed by ${degrees[1]}`;
      const [x, y] = on([view.low, view.up]);
      this.write(pen, said, x, y - 26, "left");
      if (this.beams.length > 1 && view.name === "side") this.names(pen, x, y - 10);
    }
    const end = this.way[frame].side.map((value) => value.toFixed(1));
    this.say(`${this.clock}, tip ${end[0]} m out, ${end[1]} m up`);
  }

  write(pen, text, x, y, align, colour = "#1c2733") {
    pen.fillStyle = colour;
    pen.textAlign = align;
    pen.fillText(text, x, y);
  }

  axes(pen, { name, metre, low, high, bottom, up }, on) {
    const muted = "#5b6875", grid = "#e3e7eb", most = Math.max(high - low, up - bottom);
    const step = [1, 2, 5, 10, 20].map((f) => f * 10 ** Math.floor(Math.log10(most / 5)))
      .find((d) => most / d <= 6 && d * metre > 26) || most;
    const ticks = (from, to) => {
      const first = Math.ceil(from / step - 1e-9), count = Math.floor(to / step + 1e-9) - first + 1;
      return Array.from({ length: Math.max(count, 0) }, (_, i) => Number(((first + i) * step).toPrecision(6)));
    };
    for (const at of ticks(low, high)) {
      this.line(pen, [on([at, bottom]), on([at, up])], grid, 1);
      this.write(pen, String(at), on([at, bottom])[0], on([at, bottom])[1] + 16, "center", muted);
    }
    for (const at of ticks(bottom, up)) {
      this.line(pen, [on([low, at]), on([high, at])], grid, 1);
      this.write(pen, String(at), on([low, at])[0] - 6, on([low, at])[1] + 4, "right", muted);
    }
    const [x, y] = on([(low + high) / 2, bottom]);
    this.write(pen, name === "side" ? "distance and height in m" : "X and Y in m", x, y + 34, "center", muted);
    if (name === "side") this.line(pen, [on([low, 0]), on([high, 0])], muted, 2);
  }

  names(pen, x, y) {
    for (const { label, colour } of this.beams) {
      this.line(pen, [[x, y - 4], [x + 14, y - 4]], colour, 3);
      this.write(pen, label, x + 19, y, "left");
      x += pen.measureText(label).width + 36;
    }
  }

  pivot(pen, [x, y], name) {
    pen.fillStyle = "#1c2733";
    pen.beginPath();
    if (name === "plan") pen.arc(x, y, 5, 0, 2 * Math.PI);
    else for (const [dx, dy] of [[0, -2], [-8, 12], [8, 12]]) pen.lineTo(x + dx, y + dy);
    pen.fill();
  }

  // Forces of pads below and above, across the boom.
  bars(pen, seen, frame) {
    for (const pad of this.pads) {
      const beam = this.beams[pad.section], own = this.at(beam, pad.at[frame] - (beam.tail ? beam.tail[frame] : 0), frame);
      const [[x, y], [ux, uy]] = [seen(own), seen([own[0], own[1], own[2] + pad.way])];
      const size = Math.hypot(ux - x, uy - y) || 1, [nx, ny] = [(ux - x) / size, (uy - y) / size];
      const far = 7 + 30 * Math.abs(pad.force[frame]);
      this.line(pen, [[x + 7 * nx, y + 7 * ny], [x + far * nx, y + far * ny]], "#7b2d8e", 5);
    }
  }

  arrows(pen, seen, frame, metre) {
    for (const load of this.loads) {
      const force = [0, 1, 2].map((i) => load.force[3 * frame + i]);
      const own = this.at(this.beams[load.section], load.at, frame), foot = seen(own);
      const [dx, dy] = seen(own.map((value, i) => value + force[i])).map((value, i) => value - foot[i]);
      const size = Math.hypot(dx, dy), part = size / metre; // of the largest, as it is seen
      if (part < 0.02) continue;
      const [nx, ny] = [dx / size, dy / size], long = 10 + 26 * part;
      const [x, y] = [foot[0] + long * nx, foot[1] + long * ny];
      this.line(pen, [foot, [x, y]], "#7b2d8e", 1.5);
      pen.fillStyle = "#7b2d8e";
      pen.beginPath();
      for (const [a, b] of [[0, 0], [-7, 3], [-7, -3]]) pen.lineTo(x + a * nx - b * ny, y + a * ny + b * nx);
      pen.fill();
      this.write(pen, load.name, x - 6, y - 6, "right", "#7b2d8e");
    }
  }
}

document.querySelectorAll("figure.animation.space").forEach((figure) => new SpacePlayer(figure));
