// The controls: fields for the parameters, the law, nodes that stop and start, two buttons for visitors.

import { ofHand } from "./hands.js";
import { si, units } from "./scale.js";

const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

/** The number of a quantity in SI units, of those that a slider has. */
const siOf = (text) => parseFloat(text) / (Object.values(units).find(([, unit]) => unit === text.split(" ")[1])?.[0] ?? 1);

const SMALL = 10; // of a unit; below, the everyday one is shown
const RECORD = "Record";
const LAW = "device.law";
const FIRST = ["none", "certified"]; // laws that are offered at once
const STIFFNESS = "environment.stiffness";
const DELAYS = ["links.environment_query.delay", "links.environment_reply.delay"];
const SOFTEST = 2, HARDEST = 5; // powers of ten of the stiffness slider, in N/m; of angles a hundredth
const SLOWEST = 20; // ms, of the delay slider

/** A quantity as one would write it: `5 ms` for `0.005 s`, `10 N/mm` for `10000 N/m`. */
export function readable(text) {
  const [, number, si] = /^(-?[\d.]+(?:e[+-]?\d+)?) (\S.*)$/.exec(text) ?? [];
  const [factor, unit] = units[si] ?? [];
  const isEveryday = factor < 1 ? Math.abs(number) * factor >= 1 : factor && Math.abs(number) < SMALL;
  return isEveryday ? `${Number((number * factor).toPrecision(12))} ${unit}` : text;
}

export class Controls {
  /** @param send sends a request to the server and returns its number */
  constructor(send) {
    this.send = send;
    this.fields = new Map(); // name of a parameter -> {input, range, fault, value}
    this.pending = new Map(); // number of a request -> what its answer is for
    this.rows = new Map(); // node -> cells of its row
    this.record = make("button", { type: "button", id: "record", textContent: RECORD });
    this.record.addEventListener("click", () => this.ask({ do: this.record.textContent === RECORD ? "record" : "end_recording" }, this.record));
    this.recorded = make("small", { id: "recorded", role: "status" });
    this.episodes = make("small", { id: "episodes", role: "status" });
    this.episode = Object.fromEntries(["start", "keep", "discard"].map((action) => {
      const button = make("button", { type: "button", id: `episode-${action}`, textContent: action });
      button.addEventListener("click", () => this.ask({ do: "episode", action }, button));
      return [action, button];
    }));
    this.shows = { none: document.getElementById("break"), certified: document.getElementById("safe") };
    this.shows.none.addEventListener("click", () => this.ask({ do: "break" }, this.shows.none));
    this.shows.certified.addEventListener("click", () => this.ask({ do: "safe" }, this.shows.certified));
  }

  /** Ask the server for a change; `element` is busy until the answer is here. */
  ask(request, element, done = () => {}) {
    element.setAttribute("aria-busy", "true");
    this.preparing = { break: "none", safe: "certified" }[request.do]
      ?? Object.entries(request.settings ?? {}).find(([name]) => name.endsWith(LAW))?.[1] ?? this.preparing;
    this.pending.set(this.send(request), (error) => {
      element.removeAttribute("aria-busy");
      if (!this.pending.size) this.preparing = undefined;
      document.getElementById("error").textContent = done(error) ? "" : error ?? "";
      this.showLaw();
    });
  }

  answer({ id, error }) {
    const answered = this.pending.get(id);
    this.pending.delete(id);
    answered?.(error);
  }

  /** Build what the graph has; its values come with `parameters`. */
  describe(hello) {
    for (const id of [...this.pending.keys()]) this.answer({ id, error: "no answer: the connection was lost" });
    if (hello.graph === this.graph) return; // connected again: what one has typed or opened stays
    this.graph = hello.graph;
    this.fields.clear();
    this.laws = hello.hands.map(({ name }) => this.lawOf(name, hello.laws));
    this.rows.clear();
    const outage = make("button", { type: "button", id: "outage", textContent: "lose all for 0.5 s" });
    outage.addEventListener("click", () => this.ask({ do: "outage", time: "500 ms" }, outage));
    const stiffness = this.input(STIFFNESS, make("small", { id: `r-${STIFFNESS}`, className: "spoken" }));
    const turned = si.stiffness === "N/m" ? 0 : 2;
    const [hardness, ...delays] = this.sliders = [
      this.slider("stiffness", { min: SOFTEST - turned, max: HARDEST - turned, step: 0.05, shown: stiffness }, {
        words: (power) => readable(`${Number((10 ** power).toPrecision(2))} ${si.stiffness}`), names: [STIFFNESS],
        read: ([text]) => Math.log10(Math.max(siOf(text), 1)) }),
      ...hello.hands.map(({ name: hand }) => this.slider("delay each way", { min: 0, max: SLOWEST, step: 0.5, shown: make("output") }, {
        words: (delay) => `${delay} ms`, names: DELAYS.map((name) => ofHand(hand, name)), read: (texts) => 1e3 * Math.max(...texts.map(siOf)) })),
    ];
    const [network, environment] = ["network", "environment"].map((id) => document.querySelector(`#${id} > fieldset`));
    this.groups = new Map([[ofHand(hello.hands[0].name, "links"), network], ["environment", environment]]); // part -> where its fields are
    this.parts = new Map(); // of several hands, by name: the parts of the page that are its own
    const [law] = this.laws;
    const main = hello.hands.length < 2 ? [law.row, ...this.sliders.map((slider) => slider.row)] : [hardness.row];
    if (hello.hands.length > 1) hello.hands.forEach(({ name, colour }, i) => {
      const part = make("div", { className: "own" }, make("h2", { textContent: name }), this.laws[i].row, delays[i].row);
      const links = make("details", {}, make("summary", { textContent: name }));
      part.style.setProperty("--hand", `var(--${colour})`);
      this.groups.set(`${name}.links`, links);
      this.parts.set(name, [part, links]);
      main.push(part);
    });
    document.getElementById("controls").replaceChildren(
      ...main,
      make("div", { className: "field" }, make("label", { htmlFor: "record", textContent: "recording" }), this.record, this.recorded),
      make("div", { className: "field" }, make("label", { htmlFor: "episode-start", textContent: "episode" }), ...Object.values(this.episode), this.episodes),
    );
    const links = [...this.parts.values()].map(([, details]) => details);
    network.replaceChildren(make("div", { className: "field" }, make("label", { htmlFor: "outage", textContent: "outage" }), outage), ...links);
    environment.replaceChildren();
  }

