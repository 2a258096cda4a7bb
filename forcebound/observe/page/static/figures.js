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

  clear() {
    this.places.clear();
    this.list.replaceChildren();
  }

  /** Show the values of a frame; `whose`: words before their names. */
  showAll(frame, whose = "") {
    const newest = (name) => frame[name].at(-1) ?? NaN, show = (name, words) => this.show(whose + name, words);
    show("position", `${newest("position").map((x) => text(1e3 * x)).join(", ")} mm`);
    show("commanded", `${text(magnitude(newest("commanded")))} N`);
    show("applied", `${text(magnitude(newest("applied")))} N`);
    show("limit", `${text(newest("limit"))} N`);
    show("true energy, this law", `${text(1e3 * newest("true_energy"))} mJ`);
    show("loop delay", `${text(1e3 * newest("delay"))} ms`);
    show("age of the reply", `${text(1e3 * newest("reply_age"))} ms`);
    show("missed ticks", String(frame.misses));
  }
}
