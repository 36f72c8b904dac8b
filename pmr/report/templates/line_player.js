// The player of axes, of a body or of sections that slide in each other: it draws on a canvas.
const INK = "#1c2733", MUTED = "#5b6875", RULE = "#c9d1d9", LOAD = "#7b2d8e", BAR = 36;

class LinePlayer extends Playback {
  constructor(figure) {
    super(figure);
    this.overlay = figure.querySelector("input[type=checkbox]");
    this.models = this.data.lanes.map(({ label, beams }) => ({
      label,
      beams: beams.map((beam) => ({ ...beam, w: unpack(beam.w), tail: beam.tail && unpack(beam.tail) })),
    }));
    this.sections = this.models[0].beams.length > 1;
    this.pads = this.data.pads.map((pad) => ({ ...pad, at: unpack(pad.at), force: unpack(pad.force) }));
    this.s = unpack(this.data.s);
    this.loads = this.data.loads.map(({ force, moment, ...load }) =>
      ({ ...load, force: force && unpack(force), moment: moment && unpack(moment) }));
    this.overlay?.addEventListener("change", () => this.resize());
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }

  resize() {
    const width = this.canvas.clientWidth, ratio = window.devicePixelRatio || 1;
    if (!width) return;
    const lanes = this.overlay?.checked ? 1 : this.models.length;
    this.left = 16;
    this.metre = (width - this.left - 20) / this.data.length;
    const [low, high] = this.data.reach.map((w) => w * this.data.scale * this.metre);
    const bars = this.pads.length ? BAR : 0;
    this.above = Math.max(high, 0) + 34 + bars;
    this.lane = this.above + Math.max(-low, 0) + 30 + bars;
    this.lanes = lanes;
    const height = lanes * this.lane + 44;
    if (this.height !== height || this.width !== width) {
      [this.width, this.height] = [width, height];
      this.canvas.style.height = `${height}px`;
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
    }
    this.ratio = ratio;
    this.draw();
  }

  draw() {
    const pen = this.canvas.getContext("2d"), frame = Math.round(this.frame);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.font = "12px system-ui, sans-serif";
    for (let lane = 0; lane < this.lanes; lane++) {
      const shown = this.lanes === 1 ? this.models : [this.models[lane]];
      const y = lane * this.lane + this.above, last = shown[shown.length - 1].beams;
      this.rest(pen, y);
      this.fixtures(pen, y, frame);
      for (const model of shown) for (const beam of model.beams) this.beam(pen, y, beam, frame);
      this.bars(pen, y, last, frame);
      this.forces(pen, y, last, frame);
      this.names(pen, lane * this.lane + 12, shown);
    }
    this.axis(pen);
    this.say(this.clock);
  }

  x(position) { return this.left + position * this.metre; }

  deflection(beam, i, frame) { return -beam.w[frame * beam.x.length + i] * this.data.scale * this.metre; }

  tail(beam, frame) { return beam.tail ? beam.tail[frame] : 0; }

  at(beam, position, frame) {
    let i = beam.x.findIndex((x) => x >= position);
    if (i < 0) i = beam.x.length - 1;
    if (i === 0) return this.deflection(beam, 0, frame);
    const part = Math.min((position - beam.x[i - 1]) / (beam.x[i] - beam.x[i - 1]), 1);
    return this.deflection(beam, i - 1, frame) * (1 - part) + this.deflection(beam, i, frame) * part;
  }

  rest(pen, y) { this.line(pen, [[this.x(0), y], [this.x(this.data.length), y]], RULE, 1, [3, 3]); }

  beam(pen, y, beam, frame) {
    const tail = this.tail(beam, frame);
    const points = beam.x.map((x, i) => [this.x(tail + x), y + this.deflection(beam, i, frame)]);
    const apart = this.lanes > 1 || this.models.length === 1, width = this.sections ? beam.width : 3;
    this.line(pen, points, beam.colour, apart || this.sections ? width : beam.width * 1.6,
      apart ? [] : beam.dash.map((d) => d * 1.6));
  }

  bars(pen, y, beams, frame) {
    pen.fillStyle = LOAD;
    for (const pad of this.pads) {
      const beam = beams[pad.section], size = BAR * Math.abs(pad.force[frame]);
      const foot = y + this.at(beam, pad.at[frame] - this.tail(beam, frame), frame);
      pen.fillRect(this.x(pad.at[frame]) - 3, pad.way > 0 ? foot - 9 - size : foot + 9, 6, size);
    }
  }