  /** Show what belongs to some hands, and to no other one. */
  choose(names) {
    for (const [name, parts] of this.parts) for (const part of parts) part.hidden = !names.includes(name);
  }

  /** The row for the law of a hand: a list, and a switch. */
  lawOf(hand, names) {
    const id = ["law", hand].filter(Boolean).join("-"), name = ofHand(hand, LAW);
    const list = make("select", { id }), power = make("button", { type: "button", id: id.replace("law", "power"), role: "switch", ariaLabel: "a law bounds the force" });
    const law = { name, list, power, present: undefined, before: "certified" }; // before: the law that the switch turns on
    const offer = (all) => list.replaceChildren(...all.map((each) => new Option(each, each)), ...(all.length < names.length ? [new Option("more laws …", "")] : []));
    law.isFolded = true;
    law.show = () => { // two laws and that of now; the others are behind the last entry
      const all = law.isFolded ? names.filter((each) => each === law.present || FIRST.includes(each)) : names;
      if (all.length !== [...list.options].filter(({ value }) => value).length || ![...list.options].some(({ value }) => value === law.present)) offer(all);
      list.value = law.present;
    };
    list.addEventListener("change", () => {
      if (list.value) this.ask({ do: "set", settings: { [name]: list.value } }, list);
      else {
        law.isFolded = false;
        law.show();
        try { list.showPicker(); } catch { list.focus(); } // where a browser opens it only by hand
      }
    });
    power.addEventListener("click", () => this.ask({ do: "set", settings: { [name]: law.present === "none" ? law.before : "none" } }, power));
    law.row = make("div", { className: "field law" }, make("label", { htmlFor: id, textContent: "law" }), power, list);
    return law;
  }

  /** The law of now; of several hands, each that there is. */
  get present() { return [...new Set(this.laws.map(({ present }) => present))].join(" and "); }

  /** A slider for parameters, beside what shows its value; `words` of its number is what is sent. */
  slider(label, { min, max, step, shown }, { words, names, read }) {
    const range = make("input", { type: "range", min, max, step, id: `s-${names[0]}` });
    const row = make("div", { className: "field" }, make("label", { htmlFor: range.id, textContent: label }), shown, range);
    if (this.fields.has(names[0])) row.append(this.fields.get(names[0]).range, this.fields.get(names[0]).fault);
    let isHeld = false; // somebody moves it
    const show = (text) => {
      range.setAttribute("aria-valuetext", text);
      if (isHeld || shown.tagName === "OUTPUT") shown.value = text; // a field shows its own value
    };
    range.addEventListener("input", () => { isHeld = true; show(words(range.valueAsNumber)); });
    range.addEventListener("change", () => {
      const text = words(range.valueAsNumber);
      this.ask({ do: "set", settings: Object.fromEntries(names.map((name) => [name, text])) }, range, () => { isHeld = false; });
    });
    const take = (values) => {
      row.hidden = names.some((name) => !(name in values));
      if (row.hidden || isHeld) return;
      const texts = names.map((name) => readable(values[name])), value = read(texts);
      if (value > range.max) range.max = value;
      if (value < range.min) range.min = value;
      range.value = value;
      show([...new Set(texts)].join(" and "));
    };
    return { row, take };
  }

