// The player of a boom: sections that slide in each other, and bars for the forces of their pads.
class BoomPlayer extends Playback {
  constructor(figure) {
    super(figure);
    const read = (one, names) => names.reduce((all, name) => ({ ...all, [name]: unpack(one[name]) }), { ...one });
    this.beams = this.data.beams.map((beam) => read(beam, ["w", "tail"]));
    this.pads = this.data.pads.map((pad) => read(pad, ["at", "force"]));
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }

  resize() {
    const width = this.canvas.clientWidth, ratio = window.devicePixelRatio || 1;
    if (!width) return;
    this.metre = (width - 36) / this.data.length;
    const [low, high] = this.data.reach.map((w) => w * this.data.scale * this.metre);
    this.middle = 70 + Math.max(high, 0);
    const height = this.middle + Math.max(-low, 0) + 90;
    this.canvas.style.height = `${height}px`;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    [this.width, this.height, this.ratio] = [width, height, ratio];
    this.draw();
  }

  place(beam, along, frame) {
    const x = along - beam.tail[frame], count = beam.x.length;
    let i = beam.x.findIndex((at) => at >= x);
    if (i < 0) i = count - 1;
    const w = (k) => beam.w[frame * count + k];
    if (i === 0) return w(0);
    const part = Math.min((x - beam.x[i - 1]) / (beam.x[i] - beam.x[i - 1]), 1);
    return w(i - 1) * (1 - part) + w(i) * part;
  }

  screen(along, w) { return [16 + along * this.metre, this.middle - w * this.data.scale * this.metre]; }

  draw() {
    if (!this.metre) return;
    const pen = this.canvas.getContext("2d"), frame = Math.round(this.frame), ink = "#5b6875";
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.font = "12px system-ui, sans-serif";
    let at = 16;
    for (const beam of this.beams) {
      [pen.strokeStyle, pen.fillStyle, pen.lineWidth] = [beam.colour, beam.colour, beam.width];
      pen.beginPath();
      beam.x.forEach((x, i) => pen.lineTo(...this.screen(beam.tail[frame] + x, beam.w[frame * beam.x.length + i])));
      pen.stroke();
      pen.fillRect(at, 7, 14, 4);
      pen.fillStyle = ink;
      pen.fillText(beam.label, at + 19, 14);
      at += 19 + pen.measureText(beam.label).width + 18;
    }
    pen.fillStyle = "#7b2d8e";
    for (const pad of this.pads) {
      const [x, y] = this.screen(pad.at[frame], this.place(this.beams[pad.section], pad.at[frame], frame));
      const size = 36 * Math.abs(pad.force[frame]);
      pen.fillRect(x - 3, pad.way > 0 ? y - 9 - size : y + 9, 6, size);
    }
    this.axis(pen, ink);
    this.say(this.clock);
  }

  axis(pen, ink) {
    const y = this.height - 34, length = this.data.length;
    const step = [1, 2, 5, 10].map((f) => f * 10 ** Math.floor(Math.log10(length / 5))).find((d) => length / d <= 6);
    [pen.fillStyle, pen.textAlign] = [ink, "center"];
    pen.fillRect(16, y, length * this.metre, 1);
    for (let i = 0; i * step <= length * 1.0001; i++) {
      pen.fillRect(16 + i * step * this.metre, y, 1, 4);
      pen.fillText(String(Number((i * step).toPrecision(6))), 16 + i * step * this.metre, y + 17);
    }
    pen.fillText("along the boom in m", 16 + length * this.metre / 2, y + 31);
    pen.textAlign = "left";
  }
}

document.querySelectorAll("figure.animation.boom").forEach((figure) => new BoomPlayer(figure));
