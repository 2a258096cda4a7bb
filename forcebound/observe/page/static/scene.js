// The scene: the tip of each hand, its proxy, the forces, and what the environment says there is to draw.

import { colour, fit, sizeOf } from "./canvas.js";
import { quantity, scaleBar, si, text } from "./scale.js";
import { drawEdgeMark, drawHint, drawNearest, nearest } from "./guides.js";
import { listen } from "./hand.js";
import { Solids, isDrawable } from "./solids.js";
import { drawJoints } from "./joints.js";
import { Labels } from "./labels.js";
import { paint } from "./painter.js";
import { ring, segment, spring } from "./strokes.js";
import { BOX_EDGES, add, boxCorners, cross, dot, facesOf, pad, pointsOf, scaled, sub } from "./shapes.js";

const NEWTONS = 22; // as many would be as long as the scene
const LONGEST = 0.45; // of the scene, that an arrow is drawn; a longer one is dashed
const WHOLE = 0.95; // share of the commanded force from which on both are one arrow
const SIDE = 26; // pixels between the two arrows where there is one axis
const GHOST = 0.6; // opacity of the commanded force, which the hand does not feel
const LANE = 130; // pixels between two hands where there is one axis, at most
const TIP = 20, RING = 34; // pixels of a tip and of the ring of a pointer
const BAR = 150; // pixels of the scale bar, at most
const NEAR = 0.08; // m, half of what is seen at first
const ABOUT = 0.03; // m about a wall that is seen
const OWN = 500; // ms that the pointer of this page is its own after a move
const OPEN = ["plane", "path"]; // shapes that one need not see whole
const FACING = [Math.SQRT1_2, 0, -Math.SQRT1_2, 0]; // w x y z; turns z to -x, out of a wall

const rgb = (hex) => [1, 3, 5].map((i) => (hex.length < 7 ? parseInt(hex[(i + 1) / 2], 16) / 15 : parseInt(hex.slice(i, i + 2), 16) / 255));

export class Scene {
  constructor(canvas, point) {
    Object.assign(this, { canvas, point });
    this.files = new Map(); // digest -> corners of a mesh, or points of a cloud
    this.placed = new Map(); // of meshes, faces in the world
    this.layer = document.createElement("canvas"); // the objects alone, where there is no graphics card
    this.card = Solids.behind(canvas);
    this.labels = new Labels();
    this.past = () => null; // what gives the values that a hand had, by its name; null: now is shown
    this.begin({ axes: 1, hands: [] });
    listen(this);
  }

  /** Show a graph of which nothing is known yet. */
  begin({ graph, axes, hands, joints = [] }) {
    Object.assign(this, { graph, axes, joints }); // joints: of hands whose axes are no places in space, {name, isAngle} of each
    // Of each hand: target, where its pointer is, in m (null: nobody points); moved, when this page moved it last, in ms.
    this.hands = hands.map((hand) => ({ ...hand, target: null, moved: -Infinity }));
    this.own = this.hands; // that this page may move, if they follow a pointer
    this.lane = 0; // pixels that the hand which is drawn is below the middle
    this.objects = [];
    this.wall = undefined; // m, where its surface is; null: there is none; undefined: not known yet
    this.centre = [0, 0, 0];
    this.half = NEAR;
    this.isCentred = false;
    [this.yaw, this.pitch] = axes < 3 ? [0, Math.PI / 2] : [-0.22, 0.32];
    this.shown = null; // what the layer shows
  }

  /** Show a graph; of the same one as before the view stays. */
  describe(hello) {
    if (hello.graph !== this.graph) this.begin(hello);
    this.mayChange = hello.may_change;
  }

  /** Let this page move some hands only. */
  choose(names) { this.own = this.hands.filter(({ name }) => names.includes(name)); }

  /** Show what a frame has of its hand. */
  take({ hand, tip, proxy, commanded, applied, pointer }) {
    const one = this.hands.find(({ name }) => name === hand);
    Object.assign(one, { tip, proxy, commanded: commanded.at(-1), applied: applied.at(-1) });
    if (pointer && performance.now() - one.moved > OWN) one.target = pad(pointer); // another page may have moved it
  }

