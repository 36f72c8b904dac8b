// What players share: 16-bit series, and time that a button starts and a slider sets.
const unpack = (series) => {
  const bytes = Uint8Array.from(atob(series.data), (c) => c.charCodeAt(0));
  const counts = new DataView(bytes.buffer);
  return Float32Array.from({ length: bytes.length / 2 }, (_, i) => counts.getInt16(2 * i, true) * series.count);
};

// Reads the JSON in its figure; `draw` shows the frame, which may lie between two.
class Playback {
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
    this.button.addEventListener("click", () => this.toggle());
    this.slider.addEventListener("input", () => { this.frame = Number(this.slider.value); this.draw(); });
  }

  get last() { return this.data.frames - 1; }

  get time() {
    const [start, end] = this.data.times;
    return start + (end - start) * this.frame / Math.max(this.last, 1);
  }

  get clock() { return `t = ${this.time.toFixed(this.data.times[1] < 1 ? 4 : 2)} s`; }

  say(text) {
    this.output.textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
  }

  line(pen, points, colour, width, dash = []) {
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.beginPath();
    points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
    pen.setLineDash([]);
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
}

