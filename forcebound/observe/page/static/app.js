// The page of a running graph: one WebSocket in, requests out, everything drawn from what came.

import { text } from "./canvas.js";
import { Clock } from "./clock.js";
import { Controls } from "./controls.js";
import { Figures, magnitude } from "./figures.js";
import { Histogram, Plot, signalPlots } from "./plots.js";
import { Samples, Window } from "./samples.js";
import { Scene } from "./scene.js";

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") ?? "";
const samples = new Samples();
const shown = new Window(samples);

const SILENT = 1000; // ms without a frame: the signal is lost
const FRAME = 1000 / 30 - 4; // ms between two pictures, at least
const COUNTED = 200; // ms between two pictures of the histogram
const AGAIN = 1000; // ms until the next attempt to connect
const MOST_EVENTS = 200;

let socket = null;
let request = 0;
let isOver = false; // the graph has ended
let isClosed = false; // so has the server
let mayChange = false;
let heard = performance.now(); // ms, when the last frame came

function send(message) {
  request += 1;
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ id: request, ...message }));
  return request;
}

const clock = new Clock();
const scene = new Scene($("scene"), (target, at) => send({ do: "point", target, stamp: [at, performance.now()] }));
const controls = new Controls(send);

const figures = new Figures($("figures"));

const AXES = [["x", "true"], ["y", "second"], ["z", "energy"]];
const position = new Plot($("position"), shown, "Position", "mm", 1e3, []);
const plots = [
  position,
  new Plot($("force"), shown, "Force", "N", 1, [
    { name: "limit", label: "limit", colour: "limit", isArea: true },
    { name: "commanded", label: "commanded", colour: "commanded" },
    { name: "applied", label: "applied", colour: "true" },
  ]),
  new Plot($("energy"), shown, "Energy, this law", "mJ", 1e3, [
    { name: "energy", label: "estimated", colour: "energy" },
    { name: "true_energy", label: "true", colour: "true" },
  ]),
  new Plot($("delay"), shown, "Loop delay", "ms", 1e3, [{ name: "delay", label: "delay", colour: "true" }]),
];
const others = plots.length; // after them: plots of the graph's signals
const histogram = new Histogram($("histogram"), shown, "delay", "Loop delay, how often", "ms", 1e3);

// --- What comes ----------------------------------------------------------------------------------

const takes = {
  hello(message) {
    mayChange = message.may_change;
    isOver = false;
    figures.begin(message.period);
    heard = performance.now();
    $("name").textContent = `forcebound: ${message.name}`;
    document.title = message.name;
    samples.push(samples.newest, {}); // a gap: it may be another graph
    asked.clear();
    scene.describe(message);
    position.lines = AXES.slice(0, message.axes).map(([label, colour], i) => ({ name: `p${i}`, label, colour }));
    for (const { canvas } of plots.splice(others)) canvas.remove();
    plots.push(...signalPlots($("plots"), shown, message.signals));
    $("hint").textContent = `${message.description} ${hintOf(message)}`;
    controls.describe(message);
  },
  frame(message) {
    heard = performance.now();
    if (message.time[0] < samples.newest - 1) samples.clear(); // another clock
    if (message.time[0] > samples.newest + 1e-3 * SILENT) samples.push(samples.newest, {}); // a gap
    message.time.forEach((time, i) => {
      const values = { limit: message.limit[i], energy: message.energy[i], true_energy: message.true_energy[i],
        delay: message.delay[i], commanded: magnitude(message.commanded[i]), applied: magnitude(message.applied[i]) };
      for (const [name, column] of Object.entries(message.signals)) values[name] = column[i];
      message.position[i].forEach((x, axis) => { values[`p${axis}`] = x; });
      samples.push(time, values);
    });
    figures.take(message, heard);
    scene.follow(message.pointer);
    scene.state = { tip: message.tip, proxy: message.proxy, commanded: message.commanded.at(-1), applied: message.applied.at(-1) };
    say(forceOf(message), true);
  },
  scene(message) {
    scene.objects = message.objects;
    for (const object of message.objects) if (object.digest) fetchFile(object.digest);
  },
  event(message) {
    const entry = document.createElement("li"), time = document.createElement("time");
    entry.className = message.is_fault ? "fault" : "";
    time.textContent = new Date(1e3 * message.time).toLocaleTimeString();
    entry.append(time, `${message.is_fault ? "fault: " : ""}${message.node}: ${message.message}`);
    $("events").prepend(entry);
    while ($("events").children.length > MOST_EVENTS) $("events").lastChild.remove();
  },
  taken({ stamp: [at, sent], heard, device, told }) {
    const back = performance.now();
    clock.note(sent, 1e3 * heard, 1e3 * told, back);
    const passed = { there: 1e3 * device - clock.ahead - at, back: back - at };
    figures.show("pointer to device", `${text(passed.there)} ms`);
    figures.show("and back", `${text(passed.back)} ms`);
    document.dispatchEvent(new CustomEvent("taken", { detail: passed }));
  },
  nodes(message) { controls.nodes(message); },
  parameters(message) {
    scene.wall = message.wall;
    controls.parameters(message);
  },
  answer(message) { controls.answer(message); },
  recording(message) { controls.recording(message); },
  over() {
    const was = $("controls").childElementCount > 0;
    isOver = true;
    say(`${was ? "the graph has ended" : "no graph runs yet"}; the page shows the next one as soon as it runs`, false);
  },
  closed() {
    isClosed = true;
    say("this page has ended; `forcebound view` opens a new one", false);
  },
};

