// Plots of the last seconds, on canvases. All of them share one window of time.

const SECONDS = 10;
const GAP = -1; // in place of a column of pixels
const MARGIN = { left: 52, right: 8, top: 18, bottom: 18 };

const colours = new Map(); // reading a style makes the browser compute all that has changed
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => colours.clear());

/** A colour of the style sheet. */
export function colour(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return colours.get(name);
}

/** Samples of the last seconds: a ring of times and of named values. */
export class Samples {
  constructor(capacity = 60000) {
    this.capacity = capacity;
    this.time = new Float64Array(capacity);
    this.values = new Map();
    this.count = 0; // ever pushed
  }

  push(time, values) {
    const at = this.count % this.capacity;
    this.time[at] = time;
    for (const column of this.values.values()) column[at] = NaN; // of what has no value now
    for (const [name, value] of Object.entries(values)) {
      if (!this.values.has(name)) this.values.set(name, new Float64Array(this.capacity).fill(NaN));
      this.values.get(name)[at] = value === null || value === undefined ? NaN : value;
    }
    this.count += 1;
  }

  get newest() {
    return this.count ? this.time[(this.count - 1) % this.capacity] : 0;
  }

  /** First sample, counted from the beginning, that is not before `time`. */
  first(time) {
    let low = Math.max(0, this.count - this.capacity);
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[middle % this.capacity] < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  clear() { this.count = 0; }
}

/** The window of time that all plots show; paused, zoomed and pointed at together. */
export class Window {
  constructor(samples) {
    this.samples = samples;
    this.seconds = SECONDS;
    this.end = null; // null: now
    this.age = null; // s before the right end, of the cursor; null: there is none
  }

  get to() { return this.end ?? this.samples.newest; }
  get from() { return this.to - this.seconds; }
  get cursor() { return this.age === null ? null : this.to - this.age; }
  step(seconds) { this.age = Math.min(Math.max((this.age ?? this.seconds / 2) - seconds, 0), this.seconds); }
  pause(isPaused) { this.end = isPaused ? this.samples.newest : null; }
  zoom(factor) { this.seconds = Math.min(Math.max(this.seconds * factor, 0.05), 60); }
}

/** Clear a canvas and give it the size that `shown`, an element of the page, has. */
export function fit(canvas, shown = canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = shown;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "12px system-ui, sans-serif";
  return { context, width, height };
}

function ticks(low, high, wanted) {
  const rough = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= rough);
  const found = [];
  for (let tick = Math.ceil(low / step) * step; tick <= high + step * 1e-9; tick += step) found.push(tick);
  return found;
}

export const text = (value) =>
  Number.isFinite(value) ? String(Number(value.toPrecision(3))) : "–";

