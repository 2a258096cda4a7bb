// A picture of the page as it is, and its layout in the address, which can be shared.

import { colour } from "./canvas.js";

const EDGE = 16, LINE = 24; // pixels

/** Words on lines that are not wider than `wide`. */
function wrapped(context, words, wide) {
  const lines = [""];
  for (const word of words.split(" ")) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (context.measureText(longer).width <= wide) lines[lines.length - 1] = longer; else lines.push(word);
  }
  return lines;
}

/** Draw words, the scene and the plots below each other, the plots as they are on the page. Return a canvas. */
export function drawn(scene, plots, words) {
  const ratio = window.devicePixelRatio || 1, boxes = plots.map(({ canvas }) => canvas.getBoundingClientRect());
  const [wide, left, top] = [scene.clientWidth, scene.getBoundingClientRect().left, Math.min(...boxes.map((box) => box.top))];
  const picture = document.createElement("canvas"), context = picture.getContext("2d"), font = `15px ${getComputedStyle(document.body).fontFamily}`;
  context.font = font;
  const lines = words.flatMap((one) => wrapped(context, one, wide - 2 * EDGE)), head = 2 * EDGE + LINE * lines.length;
  const below = head + scene.clientHeight, high = below + Math.max(...boxes.map((box) => box.bottom)) - top;
  Object.assign(picture, { width: ratio * wide, height: ratio * high }); // the context is as new then
  context.scale(ratio, ratio);
  context.fillStyle = colour("ground");
  context.fillRect(0, 0, wide, high);
  Object.assign(context, { font, textBaseline: "top", fillStyle: colour("text") });
  lines.forEach((line, i) => context.fillText(line, EDGE, EDGE + LINE * i));
  context.drawImage(scene, 0, head, wide, scene.clientHeight);
  plots.forEach(({ canvas }, i) => context.drawImage(canvas, boxes[i].left - left, below + boxes[i].top - top, boxes[i].width, boxes[i].height));
  return picture;
}

/** Save a canvas as a file. */
export function save(canvas, name) {
  const link = Object.assign(document.createElement("a"), { href: canvas.toDataURL("image/png"), download: name });
  link.click();
}

const digits = (x) => Number(x.toPrecision(4));

/** The layout of the page in its address: view of the scene, seconds of the plots, open folds. */
export class Layout {
  constructor(scene, shown) {
    Object.assign(this, { scene, shown, folds: [...document.querySelectorAll("form > details")] });
    this.plain = this.text; // of a page that nobody has changed
  }

  get view() { return [this.scene.half, this.scene.yaw, this.scene.pitch, ...this.scene.centre].map(digits).join(","); }
  get open() { return this.folds.flatMap((fold, i) => (fold.open ? [i] : [])).join(","); }
  get text() { return JSON.stringify([this.view, this.shown.seconds, this.open]); }

  /** Take what the address has; false: it has no view, which is then that of the graph. */
  restore() {
    const words = new URLSearchParams(location.search), view = (words.get("view") ?? "").split(",").map(Number);
    const seconds = Number(words.get("seconds"));
    if (words.has("open")) this.folds.forEach((fold, i) => { fold.open = words.get("open").split(",").includes(String(i)); });
    if (seconds > 0) this.shown.zoom(seconds / this.shown.seconds);
    if (view.length !== 6 || !view.every(Number.isFinite)) return;
    [this.scene.half, this.scene.yaw, this.scene.pitch, ...this.scene.centre] = view;
    this.scene.isCentred = true;
  }

  /** Put the layout into the address, if it has changed. */
  keep() {
    if (this.text === this.plain || !this.scene.isCentred) return;
    this.plain = this.text;
    const address = new URL(location);
    for (const [name, value] of [["view", this.view], ["seconds", digits(this.shown.seconds)], ["open", this.open]]) address.searchParams.set(name, value);
    history.replaceState(null, "", address);
  }
}
