// The page of a running graph: one WebSocket in, requests out, everything drawn from what came.

import { Histogram, Plot, Samples, Window, text } from "./plots.js";
import { Scene } from "./scene.js";

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") ?? "";
const samples = new Samples();
const shown = new Window(samples);
const magnitude = (vector) => (vector.length === 1 ? vector[0] : Math.hypot(...vector));

let socket = null;
let request = 0;
let hello = null;
let stopped = new Set();

function send(message) {
  request += 1;
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ id: request, ...message }));
}

const scene = new Scene($("scene"), (target) => send({ do: "point", target }));

const AXES = [["x", "true"], ["y", "commanded"], ["z", "energy"]];
const plots = [
  new Plot($("force"), shown, "Force", "N", 1, [
    { name: "limit", label: "limit", colour: "limit", isArea: true },
    { name: "commanded", label: "commanded", colour: "commanded" },
    { name: "applied", label: "applied", colour: "true" },
  ]),
  new Plot($("energy"), shown, "Energy", "mJ", 1e3, [
    { name: "energy", label: "estimated", colour: "energy" },
    { name: "true_energy", label: "true", colour: "true" },
  ]),
  new Plot($("delay"), shown, "Loop delay", "ms", 1e3, [{ name: "delay", label: "delay", colour: "true" }]),
  new Histogram($("histogram"), shown, "delay", "Loop delay, how often", "ms", 1e3),
];

// --- What comes ----------------------------------------------------------------------------------

const takes = {
  hello(message) {
    hello = message;
    $("name").textContent = `forcebound: ${message.name}`;
    document.title = message.name;
    scene.describe(message);
    plots.length = 4;
    plots.unshift(new Plot($("position"), shown, "Position", "mm", 1e3,
      AXES.slice(0, message.axes).map(([label, colour], i) => ({ name: `p${i}`, label, colour }))));
    $("hint").textContent = !message.may_change ? "This page may only look."
      : message.hand ? "Drag to move the hand; Shift and drag to turn; wheel to zoom; arrow keys move by 1 mm."
        : "This hand moves by itself: operator: { kind: pointer } follows the mouse.";
    document.querySelectorAll("button").forEach((b) => { if (b.id !== "pause") b.disabled = !message.may_change; });
    buildControls(message);
  },
  frame(message) {
    message.time.forEach((time, i) => {
      const values = { limit: message.limit[i], energy: message.energy[i], true_energy: message.true_energy[i],
        delay: message.delay[i], commanded: magnitude(message.commanded[i]), applied: magnitude(message.applied[i]) };
      message.position[i].forEach((x, axis) => { values[`p${axis}`] = x; });
      samples.push(time, values);
    });
    const last = message.time.length - 1;
    scene.state = { tip: message.tip, proxy: message.proxy, commanded: message.commanded[last], applied: message.applied[last] };
    showFigures(message, last);
    $("state").textContent = message.engagement < 1 ? `force engages: ${Math.round(100 * message.engagement)} %` : "running";
  },
  scene(message) {
    scene.objects = message.objects;
    for (const object of message.objects) if (object.shape === "mesh") fetchMesh(object.digest);
  },
  event(message) {
    const entry = document.createElement("li"), time = document.createElement("time");
    entry.className = message.is_fault ? "fault" : "";
    time.textContent = new Date(1e3 * message.time).toLocaleTimeString();
    entry.append(time, `${message.node}: ${message.message}`);
    $("events").prepend(entry);
    while ($("events").children.length > 200) $("events").lastChild.remove();
  },
  nodes: showNodes,
  parameters(message) { showParameters(message.values); },
  answer(message) { $("error").textContent = message.error ?? ""; },
  over() { $("state").textContent = "the graph has ended"; },
};

function showFigures(message, last) {
  const figures = {
    position: `${text(1e3 * message.position[last][0])} mm`,
    applied: `${text(magnitude(message.applied[last]))} N`,
    limit: `${text(message.limit[last])} N`,
    "true energy": `${text(1e3 * (message.true_energy[last] ?? NaN))} mJ`,
    delay: `${text(1e3 * (message.delay[last] ?? NaN))} ms`,
    "missed ticks": String(message.misses),
  };
  $("figures").replaceChildren(...Object.entries(figures).map(([name, value]) => {
    const pair = document.createElement("div"), dt = document.createElement("dt"), dd = document.createElement("dd");
    dt.textContent = name;
    dd.textContent = value;
    pair.append(dt, dd);
    return pair;
  }));
}

