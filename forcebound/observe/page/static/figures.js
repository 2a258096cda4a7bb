// The figures: the values of now, each under its name.

import { text } from "./scale.js";
import { magnitude } from "./state.js";

export class Figures {
  /** @param list element for names and values */
  constructor(list) {
    this.list = list;
    this.places = new Map(); // name -> where its value stands
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

  showAll(frame) {
    const newest = (name) => frame[name].at(-1) ?? NaN;
    this.show("position", `${newest("position").map((x) => text(1e3 * x)).join(", ")} mm`);
    this.show("commanded", `${text(magnitude(newest("commanded")))} N`);
    this.show("applied", `${text(magnitude(newest("applied")))} N`);
    this.show("limit", `${text(newest("limit"))} N`);
    this.show("true energy, this law", `${text(1e3 * newest("true_energy"))} mJ`);
    this.show("loop delay", `${text(1e3 * newest("delay"))} ms`);
    this.show("age of the reply", `${text(1e3 * newest("reply_age"))} ms`);
    this.show("missed ticks", String(frame.misses));
  }
}