  /** The hands that this page can move. */
  get movable() { return this.mayChange ? this.own.filter(({ pointer, tip }) => pointer && tip) : []; }

  /** The hand that moves; null: none can. */
  get hand() { return this.movable.includes(this.held) ? this.held : this.movable[0] ?? null; }

  /** The hands that have been seen. */
  get seen() { return this.hands.filter(({ tip }) => tip); }

  get basis() {
    const { yaw, pitch } = this;
    const right = [Math.cos(yaw), Math.sin(yaw), 0];
    const forward = [-Math.sin(yaw) * Math.cos(pitch), Math.cos(yaw) * Math.cos(pitch), -Math.sin(pitch)];
    return { right, forward, up: cross(right, forward) };
  }

  /** Pixels for each metre: one axis has the whole width. */
  get scale() { return this.size / (2 * this.half); }

  get size() {
    const [width, height] = sizeOf(this.canvas);
    return this.axes < 2 ? width : Math.min(width, height);
  }

  /** The scale bar: {pixels, words}. */
  get bar() { return scaleBar(this.scale, Math.min(0.25 * this.size, BAR)); }

  /** The parts of the scene that there are, for its legend. */
  get parts() {
    return { pointer: this.hands.some(({ target }) => target), proxy: this.hands.some(({ proxy }) => proxy),
      solid: this.hasWall || this.objects.length > 0, box: this.boxed.length > 0 || this.hands.some(({ workspace }) => workspace) };
  }

  /** Whether something is felt that is not drawn yet, since its file has not come. */
  get isLoading() { return this.objects.some((object) => object.digest && !this.files.has(object.digest)); }

  /** Where a point is on the canvas, in pixels, in the view of this picture. */
  project(point) {
    const { right, up, scale, x, y } = this.view, from = sub(pad(point), this.centre);
    return [x + dot(from, right) * scale, y + this.lane - dot(from, up) * scale];
  }

  zoom(factor) { this.half = Math.min(Math.max(this.half * factor, 0.002), 2); }