const asked = new Set();
async function fetchMesh(digest) {
  if (asked.has(digest)) return;
  asked.add(digest);
  const answer = await fetch(`mesh/${digest}?token=${encodeURIComponent(token)}`);
  if (answer.ok) scene.meshes.set(digest, await answer.json());
}

// --- Controls ------------------------------------------------------------------------------------

const OFFERED = ["environment.stiffness", "environment.damping", "environment.compute_delay",
  "links.environment_query.delay", "links.environment_reply.delay", "links.environment_reply.jitter",
  "links.environment_reply.loss"];
const fields = new Map(); // name of a parameter -> its input

function labelled(words, input) {
  const label = document.createElement("label");
  label.append(words, input);
  return label;
}

function buildControls(message) {
  const law = document.createElement("select");
  law.id = "law";
  for (const name of message.laws) law.add(new Option(name, name, false, name === message.law));
  law.addEventListener("change", () => send({ do: "law", law: law.value }));
  const outage = document.createElement("button");
  outage.type = "button";
  outage.id = "outage";
  outage.textContent = "cut the network for 0.5 s";
  outage.addEventListener("click", () => send({ do: "outage", time: "500 ms" }));
  $("controls").replaceChildren(labelled("law", law), outage);
  law.disabled = outage.disabled = !message.may_change;
  fields.clear();
}

function field(name, value) {
  const input = document.createElement("input");
  input.name = name;
  input.value = value;
  input.disabled = !hello?.may_change;
  input.addEventListener("change", () => send({ do: "set", settings: { [name]: input.value } }));
  fields.set(name, input);
  return labelled(name, input);
}

function showParameters(values) {
  for (const [name, value] of Object.entries(values)) {
    const input = fields.get(name);
    if (!input) (OFFERED.includes(name) ? $("controls") : $("parameters")).append(field(name, value));
    else if (document.activeElement !== input) input.value = value;
  }
}

function showNodes(message) {
  const head = document.createElement("tr");
  for (const name of ["node", "state", "processor", "memory", "restarts", ""]) {
    head.append(Object.assign(document.createElement("th"), { textContent: name }));
  }
  const rows = message.processes.map((one) => {
    const row = document.createElement("tr");
    const cells = [one.node, one.state, one.processor === null ? "–" : `${Math.round(100 * one.processor)} %`,
      one.memory === null ? "–" : `${Math.round(one.memory / 1e6)} MB`, one.restarts];
    for (const cell of cells) row.append(Object.assign(document.createElement("td"), { textContent: cell }));
    const last = document.createElement("td");
    if (["environment", "controller"].includes(one.node)) {
      const isStopped = one.state === "stopped";
      const button = Object.assign(document.createElement("button"), { textContent: isStopped ? "start" : "stop" });
      button.disabled = !hello?.may_change;
      button.addEventListener("click", () => send({ do: isStopped ? "start" : "stop", node: one.node }));
      last.append(button);
    }
    row.append(last);
    return row;
  });
  $("nodes").replaceChildren(head, ...rows);
}

document.querySelectorAll("form").forEach((form) => form.addEventListener("submit", (event) => event.preventDefault()));
$("break").addEventListener("click", () => { send({ do: "break" }); $("law").value = "none"; });
$("safe").addEventListener("click", () => { send({ do: "safe" }); $("law").value = "certified"; });
$("pause").addEventListener("click", () => {
  const isPaused = shown.end === null;
  shown.pause(isPaused);
  $("pause").setAttribute("aria-pressed", String(isPaused));
  $("pause").textContent = isPaused ? "Go on" : "Pause plots";
});

// --- Connection ----------------------------------------------------------------------------------

function connect() {
  socket = new WebSocket(`ws://${location.host}/live?token=${encodeURIComponent(token)}`);
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    takes[message.type]?.(message);
  });
  socket.addEventListener("close", () => {
    if ($("state").textContent !== "the graph has ended") $("state").textContent = "not connected; trying again";
    setTimeout(connect, 1000);
  });
}

function draw() {
  scene.draw();
  for (const plot of plots) plot.draw();
  requestAnimationFrame(draw);
}

connect();
requestAnimationFrame(draw);
