// Plots of the last seconds, on canvases. All of them share one window of time.

import { colour, fit } from "./canvas.js";
import { everyday, rangeOf, text, ticks } from "./scale.js";

const GAP = -1; // in place of a column of pixels
const MARGIN = { left: 46, right: 10, top: 24, bottom: 18 };
const TOGETHER = 1; // s between hands that take a law in one change, and share one mark
const ROW = 14; // pixels of a second line of the title, for a key that has no room beside it
const MARKS = 14; // pixels for the names of laws, below the key
const MANY = 1e3; // from so many of its unit on, a plot is in its larger one
const COLOURS = ["true", "second", "energy", "commanded", "limit"]; // of axes and signals, one after the other

/**
 * The plots. `si` is the unit of the values; large ones are shown in it, with `isWide`; `least` is the smallest range, in the everyday unit; with `isOfLaw` the law in use sets
 * the range. A further curve is one more line {name, label, colour, isArea} here, or one more plot, and a value of that
 * name in the samples. `overview`: the one value of each hand that is shown while several hands share the plots.
 */
export const PLOTS = {
  position: { title: "Position", si: "m", least: 1, lines: [] },
  force: { title: "Force", si: "N", least: 1, isOfLaw: true, overview: "applied", lines: [
    { name: "limit", label: "limit", colour: "limit", isArea: true },
    { name: "commanded", label: "commanded", colour: "commanded" },
    { name: "applied", label: "applied", colour: "true" },
  ] },
  energy: { title: "Energy", si: "J", isWide: true, least: 1, isOfLaw: true, overview: "known_energy", lines: [
    { name: "energy", label: "estimated", colour: "energy" },
    { name: "true_energy", label: "true", colour: "true" },
  ] },
  delay: { title: "Loop delay", si: "s", least: 0.1, overview: "delay", lines: [{ name: "delay", label: "delay", colour: "true" }] },
};

const DASHES = [[], [7, 4], [2, 4]]; // of the axes of several hands, whose curves have the colours of the hands

/** The lines of a plot for `hands`, whose axes have `names`: of one all that it has, of several an overview. */
export function linesOf({ lines, overview }, names, hands) {
  if (hands.length > 1 && overview) return hands.map(({ name, colour }) => ({ name: overview, label: name, colour, hand: name }));
  if (lines.length) return lines.map((line) => ({ ...line, hand: hands[0].name }));
  const own = names.map((label, i) => ({ name: `p${i}`, label, colour: COLOURS[i % COLOURS.length], dash: DASHES[Math.floor(i / COLOURS.length)] }));
  if (hands.length < 2) return own.map((line) => ({ ...line, hand: hands[0].name }));
  return hands.flatMap(({ name, colour }) => own.map((line, i) => ({ ...line, label: i ? "" : name, colour, hand: name, dash: DASHES[i % DASHES.length] })));
}