  turn(yaw, pitch) {
    if (this.axes < 3) return;
    this.yaw += yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -1.5), 1.5);
  }

  /** Take hold of the nearest hand to a place in pixels, or of the one held before; its pointer begins where it is. */
  grasp(at) {
    const away = (hand) => this.inLane(hand, () => Math.min(...[hand.tip, hand.target ?? hand.tip].map((point) => {
      const [x, y] = this.project(point);
      return Math.hypot(x - at[0], y - at[1]);
    })));
    this.held = at ? this.movable.reduce((best, hand) => (away(hand) < away(best) ? hand : best)) : this.hand;
    this.held.target ??= pad(this.held.tip);
  }

  /** Do something where a hand is drawn: on one axis each has a lane of its own. */
  inLane(hand, act) {
    if (this.axes < 2) this.lane = (this.hands.findIndex(({ name }) => name === hand.name) - (this.hands.length - 1) / 2) * this.wide;
    const result = act();
    this.lane = 0;
    return result;
  }

  /** Pixels between two hands where there is one axis. */
  get wide() { return Math.min(LANE, sizeOf(this.canvas)[1] / (this.hands.length + 0.2)); }

  /** Pixels between the two arrows of a hand. */
  get side() { return this.axes < 2 ? Math.min(SIDE, this.wide / 3) : 0.4 * SIDE; }

  /** Move the pointer to the right, up and away on the screen, in m; `at`: when, by the event. */
  move([right, up, away], at) {
    const { basis, hand } = this, reaches = this.reachesOf(hand);
    const step = add(add(scaled(basis.right, right), scaled(basis.up, up)), scaled(basis.forward, away));
    const start = pad(hand.pointer.start);
    hand.target = add(hand.target, step).map((x, i) => Math.min(Math.max(x, start[i] - reaches[i]), start[i] + reaches[i]));
    hand.moved = performance.now();
    this.point(hand.name, hand.target.slice(0, this.axes), at);
  }

  /** How far the pointer of a hand can go from its start on each axis, in m. */
  reachesOf({ pointer }) { return [0, 1, 2].map((axis) => (axis < this.axes ? pointer.reach : 0)); }

  /** The hands whose reach is drawn. */
  get boxed() { return this.mayChange ? this.own.filter(({ pointer }) => pointer) : []; }

  /** The boxes that are drawn: hand, middle, edges, in m. */
  get boxes() {
    return [...this.boxed.map((hand) => [hand, pad(hand.pointer.start), scaled(this.reachesOf(hand), 2)]),
      ...this.hands.filter(({ workspace }) => workspace).map((hand) => [hand, [0, 0, 0], pad(hand.workspace)])];
  }

  /** Whether all that the view is to show at first is here. */
  get isWhole() {
    return this.hands.every(({ tip, pointer }) => tip ?? pointer) && this.wall !== undefined && (this.wall !== null || this.objects.length)
      && !this.isLoading;
  }

  /** Look at all that there is. */
  centreOn() {
    const seen = this.objects.filter((object) => !OPEN.includes(object.shape));
    const points = [...this.hands.map(({ tip, pointer }) => pad(tip ?? pointer?.start)), ...seen.flatMap((object) => this.pointsOf(object))];
    if (this.hasWall) points.push([this.wall - ABOUT, 0, 0], [this.wall + ABOUT, 0, 0]);
    for (const hand of this.axes < 3 ? this.boxed : []) points.push(...boxCorners(pad(hand.pointer.start), scaled(this.reachesOf(hand), 2)));
    const low = [0, 1, 2].map((i) => points.reduce((least, p) => Math.min(least, p[i]), Infinity));
    const high = [0, 1, 2].map((i) => points.reduce((most, p) => Math.max(most, p[i]), -Infinity));
    this.centre = scaled(add(low, high), 0.5);
    this.half = Math.max(0.02, (this.axes < 2 ? 0.53 : 0.6) * Math.hypot(...sub(high, low)));
  }

  get hasWall() { return Number.isFinite(this.wall); }

  /** Points of an object in the world: of a cloud or a path, or the corners of its faces. */
  pointsOf(object) {
    return [...pointsOf(object, this.files.get(object.digest)), ...this.facesOf(object).flatMap((face) => face.points)];
  }

  /** Faces of an object in the world; those of a mesh are placed once. */
  facesOf(object) {
    const file = this.files.get(object.digest);
    if (object.shape !== "mesh" || !file) return facesOf(object, file);
    const key = JSON.stringify([object.digest, object.position, object.orientation]);
    if (!this.placed.has(key)) {
      this.placed.clear();
      this.placed.set(key, facesOf(object, file));
    }
    return this.placed.get(key);
  }

  /** Whether a graphics card draws what stands in space. */
  get isCarded() { return this.axes > 2 && this.card !== null && !this.card.isLost && this.solids.every(isDrawable); }

  /** Draw what there is; `isFlat`: all of it on the canvas itself, for a picture. */
  draw(isFlat = false) {
    const { context, width, height } = fit(this.canvas);
    if (!width || !height) return; // the window has no room
    this.labels.begin(context, width, height);
    if (this.joints.length) {
      drawJoints(context, this.seen.map((one) => this.asOf(one)), this.joints, width, height);
      return;
    }
    if (!this.isCentred && this.isWhole) {
      this.isCentred = true;
      this.centreOn();
    }
    this.view = { ...this.basis, scale: this.scale, x: width / 2, y: height / 2 };
    if (!this.isCarded) for (const [hand, middle, size] of this.boxes) this.inLane(hand, () => this.drawBox(context, middle, size));
    if (this.axes < 3) this.drawGround(context, width, height);
    this.drawLayer(context, width, height, isFlat);
    for (const hand of this.seen.map((one) => this.asOf(one))) this.inLane(hand, () => this.keepFree(hand));
    for (const hand of this.seen.map((one) => this.asOf(one))) this.inLane(hand, () => this.drawHand(context, hand));
    this.labels.draw();
  }

  /** A hand as it was, while one looks at the past: without its pointer and its proxy. */
  asOf(hand) {
    const value = this.past(hand.name);
    if (!value) return hand;
    const [tip, commanded, applied] = ["p", "c", "a"].map((name) => hand.tip.map((_, axis) => value(`${name}${axis}`)));
    return Number.isFinite(tip[0]) ? { ...hand, tip, commanded, applied, target: null, proxy: null } : hand;
  }

  /** Keep the labels off the tip of a hand and its pointer. */
  keepFree({ tip, target }) {
    for (const [at, wide] of target ? [[tip, TIP], [target, RING]] : [[tip, TIP]]) {
      const [x, y] = this.project(at);
      this.labels.keep({ x, y, wide, high: wide });
    }
  }

  drawHand(context, hand) {
    const tip = pad(hand.tip);
    if (hand.target) spring(context, this.project(hand.target), this.project(tip));
    if (hand.proxy) {
      this.line(context, [tip, pad(hand.proxy)], colour("energy"), 2);
      this.dot(context, pad(hand.proxy), 6, colour("energy"));
    }
    this.drawForces(context, tip, hand);
    if (this.isCarded) ring(context, this.project(tip), colour(hand.colour ?? "text")); // the tip itself may be behind something
    else for (const [radius, fill] of [[10, "ground"], [8, hand.colour ?? "text"]]) this.dot(context, tip, radius, colour(fill));
    this.guide(context, hand, tip);
    const isDeep = this.axes < 2 && this.hasWall && tip[0] > this.wall, deep = `${quantity(tip[0] - this.wall, si.position)} deep`;
    const [x, y] = this.project(tip);
    if (hand.colour) this.labels.name(hand.name, isDeep ? `, ${deep}` : "", x + TIP / 2, y - TIP, colour(hand.colour));
    else if (isDeep) this.drawDepth(context, tip, deep);
  }

  /** Guide a hand in space, and who may drag it for the first time. */
  guide(context, hand, tip) {
    const [width, height] = sizeOf(this.canvas), point = this.axes > 2 && !hand.proxy ? nearest(this, tip) : null;
    if (point) drawNearest(this, context, tip, point);
    if (this.axes > 1) drawEdgeMark(this, context, hand, width, height);
    const isFirst = !hand.target && this.movable.some(({ name }) => name === hand.name) && !this.past(hand.name);
    if (isFirst) drawHint(this, context, tip, this.axes > 2 ? point : this.hasWall ? [this.wall, tip[1], tip[2]] : null);
  }

  /** The arrows of the applied and the commanded force, as the hand feels them, with their names. */
  drawForces(context, tip, { name, colour: own, commanded, applied }) {
    const [given, asked] = [applied, commanded].map((force) => Math.hypot(...force));
    const isWhole = given > WHOLE * asked;
    const [thin, whose] = own ? [3, `${name} `] : [6, ""]; // of several hands the colour says whose force it is
    context.globalAlpha = GHOST;
    if (!isWhole) this.arrow(context, tip, commanded, { stroke: colour(own ?? "commanded"), width: thin, side: -this.side, words: `${whose}commanded ${text(asked)} ${si.force}` });
    context.globalAlpha = 1;
    this.arrow(context, tip, applied, { stroke: colour(own ?? "true"), width: 6, side: 0, words: `${whose || "force "}${text(given)} ${si.force}`, isBelow: true });
  }

  /** How deep the tip is in the wall. */
  drawDepth(context, tip, words) {
    const [x0, y] = this.project([this.wall, 0, 0]), [x1] = this.project(tip), level = y + 2 * SIDE;
    context.lineWidth = 1;
    for (const x of [x0, x1]) segment(context, [x, level - 6], [x, level + 6], colour("soft"));
    segment(context, [x0, level], [x1, level], colour("soft"));
    this.labels.put(words, (x0 + x1) / 2, level + 18, colour("soft"));
  }

  /** The edges of a box: how far the pointer can go, or the workspace. */
  drawBox(context, middle, size) {
    const corners = boxCorners(middle, size);
    for (const ends of BOX_EDGES) this.line(context, ends.map((i) => corners[i]), colour("line"), 1);
    if (this.axes > 1) return;
    for (const x of [-size[0] / 2, size[0] / 2]) {
      const [at, level] = this.project([middle[0] + x, 0, 0]);
      context.strokeRect(at, level - 8, 0, 16);
    }
  }

  /** What lies in the plane of the screen: the wall, and the only axis. */
  drawGround(context, width, height) {
    const [x, y] = this.project([this.wall ?? 0, 0, 0]);
    context.lineWidth = 1;
    for (const hand of this.axes < 2 ? this.hands : []) {
      this.inLane(hand, () => segment(context, [0, y + this.lane], [width, y + this.lane], colour("line")));
    }
    if (!this.hasWall) return;
    context.fillStyle = colour("limit");
    context.fillRect(x, 0, Math.max(0, width - x), height);
    context.save();
    context.beginPath();
    context.rect(x, 0, Math.max(0, width - x), height);
    context.clip();
    context.strokeStyle = colour("hatch");
    context.beginPath();
    for (let at = Math.max(x, x % 14) - height; at < width; at += 14) {
      context.moveTo(at, height);
      context.lineTo(at + height, 0);
    }
    context.stroke();
    context.restore();
    context.lineWidth = 3;
    segment(context, [x, 0], [x, height], colour("soft"));
  }

  /** All that stands in space. */
  get solids() {
    if (this.axes < 3 || !this.hasWall) return this.objects;
    return [...this.objects, { shape: "plane", position: [this.wall, 0, 0], orientation: FACING }];
  }

  /** The objects, from a canvas of their own, which is drawn again when they or the view have changed. */
  drawLayer(context, width, height, isFlat) {
    const { solids } = this;
    if (this.card) this.card.canvas.hidden = !this.isCarded;
    if (this.isCarded) {
      const tips = this.seen.map((one) => this.asOf(one)).map(({ tip, colour: own }) => ({ place: pad(tip).map((x) => Math.round(2 * x * this.scale) / (2 * this.scale)), colour: rgb(colour(own ?? "text")) }));
      const isDark = matchMedia("(prefers-color-scheme: dark)").matches;
      const boxes = this.boxes.map(([, middle, size]) => ({ position: middle, size }));
      this.card.draw({ boxes, objects: solids, files: this.files, centre: this.centre, view: this.view, tips, isDark });
      if (isFlat) context.drawImage(this.card.canvas, 0, 0, width, height);
      return;
    }
    if (!solids.length) return;
    const shown = JSON.stringify([solids, this.files.size, this.centre, this.view, colour("line")]);
    if (shown !== this.shown) {
      this.shown = shown;
      paint(this, fit(this.layer, this.canvas).context, solids);
    }
    context.drawImage(this.layer, 0, 0, width, height);
  }

  line(context, points, stroke, width) {
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.beginPath();
    for (const point of points) context.lineTo(...this.project(point)); // the first one only begins
    context.stroke();
  }

  dot(context, point, radius, fill) {
    context.fillStyle = fill;
    context.beginPath();
    context.arc(...this.project(point), radius, 0, 2 * Math.PI);
    context.fill();
  }

  /** The force on the hand, against what resists, as an arrow with its name. */
  arrow(context, tip, force, { stroke, width, side, words, isBelow }) {
    const [x, y] = this.project(tip), [ex, ey] = this.project(sub(tip, pad(force)));
    const seen = Math.hypot(ex - x, ey - y); // pixels that a force of so many metres would have
    const full = (seen / this.scale) * (this.size / NEWTONS), length = Math.min(full, LONGEST * this.size), head = 3 * width;
    if (length < 4) return;
    const [ux, uy] = [(ex - x) / seen, (ey - y) / seen], [ox, oy] = this.axes < 2 ? [0, side] : [-uy * side, ux * side];
    const [x1, y1] = [x + ox + ux * length, y + oy + uy * length];
    const shaft = Math.max(length - head, 0);
    context.lineWidth = width;
    context.setLineDash(full > length ? [10, 6] : []);
    segment(context, [x + ox, y + oy], [x + ox + ux * shaft, y + oy + uy * shaft], stroke);
    context.setLineDash([]);
    context.fillStyle = stroke;
    context.beginPath();
    context.moveTo(x1, y1);
    for (const across of [-1, 1]) context.lineTo(x1 - ux * head + across * uy * head * 0.5, y1 - uy * head - across * ux * head * 0.5);
    context.fill();
    if (this.axes < 2) this.labels.keep({ x: (x + x1) / 2, y: y1, wide: length, high: head });
    if (this.axes < 2) this.labels.put(words, (x + x1) / 2, y + side + (isBelow ? 22 : -20), stroke);
    else this.labels.put(words, x1 + ux * 50, y1 + uy * 24 + (isBelow ? 20 : -20), stroke);
  }
}
