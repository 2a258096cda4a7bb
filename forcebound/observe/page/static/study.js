// The page of a study. The server says what to show; a page keeps nothing but its noise and its drag.

import { noiseOf } from "./noise.js";

const $ = (name) => document.getElementById(name);
const RETRY = 1000; // ms between two attempts to connect
const BEFORE = 0.045, BEHIND = 0.015; // m that the scene shows before the line and behind the wall

let socket = null, step = {}, place = null, grab = null, noise = null, isElsewhere = false;

function connect() {
  socket = new WebSocket(`ws://${location.host}/live${location.search}`);
  socket.onmessage = ({ data }) => take(JSON.parse(data));
  socket.onclose = () => {
    if (step.kind === "finished" || isElsewhere) return;
    say("The connection is lost", "Nothing is lost. Please call the experimenter if this stays.");
    setTimeout(connect, RETRY);
  };
}

const send = (message) => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message));

function say(title, text) {
  $("title").textContent = title;
  $("text").textContent = text;
  $("scene").hidden = $("levels").hidden = true;
  $("choices").replaceChildren();
}

function take(message) {
  if (message.type === "marker") return mark(message);
  if (message.type === "elsewhere") {
    isElsewhere = true;
    noise?.stop();
    socket.close();
    return say("This study is shown in another window", "Reload this page to show it here.");
  }
  if (message.type !== "step") return;
  const isNew = "may_change" in message; // the first message of a connection
  step = { ...step, ...message };
  say(step.title, step.text);
  document.body.dataset.kind = step.kind;
  $("bar").hidden = step.every === null;
  $("bar").value = step.done / (step.every || 1);
  $("count").textContent = step.every === null ? `${step.done} answered` : `${step.done} of ${step.every}`;
  $("rehearsal").hidden = !step.rehearsal;
  $("rehearsal").textContent = step.drags || !step.rehearsal ? "Rehearsal" : "Rehearsal: an emulator moves by itself";
  $("levels").hidden = step.kind !== "noise";
  $("level").value = step.level;
  noise?.play(!["break", "finished", "problem"].includes(step.kind));
  if (step.scene) draw(step.scene);
  offer();
  if (isNew && step.may_change) {
    $("begin").hidden = noise !== null;
    if ($("begin").hidden) send({ do: "ready" });
  }
}

function offer() {
  const buttons = step.choices.map((words, index) => {
    const button = document.createElement("button");
    button.textContent = words;
    button.disabled = step.remaining > 0 || !step.may_change;
    button.onclick = () => choose(index + 1);
    return button;
  });
  $("choices").replaceChildren(...buttons);
  if (step.remaining > 0) count(step, performance.now() + step.remaining * 1000);
}

/** Show how long a break lasts at least. */
function count(own, end) {
  if (own !== step) return;
  const seconds = Math.max(0, Math.ceil((end - performance.now()) / 1000));
  $("text").textContent = seconds ? `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}` : step.text;
  if (seconds) setTimeout(count, 200, own, end);
  else for (const button of $("choices").children) button.disabled = !step.may_change;
}

const choose = (choice) => send({ do: "choose", step: step.step, choice });
const share = (x) => (x - step.scene.line + BEFORE) / (step.scene.wall - step.scene.line + BEFORE + BEHIND);
const metres = (pixels) => pixels / $("scene").clientWidth * (step.scene.wall - step.scene.line + BEFORE + BEHIND);

function draw(scene) {
  $("scene").hidden = false;
  $("drag").hidden = !step.drags;
  $("line").style.left = `${100 * share(scene.line)}%`;
  $("wall").style.left = `${100 * share(scene.wall)}%`;
  $("marker").hidden = true;
}

/** Move the marker; its right edge is the hand. It stops at the wall, so that the depth is not seen. */
function mark({ x, colour }) {
  place = x;
  if (!step.scene) return;
  const at = Math.min(Math.max(x, step.scene.line - 0.9 * BEFORE), step.scene.wall);
  $("marker").hidden = false;
  $("marker").style.left = `max(2.2em, ${100 * share(at)}%)`;
  $("marker").style.background = colour === null ? "#fff" : step.colours[colour];
  $("marker").dataset.colour = colour ?? "";
}

$("scene").onpointerdown = (event) => {
  if (place === null || !step.drags) return;
  $("scene").setPointerCapture(event.pointerId);
  grab = { pixel: event.clientX, place };
};
$("scene").onpointermove = (event) => {
  if (grab && step.scene) send({ do: "point", place: grab.place + metres(event.clientX - grab.pixel) });
};
$("scene").onlostpointercapture = () => { grab = null; };

$("level").oninput = () => {
  noise?.set(Number($("level").value));
  send({ do: "level", level: Number($("level").value) });
};

/** Begin with what browsers allow after a key or a click only: sound and the full screen. */
function begin() {
  $("begin").hidden = true;
  document.documentElement.requestFullscreen?.().catch(() => {});
  noise = noiseOf(step.noise);
  noise.set(step.level);
  noise.play(true);
  send({ do: "ready" });
}
$("begin").onclick = begin;

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
  if (!$("begin").hidden) begin();
  else if (event.key === "f") document.documentElement.requestFullscreen?.().catch(() => {});
  else {
    const two = step.choices?.length === 2;
    const keys = two ? [["1", "ArrowLeft"], ["2", "ArrowRight"]] : [[" ", "Enter", "1"]];
    const index = event.target === $("level") && event.key.startsWith("Arrow") ? -1 : keys.findIndex((own) => own.includes(event.key));
    if (index < 0 || !step.choices?.[index]) return;
    choose(index + 1);
  }
  event.preventDefault();
});

connect();
