// The scene: the tip, its proxy, the forces, and what the environment says there is to draw.

import { colour, fit } from "./plots.js";
import { listen } from "./hand.js";

const FORCE = 0.004; // m that an arrow is long for each N
const NEAR = 0.08; // m, half of what is seen at first
const LIGHT = [0.4, -0.5, 0.77]; // from where it comes

const add = (a, b) => a.map((x, i) => x + b[i]);
const sub = (a, b) => a.map((x, i) => x - b[i]);
const scaled = (a, f) => a.map((x) => x * f);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const pad = (a) => [a?.[0] ?? 0, a?.[1] ?? 0, a?.[2] ?? 0];

function turned([w, x, y, z], a) {
  const axis = [x, y, z], twice = scaled(cross(axis, a), 2);
  return add(add(a, scaled(twice, w)), cross(axis, twice));
}

const BOX = [-1, 1].flatMap((x) => [-1, 1].flatMap((y) => [-1, 1].map((z) => [x / 2, y / 2, z / 2])));
const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
const BOX_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];

function round(count, at) {
  return Array.from({ length: count }, (_, i) => at((2 * Math.PI * i) / count));
}

/** Faces of an object in the world, each a list of points. */
function facesOf(object, meshes) {
  const place = (a) => add(object.position ?? [0, 0, 0], turned(object.orientation ?? [1, 0, 0, 0], a));
  const size = object.size ?? [];
  if (object.shape === "plane") {
    const half = 0.1;
    return [[[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]].map(place)];
  }
  if (object.shape === "box") {
    const corners = BOX.map((c) => place(c.map((x, i) => x * size[i])));
    return BOX_FACES.map((face) => face.map((i) => corners[i]));
  }
  if (object.shape === "cylinder") {
    const [radius, length] = size;
    const rim = (z) => round(24, (t) => place([radius * Math.cos(t), radius * Math.sin(t), z]));
    const low = rim(-length / 2), high = rim(length / 2);
    return [low, high, ...low.map((p, i) => [p, low[(i + 1) % 24], high[(i + 1) % 24], high[i]])];
  }
  if (object.shape === "sphere") {
    const [radius] = size, faces = [], rows = 8, count = 16;
    const at = (i, t) => place([radius * Math.sin((Math.PI * i) / rows) * Math.cos(t),
      radius * Math.sin((Math.PI * i) / rows) * Math.sin(t), radius * Math.cos((Math.PI * i) / rows)]);
    for (let i = 0; i < rows; i += 1) {
      round(count, (t) => faces.push([at(i, t), at(i + 1, t), at(i + 1, t + (2 * Math.PI) / count), at(i, t + (2 * Math.PI) / count)]));
    }
    return faces;
  }
  const mesh = meshes.get(object.digest);
  if (object.shape === "mesh" && mesh) return mesh.corners.map((face) => face.map(place));
  return [];
}

/** A face with its normal and how bright it is. */
function lit(points) {
  const normal = cross(sub(points[1], points[0]), sub(points[2], points[0]));
  return { points, normal, light: Math.abs(dot(normal, LIGHT)) / (Math.hypot(...normal) || 1) };
}

export class Scene {
  constructor(canvas, point) {
    Object.assign(this, { canvas, point });
    this.axes = 1;
    this.objects = [];
    this.meshes = new Map();
    this.centre = [0, 0, 0];
    this.half = NEAR;
    this.yaw = -0.5;
    this.pitch = 0.45;
    this.state = {};
    this.target = null; // m, where the pointer is; null: nobody points
    this.hand = null;
    this.isCentred = false;
    this.placed = new Map(); // of meshes, faces in the world
    this.layer = document.createElement("canvas"); // the objects alone
    this.shown = null; // what the layer shows
    listen(this);
  }

  describe(hello) {
    this.axes = hello.axes;
    this.workspace = hello.workspace;
    this.hand = hello.may_change ? hello.hand : null;
    if (this.axes < 3) { this.yaw = 0; this.pitch = Math.PI / 2; }
  }

