// Samples of the last seconds, and the window of time that all plots show.

const SECONDS = 10; // that plots show at first
const SHORTEST = 0.05, LONGEST = 3600; // s that plots can show
const FINEST = 0.02; // s of a step of the history, at first

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

  /** Push several: their times, and of each name a column with a value for each. */
  pushAll(times, columns) {
    const { count, capacity } = this;
    for (const name of Object.keys(columns)) if (!this.values.has(name)) this.values.set(name, new Float64Array(capacity).fill(NaN));
    times.forEach((time, i) => { this.time[(count + i) % capacity] = time; });
    for (const [name, own] of this.values) for (let i = 0; i < times.length; i += 1) own[(count + i) % capacity] = columns[name]?.[i] ?? NaN;
    this.count += times.length;
  }

  get oldest() { return this.count ? this.time[Math.max(0, this.count - this.capacity) % this.capacity] : Infinity; }

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

/** The whole run in bounded memory: the lowest and the highest of each step, which is twice as long each time all is full. */
export class History extends Samples {
  constructor(capacity = 20000) {
    super(capacity);
    this.step = FINEST;
    this.open = null; // the step that goes on: {end, low, high}
  }

  /** Take samples: their times, and of each name a column with a value for each. */
  take(times, columns) {
    const all = Object.entries(columns);
    for (let from = 0, to = 0; from < times.length; from = to) {
      if (this.open && times[from] >= this.open.end) {
        if (this.count >= this.capacity) this.halve();
        for (const side of ["low", "high"]) this.push(this.open.end - this.step, this.open[side]);
        this.open = null;
      }
      this.open ??= { end: times[from] + this.step, low: {}, high: {} };
      const { low, high, end } = this.open;
      for (to = from + 1; to < times.length && times[to] < end;) to += 1;
      for (const [name, column] of all) {
        let least = low[name] ?? Infinity, most = high[name] ?? -Infinity;
        for (let i = from; i < to; i += 1) {
          const value = column[i] ?? NaN; // no comparison with NaN is true
          if (value < least) least = value;
          if (value > most) most = value;
        }
        if (least <= most) [low[name], high[name]] = [least, most];
      }
    }
  }

  /** Have half as many steps, each twice as long. */
  halve() {
    for (let to = 0, from = 0; from < this.count; from += 4, to += 2) {
      this.time[to] = this.time[to + 1] = this.time[from];
      for (const column of this.values.values()) {
        const both = [...column.slice(from, from + 4)].filter((value) => !Number.isNaN(value));
        [column[to], column[to + 1]] = both.length ? [Math.min(...both), Math.max(...both)] : [NaN, NaN];
      }
    }
    this.count /= 2;
    this.step *= 2;
  }

  clear() { super.clear(); Object.assign(this, { open: null, step: FINEST }); }
}

/** The window of time that all plots show; paused, zoomed and pointed at together. */
export class Window {
  constructor() {
    this.live = new Map(); // samples by hand
    this.histories = new Map(); // of the whole run, by hand
    this.samples = this.live; // that are shown: of a pause a copy, since the rings go on
    this.seconds = SECONDS;
    this.end = null; // null: now
    this.age = null; // s before the right end, of the cursor; null: there is none
    this.marks = []; // {time, law, hand}: where another law began
  }

  /** Have samples of these hands, whose names those of before may be. */
  begin(hands) {
    for (const name of this.live.keys()) if (!hands.includes(name)) for (const all of [this.live, this.histories]) all.delete(name);
    for (const name of hands) {
      if (!this.live.has(name)) this.live.set(name, new Samples());
      if (!this.histories.has(name)) this.histories.set(name, new History());
      this.live.get(name).push(this.live.get(name).newest, {}); // a gap: it may be another graph
    }
  }

  /** Take samples of a hand: their times, and of each name a column with a value for each. */
  take(hand, times, columns) {
    this.live.get(hand).pushAll(times, columns);
    this.histories.get(hand).take(times, columns);
  }

  /** The samples of a hand that have the window: all, or of a time long ago the steps of the history. */
  of(hand) {
    const all = this.samples.get(hand), history = this.histories.get(hand);
    return all && history?.count && Math.max(this.from, history.oldest) < all.oldest ? history : all;
  }

  /** What a hand had at the end of the window, by name; null: it shows now. */
  past(hand) {
    if (this.end === null) return null;
    const samples = this.of(hand), index = Math.max(samples.first(this.end + 1e-9) - 1, 0);
    return (name) => samples.values.get(name)?.[index % samples.capacity] ?? NaN;
  }

  /** When the run that is kept began, in s. */
  get oldest() { return Math.min(this.newest, ...[...this.histories.values()].filter(({ count }) => count).map(({ oldest }) => oldest)); }

  /** Show the time until `end`, in s, while the run goes on; null: now. */
  scrub(end) {
    if (this.samples !== this.live) this.pause(false);
    this.end = end === null || end >= this.latest ? null : Math.max(end, this.oldest);
  }

  /** When the law of a hand at the window's end began, in s. */
  since(hand) { return this.marks.findLast((one) => one.hand === hand && one.time <= this.to)?.time ?? 0; }

  /** Mark that another law of a hand begins. */
  mark(time, law, hand) {
    if (time === this.marks.findLast((one) => one.hand === hand)?.time) return;
    this.marks = [...this.marks, { time, law, hand }].filter((one) => one.hand !== hand || one.time > time - LONGEST); // as far as one can see
  }

  get isPaused() { return this.end !== null; } // or shows what was
  get newest() { return Math.max(0, ...[...this.samples.values()].map((each) => each.newest)); }
  get latest() { return Math.max(0, ...[...this.live.values()].map((each) => each.newest)); } // also in a pause
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