  /** A field for a parameter, whose range `range` will show. */
  input(name, range) {
    const input = make("input", { name, id: `p-${name}`, autocomplete: "off", spellcheck: false });
    const fault = make("small", { className: "fault", id: `f-${name}` });
    input.title = name;
    input.setAttribute("aria-describedby", `${range.id} ${fault.id}`);
    const field = { input, range, fault, value: "" };
    this.fields.set(name, field);
    input.addEventListener("change", () => this.ask({ do: "set", settings: { [name]: input.value } }, input, (error) => {
      this.showFault(field, error);
      if (!error) input.value = field.value;
      return true;
    }));
    input.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      input.value = field.value;
      this.showFault(field, null);
    });
    return input;
  }

  showFault({ input, fault }, error) {
    fault.textContent = error ? `${error} (Escape: as it is)` : "";
    input.setAttribute("aria-invalid", String(Boolean(error)));
  }

  parameters({ values, ranges, help }) {
    for (const law of this.laws) {
      law.present = values[law.name];
      if (law.present !== "none") law.before = law.present;
    }
    for (const slider of this.sliders) slider.take(values);
    for (const [name, value] of Object.entries(values)) {
      if (name.endsWith(LAW)) continue; // it is chosen from a list
      if (!this.fields.has(name)) this.addField(name);
      const field = this.fields.get(name);
      const shown = readable(value);
      if (shown !== field.value && document.activeElement !== field.input) this.showFault(field, null); // changed elsewhere
      field.value = shown;
      field.range.textContent = [help[name], ranges[name]].filter(Boolean).join(" ");
      const isOwn = document.activeElement === field.input || field.input.getAttribute("aria-invalid") === "true";
      if (!isOwn) field.input.value = field.value;
    }
    this.showLaw();
  }

  /** Add a field to the group of its part: the environment's own beside each other, each further part behind a fold. */
  addField(name) {
    const path = name.split("."), part = path.slice(0, -1).join("."), top = this.groups.has(`${path[0]}.links`) ? 2 : 1;
    if (!this.groups.has(part)) {
      const words = path.slice(top, -1).join(" ").replaceAll("_", " ");
      this.groups.set(part, make("details", {}, make("summary", { textContent: words })));
      this.groups.get(path.slice(0, top).join(".")).append(this.groups.get(part));
    }
    const label = make("label", { htmlFor: `p-${name}`, textContent: path.at(-1).replaceAll("_", " ") });
    const range = make("small", { id: `r-${name}` }), input = this.input(name, range);
    this.groups.get(part).append(make("div", { className: "field" }, label, input, range, this.fields.get(name).fault));
  }

  /** Show what is recorded, or what came of it. */
  recording({ file, seconds, result }) {
    this.record.textContent = file ? "Stop recording" : RECORD;
    this.record.setAttribute("aria-pressed", String(Boolean(file)));
    this.recorded.textContent = file ? `${file.split("/").at(-1)}: ${Math.round(seconds)} s` : result;
  }

  /** Show how many episodes there are; only what can be done now can be pressed. */
  showEpisodes({ begun, kept, is_open: isOpen }) {
    this.episodes.textContent = `${isOpen ? `episode ${begun - 1} is open, ` : ""}${kept} kept of ${begun}`;
    for (const [action, button] of Object.entries(this.episode)) button.setAttribute("aria-pressed", String(isOpen && action === "start"));
  }

  /** Show the law, and which preset is active. */
  showLaw() {
    for (const { list, power, present, show } of this.laws) {
      if (document.activeElement !== list || !list.hasAttribute("aria-busy")) show();
      power.setAttribute("aria-checked", String(present !== "none"));
    }
    const delays = [...this.fields].filter(([name]) => DELAYS.some((each) => name.endsWith(each))).map(([, field]) => field.value);
    const shown = { none: this.present === "none" && delays.every((d) => d === "5 ms"),
      certified: this.present === "certified" && delays.every((d) => d === "0 ms") };
    for (const [name, button] of Object.entries(this.shows)) button.setAttribute("aria-pressed", String(shown[name]));
  }

  nodes({ time, processes }) {
    const table = document.getElementById("nodes");
    if (!this.rows.size) {
      const names = ["node", "state", "steps/s", "processor", ""];
      table.replaceChildren(make("tr", {}, ...names.map((textContent) => make("th", { textContent, scope: "col" }))));
    }
    for (const one of processes) {
      if (!this.rows.has(one.node)) table.append(this.addRow(one));
      const row = this.rows.get(one.node), { cells, button } = row;
      const rate = (one.steps - row.steps) / (time - row.time);
      Object.assign(row, { steps: one.steps ?? NaN, time });
      const texts = [one.node, one.state, rate >= 0 ? String(Math.round(rate)) : "–", one.processor === null ? "–" : `${Math.round(100 * one.processor)} %`];
      texts.forEach((text, i) => { cells[i].textContent = text; });
      if (!button) continue;
      button.textContent = one.state === "stopped" ? "start" : "stop";
      button.setAttribute("aria-label", `${button.textContent} ${one.node}`);
    }
  }

  addRow({ node }) {
    const cells = Array.from({ length: 4 }, () => make("td")), last = make("td");
    let button = null;
    if (["environment", "controller"].includes(node.split("/").at(-1))) {
      button = make("button", { type: "button", id: `node-${node}` });
      button.addEventListener("click", () => this.ask({ do: button.textContent, node }, button));
      last.append(button);
    }
    this.rows.set(node, { cells, button });
    return make("tr", {}, ...cells, last);
  }
}