/** Lines over time, on a canvas that is added to an element. */
export class Plot {
  constructor(parent, shown, spec) {
    const canvas = Object.assign(document.createElement("canvas"), { className: "plot", role: "img", ariaLabel: `${spec.title} over time` });
    parent.append(canvas);
    Object.assign(this, { canvas, shown }, spec);
    for (const kind of ["pointermove", "pointerdown"]) canvas.addEventListener(kind, (event) => { // a finger only taps
      const share = (event.offsetX - MARGIN.left) / (canvas.clientWidth - MARGIN.left - MARGIN.right);
      shown.age = share >= 0 && share <= 1 ? (1 - share) * shown.seconds : null;
    });
    canvas.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") shown.age = null; });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      shown.zoom(1.25 ** Math.sign(event.deltaY));
    }, { passive: false });
  }

  get scale() { return everyday(this.si)[0]; }
  get unit() { return this.isLarge ? this.si : everyday(this.si)[1]; }

  draw() {
    const { context, width, height } = fit(this.canvas);
    const { from, to } = this.shown;
    this.head = MARGIN.top + (this.keyWidth(context) > width - MARGIN.right ? ROW : 0);
    const marks = this.shownMarks.filter(({ time }) => time > from && time <= to);
    const right = width - MARGIN.right, bottom = height - MARGIN.bottom, top = this.head + (marks.length ? MARKS : 0);
    const x = (time) => MARGIN.left + ((time - from) / (to - from)) * (right - MARGIN.left);
    const drawn = this.lines.map((line) => this.columns(line, x));
    const inUse = drawn.flatMap((columns, i) => {
      const since = this.isOfLaw ? Math.ceil(x(this.shown.since(this.lines[i].hand))) : GAP;
      return columns.filter(({ at }) => at > since);
    });
    [this.low, this.high] = rangeOf(inUse, GAP, this.least);
    const { low, high } = this;
    this.isLarge = Boolean(this.isWide) && Math.max(-low, high) >= MANY;
    const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
    this.drawAxes(context, { x, y, low, high, from, to, right, bottom, top });
    context.save();
    context.beginPath();
    context.rect(MARGIN.left, top, right - MARGIN.left, bottom - top);
    context.clip();
    this.lines.forEach((line, i) => this.drawLine(context, line, drawn[i], y));
    context.restore();
    this.drawMarks(context, marks, x, right, bottom);
    this.drawKey(context, right);
  }

  drawAxes(context, { x, y, low, high, from, to, right, bottom, top }) {
    context.strokeStyle = colour("line");
    context.fillStyle = colour("soft");
    context.lineWidth = 1;
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const tick of ticks(low, high, 3)) {
      context.beginPath();
      context.moveTo(MARGIN.left, y(tick));
      context.lineTo(right, y(tick));
      context.stroke();
      const level = Math.min(Math.max(y(tick), top + 5), bottom - 5); // not over others
      context.fillText(text(this.shownAs(tick)), MARGIN.left - 5, level);
    }
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const tick of ticks(from - to, 0, 4)) context.fillText(`${text(tick)} s`, Math.min(x(to + tick), right - 12), bottom + 4);
  }

  /** The lowest and the highest sample in each column of pixels, in the plot's unit; at GAP there is none. */
  columns(line, x) {
    const { from, to } = this.shown, samples = this.shown.of(line.hand), found = [];
    if (!samples) return found;
    const { capacity } = samples, values = samples.values.get(line.name), first = samples.first(from), last = samples.first(to + 1e-9);
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

  /** Where another law began: {time, words}; of several hands with their names, unless they took one law together. */
  get shownMarks() {
    const hands = [...new Set(this.lines.map(({ hand }) => hand))], found = [];
    for (const { time, law, hand } of this.shown.marks.filter((one) => hands.includes(one.hand))) {
      const near = found.find((one) => Math.abs(one.time - time) < TOGETHER && !one.all.some((own) => own.hand === hand));
      if (near) near.all.push({ law, hand }); else found.push({ time, all: [{ law, hand }] });
    }
    return found.map(({ time, all }) => ({ time, words: all.length === hands.length && all.every(({ law }) => law === all[0].law) ? all[0].law
      : all.map(({ law, hand }) => `${hand}: ${law}`).join(", ") }));
  }

  /** Draw where another law began, with its name above the curves. */
  drawMarks(context, marks, x, right, bottom) {
    context.strokeStyle = context.fillStyle = colour("soft");
    context.lineWidth = 1;
    context.setLineDash([3, 3]);
    context.textBaseline = "top";
    let free = right; // up to here there are no words yet: the newest law comes first
    for (const { time, words } of marks.toReversed()) {
      const wide = context.measureText(words).width, isLeft = x(time) + 4 + wide < free, hasRoom = isLeft || x(time) - 4 < free;
      context.textAlign = isLeft ? "left" : "right";
      context.beginPath();
      context.moveTo(x(time), this.head);
      context.lineTo(x(time), bottom);
      context.stroke();
      if (!hasRoom) continue;
      context.fillText(words, x(time) + (isLeft ? 4 : -4), this.head);
      free = x(time) - (isLeft ? 0 : wide + 8);
    }
    context.setLineDash([]);
  }

  drawLine(context, line, columns, y) {
    context.strokeStyle = context.fillStyle = colour(line.colour);
    context.lineWidth = 1.5;
    context.setLineDash(line.dash ?? []);
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
    context.setLineDash([]);
  }

  /** What each line has at the cursor, or now. */
  get readings() {
    const { cursor, to } = this.shown;
    return this.lines.filter((line) => line.label).flatMap((line) => {
      const samples = this.shown.of(line.hand), values = samples?.values.get(line.name);
      if (!values || !samples.count) return [];
      const index = Math.min(samples.first(cursor ?? to), samples.count - 1);
      return [{ line, words: `${line.label} ${text(this.shownAs(values[index % samples.capacity] * this.scale))}` }];
    });
  }

  /** A value in the plot's unit as it is shown: large ones in the larger unit. */
  shownAs(value) { return this.isLarge ? value / MANY : value; }

  /** Title and unit. */
  get name() { return this.unit ? `${this.title}, ${this.unit}` : this.title; }

  /** The same in words, for those who do not see it. */
  get inWords() { return `${this.name}: ${this.readings.map(({ words }) => words).join(", ")}`; }

  /** Pixels that the title and the key need on one line, with values of usual length. */
  keyWidth(context) {
    const wide = (words) => context.measureText(words).width;
    return this.lines.filter((line) => line.label).reduce((sum, { label }) => sum + wide(`${label} -00.0`) + 24, 1.1 * wide(this.name) + 28);
  }

  drawKey(context, right) {
    const { cursor, from, to } = this.shown;
    context.textBaseline = "top";
    context.textAlign = "left";
    context.fillStyle = colour("text");
    context.font = context.font.replace("12px", "600 12px");
    const title = `${this.name}${cursor === null ? "" : ` at ${text(cursor - to)} s`}`, row = this.head - MARGIN.top, begin = row ? -22 : context.measureText(title).width;
    context.fillText(title, 6, 5);
    context.font = context.font.replace(/^\w+ /, "");
    context.textAlign = "right";
    let place = right;
    for (const { line, words } of this.readings.reverse()) {
      const wide = (what) => context.measureText(what).width > place - begin - 28;
      let fits = words;
      for (let n = line.label.length - 1; n > 2 && wide(fits); n -= 1) fits = words.replace(line.label, `${line.label.slice(0, n)}…`);
      if (wide(fits)) break; // no room
      context.fillStyle = colour("text");
      context.fillText(fits, place, 5 + row);
      place -= context.measureText(fits).width + 4;
      context.fillStyle = colour(line.colour);
      context.fillRect(place - 10, row + (line.isArea ? 6 : 9), 10, line.isArea ? 9 : 3);
      place -= 20;
    }
    if (cursor === null) return;
    const x = MARGIN.left + ((cursor - from) / (to - from)) * (right - MARGIN.left);
    context.strokeStyle = colour("soft");
    context.beginPath();
    context.moveTo(x, this.head);
    context.lineTo(x, this.canvas.clientHeight - MARGIN.bottom);
    context.stroke();
  }
}

/** One plot for each unit of the signals that the parts of a graph publish for `hands`; canvases are added to `place`. */
export function signalPlots(place, shown, published, hands) {
  const signals = published.filter(({ hand }) => hands.some(({ name }) => name === hand));
  return [...new Set(signals.map(({ unit }) => unit))].map((unit) => {
    const lines = signals.filter((each) => each.unit === unit)
      .map(({ name, label, hand }, i) => ({ name, hand, label: hands.length > 1 ? `${hand} ${label}` : label, colour: COLOURS[i % COLOURS.length] }));
    return new Plot(place, shown, { title: "Signals", si: unit === "1" ? "" : unit, least: 1e-6, lines });
  });
}
