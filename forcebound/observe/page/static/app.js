// The page of a running graph: one WebSocket in, requests out, everything drawn from what came.

import { Controls } from "./controls.js";
import { Figures } from "./figures.js";
import { Choice, coloured } from "./hands.js";
import { Layout, drawn as drawPicture, save } from "./picture.js";
import { PLOTS, Plot, linesOf, signalPlots } from "./plots.js";
import { Window } from "./samples.js";
import { magnitude, si, text, units } from "./scale.js";
import { Scene } from "./scene.js";

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") ?? "";
const shown = new Window();

const NOW = 0.05; // s from the right end of the time line that are now
const SILENT = 1000; // ms without a frame: the signal is lost
const FRAME = 1000 / 30 - 4; // ms between two pictures, at least
const AGAIN = 1000; // ms until the next attempt to connect
const MOST_EVENTS = 200;
const SLOWED = 1 / 29; // s between two frames: from then on the server has backed off

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

export const scene = new Scene($("scene"), (hand, target, at) => send({ do: "point", hand, target, stamp: at }));
const controls = new Controls(send);
const figures = new Figures($("figures"));
const frames = new Map(); // the newest, by hand
const choice = new Choice($("hands"), showChoice);
let hello = null; // the newest
let all = []; // hands of the graph
const { delay, ...main } = PLOTS;
export const plots = Object.values(main).map((spec) => new Plot($("plots"), shown, spec));
const delays = new Plot($("delays"), shown, delay); // behind the fold of the network
const layout = new Layout(scene, shown);
scene.past = (hand) => shown.past(hand);
const others = plots.length; // after them: plots of the graph's signals

// --- What comes ----------------------------------------------------------------------------------

