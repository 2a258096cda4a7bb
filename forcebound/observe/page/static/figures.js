// The figures: the values of now, each under its name.

import { text } from "./scale.js";
import { magnitude } from "./state.js";

const READABLE = 200; // ms between two values of a figure

export class Figures {
  /** @param list element for names and values */
  constructor(list) {
    this.list = list;
    this.places = new Map(); // name -> where its value stands
    this.shown = 0; // ms, when the values of a frame were shown last
    this.begin(0);
  }

  /** Begin with a graph whose ticks are `period` apart, in s. */
  begin(period) {
    this.period = period;
    this.latest = NaN; // s by which the latest tick of a second was late
    this.worst = 0; // the same of the second that goes on
    this.since = 0; // s, when that began
  }

  show(name, words) {
    if (!this.places.has(name)) {
      const pair = document.createElement("div"), dt = document.createElement("dt"), dd = document.createElement("dd");
      dt.textContent = name;
      pair.append(dt, dd);
      this.list.append(pair);
      this.places.set(name, dd);
    }
    const place = this.places.get(name);
    if (place.textContent !== words) place.textContent = words;
  }

  take(frame, now) {
    const time = frame.time.at(-1);
    this.worst = Math.max(this.worst, frame.longest - this.period);
    if (time - this.since >= 1) Object.assign(this, { latest: this.worst, worst: 0, since: time });
    if (now - this.shown < READABLE) return;
    this.shown = now;
    this.showAll(frame);
  }

  showAll(frame) {
    const newest = (name) => frame[name].at(-1) ?? NaN;
    this.show("position", `${newest("position").map((x) => text(1e3 * x)).join(", ")} mm`);
    this.show("commanded", `${text(magnitude(newest("commanded")))} N`);
    this.show("applied", `${text(magnitude(newest("applied")))} N`);
    this.show("limit", `${text(newest("limit"))} N`);
    this.show("true energy, this law", `${text(1e3 * newest("true_energy"))} mJ`);
    this.show("loop delay", `${text(1e3 * newest("delay"))} ms`);
    this.show("age of the reply", `${text(1e3 * newest("reply_age"))} ms`);
    this.show("latest tick", `${text(1e3 * this.latest)} ms`);
    this.show("missed ticks", String(frame.misses));
  }
}