/** Lines over time. */
export class Plot {
  /**
   * @param lines [{name, label, colour, isArea}], in the order in which they are drawn
   * @param unit as shown; `scale` turns SI into it
   */
  constructor(canvas, shown, title, unit, scale, lines) {
    Object.assign(this, { canvas, shown, title, unit, scale, lines });
    canvas.addEventListener("pointermove", (event) => {
      const share = (event.offsetX - MARGIN.left) / (canvas.clientWidth - MARGIN.left - MARGIN.right);
      shown.age = share >= 0 && share <= 1 ? (1 - share) * shown.seconds : null;
    });
    canvas.addEventListener("pointerleave", () => { shown.age = null; });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      shown.zoom(event.deltaY > 0 ? 1.25 : 0.8);
    }, { passive: false });
  }

  draw() {
    const { context, width, height } = fit(this.canvas);
    const { samples, from, to } = this.shown;
    const first = samples.first(from), last = samples.first(to + 1e-9);
    const right = width - MARGIN.right, bottom = height - MARGIN.bottom;
    const x = (time) => MARGIN.left + ((time - from) / (to - from)) * (right - MARGIN.left);
    const drawn = this.lines.map((line) => this.columns(line, first, last, x));
    let low = 0, high = 0;
    for (const column of drawn.flat()) {
      low = Math.min(low, column.low);
      high = Math.max(high, column.high);
    }
    if (high - low < 1e-9) high = low + 1;
    const room = 0.06 * (high - low);
    low -= room; high += room;
    const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - MARGIN.top);
    this.drawAxes(context, { x, y, low, high, from, to, right, bottom });
    context.save();
    context.beginPath();
    context.rect(MARGIN.left, MARGIN.top, right - MARGIN.left, bottom - MARGIN.top);
    context.clip();
    this.lines.forEach((line, i) => this.drawLine(context, line, drawn[i], y));
    context.restore();
    this.drawKey(context, right);
  }

  drawAxes(context, { x, y, low, high, from, to, right, bottom }) {
    context.strokeStyle = colour("line");
    context.fillStyle = colour("soft");
    context.lineWidth = 1;
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const tick of ticks(low, high, 4)) {
      context.beginPath();
      context.moveTo(MARGIN.left, y(tick));
      context.lineTo(right, y(tick));
      context.stroke();
      if (y(tick) < bottom - 5) context.fillText(text(tick), MARGIN.left - 5, y(tick));
    }
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const tick of ticks(from - to, 0, 5)) context.fillText(`${text(tick)} s`, Math.min(x(to + tick), right - 12), bottom + 4);
  }

  /** The lowest and the highest sample in each column of pixels, in the plot's unit; at GAP there is none. */
  columns(line, first, last, x) {
    const { samples } = this.shown, { capacity } = samples;
    const values = samples.values.get(line.name), found = [];
    let column = { at: GAP, low: 0, high: 0 };
    for (let i = first; values && i < last; i += 1) {
      const value = values[i % capacity] * this.scale;
      const at = Number.isNaN(value) ? GAP : Math.round(x(samples.time[i % capacity]));
      if (at !== column.at) found.push(column = at === GAP ? { at, low: 0, high: 0 } : { at, low: value, high: value });
      else if (value < column.low) column.low = value;
      else if (value > column.high) column.high = value;
    }
    return found;
  }

  drawLine(context, line, columns, y) {
    context.strokeStyle = context.fillStyle = colour(line.colour);
    context.lineWidth = 1.5;
    context.beginPath();
    let before = GAP;
    for (const { at, low, high } of [...columns, { at: GAP }]) {
      if (line.isArea) {
        if (before === GAP) context.moveTo(at, y(0));
        if (at === GAP) context.lineTo(before, y(0)); else context.lineTo(at, y(high));
      } else if (at !== GAP) {
        if (before === GAP) context.moveTo(at, y(low)); else context.lineTo(at, y(low));
        if (high !== low) context.lineTo(at, y(high));
      }
      before = at;
    }
    if (line.isArea) context.fill(); else context.stroke();
  }

  drawKey(context, right) {
    const { samples, cursor, from, to } = this.shown;
    const at = cursor ?? to;
    const index = Math.min(samples.first(at), samples.count - 1);
    context.textBaseline = "top";
    context.textAlign = "left";
    context.fillStyle = colour("text");
    context.fillText(`${this.title} (${this.unit})`, 4, 3);
    context.textAlign = "right";
    let place = right;
    for (const line of [...this.lines].reverse()) {
      const values = samples.values.get(line.name);
      if (!values || index < 0) continue;
      const words = `${line.label} ${text(values[index % samples.capacity] * this.scale)}`;
      context.fillStyle = colour("text");
      context.fillText(words, place, 3);
      place -= context.measureText(words).width + 4;
      context.fillStyle = colour(line.colour);
      context.fillRect(place - 12, line.isArea ? 4 : 7, 12, line.isArea ? 9 : 3);
      place -= 24;
    }
    if (cursor === null) return;
    const x = MARGIN.left + ((cursor - from) / (to - from)) * (right - MARGIN.left);
    context.strokeStyle = colour("soft");
    context.beginPath();
    context.moveTo(x, MARGIN.top);
    context.lineTo(x, this.canvas.clientHeight - MARGIN.bottom);
    context.stroke();
  }
}

/** How often each delay came, in the window. */
export class Histogram {
  constructor(canvas, shown, name, title, unit, scale) {
    Object.assign(this, { canvas, shown, name, title, unit, scale });
  }

  draw() {
    const { context, width, height } = fit(this.canvas);
    const { samples, from, to } = this.shown;
    const values = samples.values.get(this.name);
    const first = samples.first(from), last = values ? samples.first(to + 1e-9) : first;
    const known = Float64Array.from({ length: last - first }, (_, i) => values[(first + i) % samples.capacity] * this.scale)
      .filter((value) => !Number.isNaN(value)).sort();
    const at = (share) => known[Math.min(known.length - 1, Math.floor(share * known.length))];
    const high = Math.max(known.length ? at(0.999) * 1.1 : 1, 1e-3);
    const bins = new Array(40).fill(0);
    for (const value of known) bins[Math.min(bins.length - 1, Math.floor((value / high) * bins.length))] += 1;
    const most = Math.max(...bins, 1), right = width - MARGIN.right, bottom = height - MARGIN.bottom;
    const step = (right - MARGIN.left) / bins.length;
    context.fillStyle = colour("true");
    bins.forEach((count, i) => {
      const tall = (count / most) * (bottom - MARGIN.top);
      context.fillRect(MARGIN.left + i * step, bottom - tall, step - 1, tall);
    });
    context.fillStyle = colour("soft");
    context.textBaseline = "top";
    context.textAlign = "center";
    for (const tick of ticks(0, high, 6)) context.fillText(text(tick), MARGIN.left + (tick / high) * (right - MARGIN.left), bottom + 4);
    context.fillStyle = colour("text");
    context.textAlign = "left";
    context.fillText(`${this.title} (${this.unit})`, 4, 3);
    context.textAlign = "right";
    if (known.length) context.fillText(`p50 ${text(at(0.5))}  p99 ${text(at(0.99))}  max ${text(known.at(-1))}`, right, 3);
  }
}