const takes = {
  hello(message) {
    mayChange = message.may_change;
    isOver = false;
    hello = message;
    heard = performance.now();
    layout.keep(); // after a lost connection the page stays as it is
    const hands = all = coloured(message.hands);
    frames.clear();
    Object.assign(units, message.units);
    Object.assign(si, message.si);
    for (const [name, plot] of Object.keys(main).map((key, i) => [key, plots[i]])) plot.si = si[name] ?? plot.si;
    document.body.classList.toggle("several", hands.length > 1);
    document.body.classList.toggle("many", hands.length > 2);
    document.body.classList.toggle("has-joints", message.joints.length > 0);
    $("name").replaceChildren(Object.assign(document.createElement("span"), { textContent: "forcebound: " }), message.name.replace(/^\S*\//, "").replace(/\.yaml\b/, ""));
    document.title = message.name;
    shown.begin(hands.map(({ name }) => name));
    scene.describe({ ...message, hands });
    controls.describe({ ...message, hands });
    choice.offer(hands);
    layout.restore();
    $("events").replaceChildren(); // those so far follow
  },
  frame(message) {
    heard = performance.now();
    const samples = shown.live.get(message.hand);
    if (message.time[0] < samples.newest - 1) { samples.clear(); shown.histories.get(message.hand).clear(); shown.marks = []; } // another clock
    if (message.time[0] > samples.newest + 1e-3 * SILENT) samples.push(samples.newest, {}); // a gap
    const { limit, energy, true_energy, delay, commanded, applied, position, signals } = message;
    const columns = { limit, energy, true_energy, known_energy: true_energy.map((one, i) => one ?? energy[i]), delay,
      commanded: commanded.map(magnitude), applied: applied.map(magnitude), ...signals };
    for (const [letter, vectors] of [["p", position], ["c", commanded], ["a", applied]]) vectors[0].forEach((_, axis) => { columns[`${letter}${axis}`] = vectors.map((one) => one[axis]); });
    shown.take(message.hand, message.time, columns);
    scene.take(message);
    frames.set(message.hand, message);
    if (message.since) shown.mark(message.since, message.law, message.hand);
    pace = message.pace;
  },
  state({ hands }) {
    for (const { name } of choice.shown) if (frames.has(name)) figures.showAll(frames.get(name), choice.shown.length > 1 ? `${name}: ` : "");
    showStates(all.filter(({ name }) => name in hands).map((hand) => ({ ...hand, ...hands[hand.name] })));
  },
  starting({ seconds, share }) {
    heard = performance.now();
    const isLong = seconds > 2;
    say({ head: isLong ? "Compiling the force: about 30 s." : "The world starts.", kind: "off",
      more: isLong ? "Only the first start compiles. Look around already: the force follows." : "" }, all.length < 2);
    showPaid($("paid"), share);
    Object.assign($("paid"), { textContent: `${Math.floor(seconds)} s`, title: "Share of the time that compiling takes on a usual machine." });
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
  taken({ stamp }) { figures.show("pointer to device and back", `${text(performance.now() - stamp)} ms`); },
  nodes(message) { controls.nodes(message); },
  parameters(message) {
    scene.wall = message.wall;
    controls.parameters(message);
  },
  answer(message) { controls.answer(message); },
  recording(message) { controls.recording(message); },
  episodes(message) { controls.showEpisodes(message); },
  over() {
    const was = $("controls").childElementCount > 0;
    isOver = true;
    say({ head: was ? "The graph has ended." : "No graph runs yet.", more: "The page shows the next one as soon as it runs." });
  },
  closed() {
    isClosed = true;
    say({ head: "This page has ended.", more: "`forcebound view` opens a new one." });
  },
};

/** Show the hand that is chosen, or all. */
function showChoice() {
  const { shown: hands } = choice, { names, signals } = hello;
  scene.choose(hands.map(({ name }) => name));
  controls.choose(hands.map(({ name }) => name));
  figures.clear();
  for (const { name, hand_speed } of hands) if (hand_speed !== "null") figures.show(`${hands.length > 1 ? `${name}: ` : ""}speed of a hand, at most`, hand_speed);
  Object.values(main).forEach((spec, i) => { plots[i].lines = linesOf(spec, names, hands); });
  delays.lines = linesOf(delay, names, hands);
  for (const { canvas } of plots.splice(others)) canvas.remove();
  plots.push(...signalPlots($("plots"), shown, signals, hands));
  $("hint").replaceChildren(Object.assign(document.createElement("span"), { id: "about", textContent: `${hello.description} ` }), hintOf(hello));
}

function hintOf({ may_change, axes }) {
  const hand = choice.shown.some(({ pointer }) => pointer), which = all.length < 2 ? "the hand" : choice.chosen ?? "the nearest hand";
  const turn = axes > 2 ? "; Shift to turn" : "";
  if (!may_change) return `This page may only look${axes > 2 ? ": drag to turn" : ""}.`;
  if (hand && matchMedia("(pointer: coarse)").matches) return `Drag to move ${which}${axes > 2 ? "; two fingers turn" : ""}.`;
  return hand ? `Drag, or use the arrow keys (1 mm), to move ${which}${axes > 2 ? "; Page Up and Down for away and near" : ""}${turn}.`
    : "Nobody can drag this hand: it is real, or moves by itself. Launch files such as pointer_wall have one that can be dragged.";
}

const WORST = ["not_passive", "uncovered", "late", "unknown", "off", "passive"]; // kinds of states

/** Show the states of hands: {name, colour, kind, head, more, force, energy, cause, paid} of each, all words of the server. */
function showStates(known) {
  const worst = WORST.flatMap((kind) => known.filter((one) => one.kind === kind))[0];
  const whose = all.length > 1 ? `${worst.name}: ` : "";
  say({ ...worst, head: whose + worst.head }, true);
  if (whose) showEach(known);
  else [$("force").textContent, $("energy").textContent, $("why").title] = [worst.force, worst.energy, worst.cause];
  showPaid($("paid"), whose ? "" : worst.paid);
  const { preparing, present } = controls;
  $("note").textContent = [
    preparing && preparing !== present ? `Preparing law ${preparing}; until then, law ${present} goes on.` : "",
    shown.isPaused ? `The plots and the scene end ${text(shown.latest - shown.end)} s ago.` : "",
    scene.isLoading ? "The shape is still loading: the force is real, its picture comes." : "",
    pace > SLOWED ? `Ticks are missed: only ${Math.round(1 / pace)} pictures a second.` : "",
  ].join(" ");
  showTime();
  layout.keep();
  for (const [key, is] of Object.entries(scene.parts)) document.querySelector(`[data-key=${key}]`).hidden = !is;
  const { pixels, words: length } = scene.bar;
  $("bar").textContent = length;
  $("bar").style.width = `${pixels}px`;
}

/** Show a line for each of several hands, in the order of the launch file: what moves cannot be read. */
function showEach(known) {
  while ($("each").children.length < known.length) {
    $("each").append(document.createElement("li"));
    $("each").lastChild.append(...["b", "strong", "data", "data", "small", "p"].map((tag) => document.createElement(tag)));
  }
  [...$("each").children].forEach((line, i) => {
    const { name, colour, kind, head, more, force, energy, cause, paid } = known[i];
    line.dataset.state = kind;
    line.title = [more, cause].filter(Boolean).join("\n");
    line.style.setProperty("--hand", `var(--${colour})`);
    line.classList.toggle("brief", !choice.shown.some((hand) => hand.name === name));
    showPaid(line.lastChild, paid);
    [name, head, force, energy, more].forEach((words, j) => { if (line.children[j].textContent !== words) line.children[j].textContent = words; });
  });
}

/** Show how much of the force the ledger pays for, such as "8%", as a bar that motion fills; empty: all, or there is none. */
function showPaid(bar, share) {
  bar.className = "paid";
  bar.style.visibility = share ? "visible" : "hidden"; // its place stays
  bar.title = "Share of the commanded force for which the ledger has energy. Only motion of the hand fills it.";
  bar.style.setProperty("--share", share);
  if (share && bar.textContent !== `ledger: pays for ${share}`) bar.textContent = `ledger: pays for ${share}`;
}

/** Say how things are; whether what can be changed can be changed just now follows from it. */
function say({ head, more, kind = "away" }, isWell = false) {
  if (document.body.dataset.state !== kind || kind === "away") $("spoken").textContent = head; // numbers are not spoken
  document.body.dataset.state = kind;
  for (const [id, words] of [["state", head], ["why", more]]) if ($(id).textContent !== words) $(id).textContent = words;
  if (!isWell) $("note").textContent = "";
  $("each").hidden = !isWell || all.length < 2;
  if (!isWell) showPaid($("paid"), "");
  document.body.classList.toggle("is-away", !isWell);
  const isOff = !mayChange || socket?.readyState !== WebSocket.OPEN || isOver || isClosed;
  for (const part of document.querySelectorAll(".changes")) if (part.disabled !== isOff) part.disabled = isOff;
}

const asked = new Set();
/** Fetch what a mesh or a cloud has, again and again while the scene has it and it does not come. */
async function fetchFile(digest) {
  if (scene.files.has(digest) || asked.has(digest)) return;
  asked.add(digest);
  const answer = await fetch(`file/${digest}?token=${encodeURIComponent(token)}`).catch(() => null);
  const content = answer?.ok ? await answer.json().catch(() => null) : null;
  asked.delete(digest);
  if (content) scene.files.set(digest, content);
  else if (scene.objects.some((object) => object.digest === digest)) setTimeout(fetchFile, AGAIN, digest);
}

// --- What one does -------------------------------------------------------------------------------

document.querySelectorAll("form").forEach((form) => form.addEventListener("submit", (event) => event.preventDefault()));
$("nearer").addEventListener("click", () => scene.zoom(0.8));
$("farther").addEventListener("click", () => scene.zoom(1.25));
$("centre").addEventListener("click", () => scene.centreOn());
$("pause").addEventListener("click", () => { shown.pause(!shown.isPaused); showTime(); });
$("scrub").addEventListener("input", () => { shown.scrub($("scrub").valueAsNumber > Number($("scrub").max) - NOW ? null : $("scrub").valueAsNumber); showTime(); });
$("picture").addEventListener("click", () => {
  const states = all.length > 1 ? [...$("each").children].map(({ children }) => [...children].slice(0, 5).map((one) => one.textContent).join("  "))
    : [`${$("state").textContent}  ${$("force").textContent}  ${$("energy").textContent}`, $("why").textContent];
  scene.draw(true);
  for (const plot of plots) plot.draw();
  save(drawPicture(scene.canvas, plots, [`${document.title}, ${new Date().toLocaleString()}`, ...states]), `${document.title.replace(/\W+/g, "_")}.png`);
});

/** Show which time is shown, of that which is kept. */
function showTime() {
  Object.assign($("scrub"), { min: shown.oldest, max: shown.latest });
  $("scrub").value = shown.to;
  $("scrub").setAttribute("aria-valuetext", shown.isPaused ? `${text(shown.latest - shown.end)} s ago` : "now");
  $("pause").setAttribute("aria-pressed", String(shown.isPaused));
  $("pause").textContent = shown.isPaused ? "▶" : "❚❚";
}

$("plots").addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return; // these are the browser's
  const step = shown.seconds / 50;
  if (event.key === "+" || event.key === "=") shown.zoom(0.8);
  else if (event.key === "-") shown.zoom(1.25);
  else if (event.key === "ArrowLeft" || event.key === "ArrowRight") shown.step(event.key === "ArrowLeft" ? -step : step);
  else if (event.key === "Escape") shown.age = null;
  else return;
  event.preventDefault();
  $("readings").textContent = shown.age === null ? "" : `At ${text(-shown.age)} s. ${plots.map((plot) => plot.inWords).join(". ")}`;
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
    say({ head: "Not connected.", more: "Trying again." });
    const answer = await fetch(location.href).catch(() => null);
    isClosed = answer?.status === 403; // this token is of a server before
    if (isClosed) say({ head: "Another page is here now.", more: "Open the address that its command has printed." });
    else setTimeout(connect, AGAIN);
  });
}

let pace = 0; // s between two frames of the server, which are fewer where ticks are missed
let drawn = 0, pictures = 0; // ms, when the scene was drawn last; how many pictures so far

/** Draw the scene, and one of the plots: each has its turn. */
function draw(now) {
  requestAnimationFrame(draw);
  if (now - drawn < Math.max(FRAME, 1e3 * pace - 4)) return;
  drawn = now;
  pictures += 1;
  const silence = performance.now() - heard;
  if (silence > SILENT && socket?.readyState === WebSocket.OPEN && !isOver) {
    say({ head: "Signal lost.", more: `Nothing from the device for ${Math.floor(silence / 1000)} s.` });
  }
  if (!hello) return; // neither axes nor units are known
  const seen = $("network").open ? [...plots, delays] : plots;
  try { scene.draw(); } finally { seen[pictures % seen.length].draw(); } // an error in one does not stop the others
}

connect();
requestAnimationFrame(draw);