/** How the force stands, in words. */
function forceOf({ delay, engagement }) {
  if (delay.at(-1) === null) return "no force: controller or environment does not answer";
  return engagement < 1 ? `force engages: ${Math.round(100 * engagement)} %` : "running";
}

function hintOf({ may_change, hand, axes }) {
  const turn = axes > 2 ? "; Shift, or two fingers, to turn" : "";
  if (!may_change) return `This page may only look${axes > 2 ? ": drag to turn" : ""}.`;
  return hand ? `Drag, or use the arrow keys (1 mm), to move the hand${axes > 2 ? "; Page Up and Down for away and near" : ""}${turn}.`
    : "Nobody can drag this hand: it is real, or moves by itself. `operator: { kind: pointer }` makes one that can be dragged.";
}

/** Say how things are; whether what can be changed can be changed just now follows from it. */
function say(words, isWell) {
  if ($("state").textContent !== words) $("state").textContent = words;
  document.body.classList.toggle("is-away", !isWell);
  const isOff = !mayChange || socket?.readyState !== WebSocket.OPEN || isOver || isClosed;
  for (const part of document.querySelectorAll(".changes")) if (part.disabled !== isOff) part.disabled = isOff;
}

const asked = new Set();
/** Fetch what a mesh or a cloud has, once for each connection: one that is lost may have cost the answer. */
async function fetchFile(digest) {
  if (scene.files.has(digest) || asked.has(digest)) return;
  asked.add(digest);
  const answer = await fetch(`file/${digest}?token=${encodeURIComponent(token)}`).catch(() => null);
  if (answer?.ok) scene.files.set(digest, await answer.json());
}

// --- What one does -------------------------------------------------------------------------------

document.querySelectorAll("form").forEach((form) => form.addEventListener("submit", (event) => event.preventDefault()));
$("nearer").addEventListener("click", () => scene.zoom(0.8));
$("farther").addEventListener("click", () => scene.zoom(1.25));
$("centre").addEventListener("click", () => scene.centreOn());
$("pause").addEventListener("click", () => {
  const isPaused = !shown.isPaused;
  shown.pause(isPaused);
  $("pause").setAttribute("aria-pressed", String(isPaused));
  $("pause").textContent = isPaused ? "Go on" : "Pause plots";
});
$("plots").addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return; // these are the browser's
  const step = shown.seconds / 50;
  if (event.key === "+" || event.key === "=") shown.zoom(0.8);
  else if (event.key === "-") shown.zoom(1.25);
  else if (event.key === "ArrowLeft" || event.key === "ArrowRight") shown.step(event.key === "ArrowLeft" ? -step : step);
  else if (event.key === "Escape") shown.age = null;
  else return;
  event.preventDefault();
  $("readings").textContent = shown.age === null ? "" : `At ${text(-shown.age)} s. ${plots.map((plot) => plot.said).join(". ")}`;
});

// --- Connection ----------------------------------------------------------------------------------

function connect() {
  socket = new WebSocket(`ws://${location.host}/live?token=${encodeURIComponent(token)}`);
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    takes[message.type]?.(message);
  });
  socket.addEventListener("close", async () => {
    if (isClosed) return;
    say("not connected; trying again", false);
    const answer = await fetch(location.href).catch(() => null);
    isClosed = answer?.status === 403; // this token is of a server before
    if (isClosed) say("another page is here now; open the address that its command has printed", false);
    else setTimeout(connect, AGAIN);
  });
}

let drawn = 0, counted = 0; // ms, when the picture and its histogram were drawn last
function draw(now) {
  requestAnimationFrame(draw);
  if (now - drawn < FRAME) return;
  drawn = now;
  const silence = performance.now() - heard;
  if (silence > SILENT && socket?.readyState === WebSocket.OPEN && !isOver) {
    say(`signal lost: nothing from the device for ${Math.floor(silence / 1000)} s`, false);
  }
  scene.draw();
  for (const plot of plots) plot.draw();
  if (now - counted < COUNTED) return;
  counted = now;
  histogram.draw();
}

connect();
requestAnimationFrame(draw);