  fixtures(pen, y, frame) {
    pen.fillStyle = INK;
    for (const support of this.data.supports) {
      const x = this.x(support.at);
      if (support.kind === "clamped") { pen.fillRect(x - 3, y - 12, 6, 24); continue; }
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x - 7, y + 12);
      pen.lineTo(x + 7, y + 12);
      pen.fill();
      if (support.kind === "roller") pen.fillRect(x - 8, y + 14, 16, 2);
    }
    pen.fillStyle = MUTED;
    for (const offset of this.data.offsets) {
      const x = this.x(this.s[frame] + offset);
      for (const side of [-1, 1]) {
        pen.beginPath();
        pen.arc(x, y + side * 7, 5, 0, 2 * Math.PI);
        pen.fill();
        pen.fillRect(x - 9, y + side * 14 - 1, 18, 2);
      }
    }
  }

  forces(pen, y, beams, frame) {
    for (const load of this.loads) {
      const beam = beams[load.section];
      const [along, up] = load.force ? [load.force[3 * frame], load.force[3 * frame + 2]] : [0, load.moment[frame]];
      if (Math.hypot(along, up) < 0.02) continue;
      const x = this.x(this.tail(beam, frame) + load.at), foot = y + this.at(beam, load.at, frame);
      if (load.moment) this.moment(pen, x, foot, up);
      else this.arrow(pen, x, foot, along, -up);
      pen.fillStyle = LOAD;
      pen.textAlign = "right";
      pen.fillText(load.name, x - 6, foot + (load.force && up < 0 ? 18 : -10));
    }
  }

  arrow(pen, x, y, dx, dy) {
    const size = 24 * Math.hypot(dx, dy), [ex, ey] = [dx, dy].map((d) => 24 * d / size);
    const [tx, ty] = [x + size * ex, y + size * ey], head = Math.min(6, size);
    this.line(pen, [[x, y], [tx - head * ex, ty - head * ey]], LOAD, 1.5);
    pen.fillStyle = LOAD;
    pen.beginPath();
    pen.moveTo(tx, ty);
    pen.lineTo(tx - head * ex - 3 * ey, ty - head * ey + 3 * ex);
    pen.lineTo(tx - head * ex + 3 * ey, ty - head * ey - 3 * ex);
    pen.fill();
  }

  moment(pen, x, y, part) {
    const end = -part * 1.5 * Math.PI, radius = 12;
    pen.strokeStyle = LOAD;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.arc(x, y, radius, 0, end, end < 0);
    pen.stroke();
    pen.fillStyle = LOAD;
    pen.beginPath();
    pen.arc(x + radius * Math.cos(end), y + radius * Math.sin(end), 3, 0, 2 * Math.PI);
    pen.fill();
  }

  names(pen, y, shown) {
    pen.textAlign = "left";
    let x = this.left;
    const say = (label, colour) => {
      if (colour) {
        pen.fillStyle = colour;
        pen.fillRect(x, y - 5, 14, 3);
        x += 19;
      }
      pen.fillStyle = INK;
      pen.fillText(label, x, y);
      x += pen.measureText(label).width + 18;
    };
    if (this.sections && this.models.length > 1) say(`${shown.map((model) => model.label).join(", ")}:`);
    const named = this.sections ? shown[0].beams : shown.flatMap((model) => model.beams);
    for (const beam of named) say(beam.label, beam.colour);
  }

  axis(pen) {
    const y = this.height - 38, length = this.data.length;
    const step = [1, 2, 5, 10].map((f) => f * 10 ** Math.floor(Math.log10(length / 5))).find((d) => length / d <= 6);
    this.line(pen, [[this.x(0), y], [this.x(length), y]], MUTED, 1);
    pen.fillStyle = MUTED;
    pen.textAlign = "center";
    for (let i = 0; i * step <= length * 1.0001; i++) {
      this.line(pen, [[this.x(i * step), y], [this.x(i * step), y + 4]], MUTED, 1);
      pen.fillText(String(Number((i * step).toPrecision(6))), this.x(i * step), y + 17);
    }
    pen.fillText(this.data.label, this.x(length / 2), y + 33);
  }
}

document.querySelectorAll("figure.animation.line").forEach((figure) => new LinePlayer(figure));
