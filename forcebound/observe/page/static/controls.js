// The controls: fields for the parameters, the law, nodes that stop and start, two buttons for visitors.

import { EVERYDAY } from "./scale.js";

const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

/** The number of a quantity in SI units, of those that a slider has. */
const siOf = (text) => parseFloat(text) * ({ "N/mm": 1e3, ms: 1e-3 }[text.split(" ")[1]] ?? 1);

const SMALL = 10; // of a unit; below, the everyday one is shown
const RECORD = "Record";
const LAW = "device.law";
const STIFFNESS = "environment.stiffness";
const DELAYS = ["links.environment_query.delay", "links.environment_reply.delay"];
const SOFTEST = 2, HARDEST = 5; // powers of ten of the stiffness slider, in N/m
const SLOWEST = 20; // ms, of the delay slider

/** A quantity as one would write it: `5 ms` for `0.005 s`, `10 N/mm` for `10000 N/m`. */
export function readable(text) {
  const [, number, unit] = /^(-?[\d.]+(?:e[+-]?\d+)?) (\S.*)$/.exec(text) ?? [];
  if (unit === "N/m" && Math.abs(number) >= 1000) return `${Number((number / 1e3).toPrecision(12))} N/mm`;
  const [factor, shown] = EVERYDAY[unit] ?? [];
  return factor && Math.abs(number) < SMALL ? `${Number((number * factor).toPrecision(12))} ${shown}` : text;
}

export class Controls {
  /** @param send sends a request to the server and returns its number */
  constructor(send) {
    this.send = send;
    this.fields = new Map(); // name of a parameter -> {input, range, fault, value}
    this.pending = new Map(); // number of a request -> what its answer is for
    this.rows = new Map(); // node -> cells of its row
    this.law = make("select", { id: "law" });
    this.law.addEventListener("change", () => this.ask({ do: "set", settings: { [LAW]: this.law.value } }, this.law));
    this.before = "certified"; // the law that the switch turns on
    this.power = make("button", { type: "button", id: "power", role: "switch", ariaLabel: "a law bounds the force" });
    this.power.addEventListener("click", () => this.ask({ do: "set", settings: { [LAW]: this.present === "none" ? this.before : "none" } }, this.power));
    this.record = make("button", { type: "button", id: "record", textContent: RECORD });
    this.record.addEventListener("click", () => this.ask({ do: this.record.textContent === RECORD ? "record" : "end_recording" }, this.record));
    this.recorded = make("small", { id: "recorded", role: "status" });
    this.shows = { none: document.getElementById("break"), certified: document.getElementById("safe") };
    this.shows.none.addEventListener("click", () => this.ask({ do: "break" }, this.shows.none));
    this.shows.certified.addEventListener("click", () => this.ask({ do: "safe" }, this.shows.certified));
  }

  /** Ask the server for a change; `element` is busy until the answer is here. */
  ask(request, element, done = () => {}) {
    element.setAttribute("aria-busy", "true");
    this.preparing = { break: "none", safe: "certified" }[request.do] ?? request.settings?.[LAW] ?? this.preparing;
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
    this.law.replaceChildren(...hello.laws.map((name) => new Option(name, name)));
    this.rows.clear();
    const outage = make("button", { type: "button", id: "outage", textContent: "lose all for 0.5 s" });
    outage.addEventListener("click", () => this.ask({ do: "outage", time: "500 ms" }, outage));
    const stiffness = this.input(STIFFNESS, make("small", { id: `r-${STIFFNESS}`, className: "spoken" }));
    this.sliders = [
      this.slider("stiffness", { min: SOFTEST, max: HARDEST, step: 0.05, shown: stiffness }, {
        words: (power) => readable(`${Number((10 ** power).toPrecision(2))} N/m`), names: [STIFFNESS],
        read: ([text]) => Math.log10(Math.max(siOf(text), 1)) }),
      this.slider("delay each way", { min: 0, max: SLOWEST, step: 0.5, shown: make("output") }, {
        words: (delay) => `${delay} ms`, names: DELAYS, read: (texts) => 1e3 * Math.max(...texts.map(siOf)) }),
    ];
    const [network, environment] = ["network", "environment"].map((id) => document.querySelector(`#${id} > fieldset`));
    this.groups = new Map([["links", network], ["environment", environment]]); // part -> where its fields are
    document.getElementById("controls").replaceChildren(
      make("div", { className: "field law" }, make("label", { htmlFor: "law", textContent: "law" }), this.power, this.law),
      ...this.sliders.map((slider) => slider.row),
      make("div", { className: "field" }, make("label", { htmlFor: "record", textContent: "recording" }), this.record, this.recorded),
    );
    network.replaceChildren(make("div", { className: "field" }, make("label", { htmlFor: "outage", textContent: "outage" }), outage));
    environment.replaceChildren();
  }

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

  /** A field for a parameter, whose range `range` will tell. */
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
    this.present = values[LAW];
    if (this.present !== "none") this.before = this.present;
    for (const slider of this.sliders) slider.take(values);
    for (const [name, value] of Object.entries(values)) {
      if (name === LAW) continue; // it is chosen from a list
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
    const path = name.split("."), part = path.slice(0, -1).join(".");
    if (!this.groups.has(part)) {
      const words = path.slice(1, -1).join(" ").replaceAll("_", " ");
      this.groups.set(part, make("details", {}, make("summary", { textContent: words })));
      this.groups.get(path[0]).append(this.groups.get(part));
    }
    const label = make("label", { htmlFor: `p-${name}`, textContent: path.at(-1).replaceAll("_", " ") });
    const range = make("small", { id: `r-${name}` }), input = this.input(name, range);
    this.groups.get(part).append(make("div", { className: "field" }, label, input, range, this.fields.get(name).fault));
  }

  /** Show what is recorded, or what came of it. */
  recording({ file, seconds, said }) {
    this.record.textContent = file ? "Stop recording" : RECORD;
    this.record.setAttribute("aria-pressed", String(Boolean(file)));
    this.recorded.textContent = file ? `${file.split("/").at(-1)}: ${Math.round(seconds)} s` : said;
  }

  /** Show the law, and which of the two buttons has its way now. */
  showLaw() {
    const law = this.present;
    if (document.activeElement !== this.law || !this.law.hasAttribute("aria-busy")) this.law.value = law;
    this.power.setAttribute("aria-checked", String(law !== "none"));
    const delays = DELAYS.map((name) => this.fields.get(name)?.value);
    const shown = { none: law === "none" && delays.every((d) => d === "5 ms"),
      certified: law === "certified" && delays.every((d) => d === "0 ms") };
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
    if (["environment", "controller"].includes(node)) {
      button = make("button", { type: "button", id: `node-${node}` });
      button.addEventListener("click", () => this.ask({ do: button.textContent, node }, button));
      last.append(button);
    }
    this.rows.set(node, { cells, button });
    return make("tr", {}, ...cells, last);
  }
}
