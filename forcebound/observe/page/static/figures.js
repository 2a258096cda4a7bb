// The figures: the values of now, each under its name.

import { everyday, magnitude, quantity, si, text } from "./scale.js";

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
    const [factor, unit] = everyday(si.position);
    show("position", `${newest("position").map((x) => text(factor * x)).join(", ")} ${unit}`);
    show("commanded", quantity(magnitude(newest("commanded")), si.force));
    show("applied", quantity(magnitude(newest("applied")), si.force));
    show("limit", quantity(newest("limit"), si.force));
    show("true energy, this law", quantity(newest("true_energy"), "J"));
    show("loop delay", quantity(newest("delay"), "s"));
    show("age of the reply", quantity(newest("reply_age"), "s"));
    show("missed ticks", String(frame.misses));
  }
}
