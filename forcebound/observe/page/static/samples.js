// Samples of the last seconds, and the window of time that all plots show.

const SECONDS = 10; // that plots show at first
const SHORTEST = 0.05, LONGEST = 60; // s that plots can show

/** A ring of times and of named values. */
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

  copy() {
    const copy = new Samples(this.capacity);
    copy.time.set(this.time);
    for (const [name, column] of this.values) copy.values.set(name, column.slice());
    copy.count = this.count;
    return copy;
  }
}

/** The window of time that all plots show; paused, zoomed and pointed at together. */
export class Window {
  constructor() {
    this.live = new Map(); // samples by hand
    this.samples = this.live; // that are shown: of a pause a copy, since the rings go on
    this.seconds = SECONDS;
    this.end = null; // null: now
    this.age = null; // s before the right end, of the cursor; null: there is none
    this.marks = []; // {time, law, hand}: where another law began
  }

  /** Have samples of these hands, whose names those of before may be. */
  begin(hands) {
    for (const name of this.live.keys()) if (!hands.includes(name)) this.live.delete(name);
    for (const name of hands) {
      if (!this.live.has(name)) this.live.set(name, new Samples());
      this.live.get(name).push(this.live.get(name).newest, {}); // a gap: it may be another graph
    }
  }

  /** When the law of a hand at the window's end began, in s. */
  since(hand) { return this.marks.findLast((one) => one.hand === hand && one.time <= this.to)?.time ?? 0; }

  /** Mark that another law of a hand begins. */
  mark(time, law, hand) {
    if (time === this.marks.findLast((one) => one.hand === hand)?.time) return;
    this.marks = [...this.marks, { time, law, hand }].filter((one) => one.hand !== hand || one.time > time - LONGEST);
  }

  get isPaused() { return this.end !== null; }
  get newest() { return Math.max(0, ...[...this.samples.values()].map((each) => each.newest)); }
  get to() { return this.end ?? this.newest; }
  get from() { return this.to - this.seconds; }
  get cursor() { return this.age === null ? null : this.to - this.age; }
  step(seconds) { this.age = Math.min(Math.max((this.age ?? this.seconds / 2) - seconds, 0), this.seconds); }

  pause(isPaused) {
    this.samples = isPaused ? new Map([...this.live].map(([hand, each]) => [hand, each.copy()])) : this.live;
    this.end = isPaused ? this.newest : null;
  }

  /** Show so many times as much time; in a pause, what is under the cursor stays there. */
  zoom(factor) {
    const before = this.seconds;
    this.seconds = Math.min(Math.max(before * factor, SHORTEST), LONGEST);
    if (this.age === null) return;
    const { cursor } = this;
    this.age *= this.seconds / before;
    if (this.isPaused) this.end = Math.min(cursor + this.age, this.newest);
  }
}