  get basis() {
    const { yaw, pitch } = this;
    const right = [Math.cos(yaw), Math.sin(yaw), 0];
    const forward = [-Math.sin(yaw) * Math.cos(pitch), Math.cos(yaw) * Math.cos(pitch), -Math.sin(pitch)];
    return { right, forward, up: cross(right, forward) };
  }

  get scale() { return Math.min(this.canvas.clientWidth, this.canvas.clientHeight) / (2 * this.half); }

  /** Where a point is on the canvas, in pixels, in the view of this picture. */
  project(point) {
    const { right, up, scale, x, y } = this.view, from = sub(pad(point), this.centre);
    return [x + dot(from, right) * scale, y - dot(from, up) * scale];
  }

  zoom(factor) { this.half = Math.min(Math.max(this.half * factor, 0.002), 2); }

  turn(yaw, pitch) {
    if (this.axes < 3) return;
    this.yaw += yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -1.5), 1.5);
  }

  /** Let the pointer begin where the hand is. */
  grasp() { this.target ??= pad(this.state.tip); }

  /** Move the pointer by a way to the right, up and away on the screen, in m; `at`: when, by the event. */
  move([right, up, away], at) {
    const { basis, hand } = this;
    const way = add(add(scaled(basis.right, right), scaled(basis.up, up)), scaled(basis.forward, away));
    const start = pad(hand.start);
    this.target = add(this.target, way).map((x, i) => Math.min(Math.max(x, start[i] - hand.reach), start[i] + hand.reach));
    this.point(this.target.slice(0, this.axes), at);
  }

  /** Look at all that there is. */
  centreOn() {
    const points = [pad(this.state.tip), ...this.bounded.flatMap((object) => this.faces(object).flatMap((face) => face.points))];
    if (this.axes === 1) points.push([(this.wall ?? 0) - 0.03, 0, 0], [(this.wall ?? 0) + 0.03, 0, 0]);
    const low = [0, 1, 2].map((i) => points.reduce((least, p) => Math.min(least, p[i]), Infinity));
    const high = [0, 1, 2].map((i) => points.reduce((most, p) => Math.max(most, p[i]), -Infinity));
    this.centre = scaled(add(low, high), 0.5);
    this.half = Math.max(0.02, 0.6 * Math.hypot(...sub(high, low)));
  }

  get bounded() { return this.objects.filter((object) => object.shape !== "plane" && object.shape !== "path"); }

  /** Faces of an object in the world; those of a mesh are placed once. */
  faces(object) {
    if (object.shape !== "mesh") return facesOf(object, this.meshes).map(lit);
    const key = JSON.stringify([object.digest, object.position, object.orientation]);
    if (!this.placed.has(key) && this.meshes.has(object.digest)) {
      this.placed.clear();
      this.placed.set(key, facesOf(object, this.meshes).map(lit));
    }
    return this.placed.get(key) ?? [];
  }

  draw() {
    const { context, width, height } = fit(this.canvas);
    const isWhole = this.bounded.every((object) => object.shape !== "mesh" || this.meshes.has(object.digest));
    if (!this.isCentred && this.state.tip && (this.axes === 1 ? this.wall !== undefined : this.bounded.length) && isWhole) {
      this.isCentred = true;
      this.centreOn();
    }
    this.view = { ...this.basis, scale: this.scale, x: width / 2, y: height / 2 };
    if (this.hand) this.drawBox(context, pad(this.hand.start), [0, 1, 2].map((i) => (i < this.axes ? this.hand.reach : 0)));
    if (this.workspace) this.drawBox(context, [0, 0, 0], this.workspace.map((edge) => edge / 2));
    if (this.axes === 1) this.drawWall(context, width, height);
    this.drawLayer(context, width, height);
    const tip = pad(this.state.tip);
    if (this.state.proxy) {
      this.line(context, [tip, pad(this.state.proxy)], colour("energy"), 2);
      this.dot(context, pad(this.state.proxy), 5, colour("energy"));
    }
    this.arrow(context, tip, this.state.commanded, colour("commanded"), 5);
    this.arrow(context, tip, this.state.applied, colour("true"), 3);
    if (this.target) this.ring(context, this.target);
    this.dot(context, tip, 7, colour("text"));
  }

  /** The edges of a box: how far the pointer can go, or the workspace. */
  drawBox(context, middle, halves) {
    const corner = (i) => middle.map((x, axis) => x + ((i >> axis) & 1 ? halves[axis] : -halves[axis]));
    for (const ends of EDGES) this.line(context, ends.map(corner), colour("line"), 1);
    if (this.axes > 1) return;
    for (const x of [-halves[0], halves[0]]) {
      const [at, level] = this.project([middle[0] + x, 0, 0]);
      context.strokeRect(at, level - 8, 0, 16);
    }
  }

  drawWall(context, width, height) {
    const [x] = this.project([this.wall ?? 1e3, 0, 0]), [, y] = this.project([0, 0, 0]);
    context.fillStyle = colour("limit");
    if (this.wall !== null && this.wall !== undefined && !this.objects.length) context.fillRect(x, 0, width - x, height);
    context.strokeStyle = colour("line");
    context.beginPath();
    context.moveTo(0, y);
    context.lineTo(width, y);
    context.stroke();
  }

  /** The objects, from a canvas of their own, which is drawn anew when they or the view have changed. */
  drawLayer(context, width, height) {
    if (!this.objects.length) return;
    const shown = JSON.stringify([this.objects, this.meshes.size, this.centre, this.view, colour("line")]);
    if (shown !== this.shown) {
      this.shown = shown;
      this.drawObjects(fit(this.layer, this.canvas).context);
    }
    context.drawImage(this.layer, 0, 0, width, height);
  }

  drawObjects(context) {
    const { forward } = this.view, drawn = [];
    for (const object of this.objects) {
      if (object.shape === "path") { this.line(context, object.points, colour("soft"), 2); continue; }
      for (const face of this.faces(object)) {
        if (object.is_closed && dot(face.normal, forward) > 0) continue; // seen from behind
        drawn.push({ face, depth: dot(face.points[0], forward) + dot(face.points[2], forward), object });
      }
    }
    drawn.sort((a, b) => b.depth - a.depth);
    const lines = colour("line");
    context.lineWidth = 0.5;
    for (const { face, object } of drawn) {
      context.beginPath();
      face.points.forEach((point, i) => { const at = this.project(point); if (i) context.lineTo(...at); else context.moveTo(...at); });
      context.closePath();
      if (object.is_removed) {
        context.strokeStyle = lines;
        context.stroke();
        continue;
      }
      const grey = Math.round(110 + 110 * face.light);
      const fill = object.shape === "plane" ? "rgba(128,128,128,.15)" : `rgb(${grey},${grey},${grey + 10})`;
      context.fillStyle = fill;
      context.fill();
      context.strokeStyle = object.shape === "mesh" ? fill : lines; // no gaps between its triangles
      context.stroke();
    }
  }

  line(context, points, stroke, width) {
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.beginPath();
    points.forEach((point, i) => { const at = this.project(point); if (i) context.lineTo(...at); else context.moveTo(...at); });
    context.stroke();
  }

  dot(context, point, radius, fill) {
    context.fillStyle = fill;
    context.beginPath();
    context.arc(...this.project(point), radius, 0, 2 * Math.PI);
    context.fill();
  }

  ring(context, point) {
    context.strokeStyle = colour("soft");
    context.lineWidth = 2;
    context.beginPath();
    context.arc(...this.project(point), 12, 0, 2 * Math.PI);
    context.stroke();
  }

  /** The force on the hand: against what resists. */
  arrow(context, tip, force, stroke, width) {
    if (!force) return;
    const end = sub(tip, scaled(pad(force), FORCE));
    const [x0, y0] = this.project(tip), [x1, y1] = this.project(end);
    const length = Math.hypot(x1 - x0, y1 - y0);
    if (length < 2) return;
    this.line(context, [tip, end], stroke, width);
    const [ux, uy] = [(x1 - x0) / length, (y1 - y0) / length], head = 3 * width;
    context.fillStyle = stroke;
    context.beginPath();
    context.moveTo(x1 + ux * head, y1 + uy * head);
    context.lineTo(x1 - uy * head * 0.7, y1 + ux * head * 0.7);
    context.lineTo(x1 + uy * head * 0.7, y1 - ux * head * 0.7);
    context.fill();
  }
}
