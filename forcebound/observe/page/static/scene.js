// The scene: the tip, its proxy, the forces, and what the environment says there is to draw.

import { colour, fit } from "./canvas.js";
import { listen } from "./hand.js";
import { BOX_EDGES, add, boxCorners, cross, dot, facesOf, pad, pointsOf, scaled, sub } from "./shapes.js";

const FORCE = 0.004; // m that an arrow is long for each N
const NEAR = 0.08; // m, half of what is seen at first
const ABOUT = 0.03; // m about a wall that is seen
const OWN = 500; // ms that the pointer of this page is its own after a move
const OPEN = ["plane", "path"]; // shapes that one need not see whole
const FACING = [Math.SQRT1_2, 0, -Math.SQRT1_2, 0]; // w x y z; turns z to -x, out of a wall

export class Scene {
  constructor(canvas, point) {
    Object.assign(this, { canvas, point });
    this.files = new Map(); // digest -> corners of a mesh, or points of a cloud
    this.placed = new Map(); // of meshes, faces in the world
    this.layer = document.createElement("canvas"); // the objects alone
    this.begin({ axes: 1 });
    listen(this);
  }

  /** Show a graph of which nothing is known yet. */
  begin({ graph, axes, workspace }) {
    Object.assign(this, { graph, axes, workspace });
    this.state = {};
    this.objects = [];
    this.wall = undefined; // m, where its surface is; null: there is none; undefined: not known yet
    this.target = null; // m, where the pointer is; null: nobody points
    this.moved = -Infinity; // ms, when this page moved it last
    this.hand = null;
    this.centre = [0, 0, 0];
    this.half = NEAR;
    this.isCentred = false;
    [this.yaw, this.pitch] = axes < 3 ? [0, Math.PI / 2] : [-0.5, 0.45];
    this.shown = null; // what the layer shows
  }

  /** Show a graph; of the same one as before the view stays. */
  describe(hello) {
    if (hello.graph !== this.graph) this.begin(hello);
    this.hand = hello.may_change ? hello.hand : null;
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

  /** Take over where the pointer is, since another page may have moved it. */
  follow(pointer) {
    if (pointer && performance.now() - this.moved > OWN) this.target = pad(pointer);
  }

  /** Move the pointer by a way to the right, up and away on the screen, in m; `at`: when, by the event. */
  move([right, up, away], at) {
    const { basis, reaches } = this;
    const way = add(add(scaled(basis.right, right), scaled(basis.up, up)), scaled(basis.forward, away));
    const start = pad(this.hand.start);
    this.target = add(this.target, way).map((x, i) => Math.min(Math.max(x, start[i] - reaches[i]), start[i] + reaches[i]));
    this.moved = performance.now();
    this.point(this.target.slice(0, this.axes), at);
  }

  /** How far the pointer can go from its start on each axis, in m. */
  get reaches() { return [0, 1, 2].map((axis) => (axis < this.axes ? this.hand.reach : 0)); }

  /** Whether all that the view is to show at first is here. */
  get isWhole() {
    return this.state.tip && this.wall !== undefined && (this.wall !== null || this.objects.length)
      && this.objects.every((object) => !object.digest || this.files.has(object.digest));
  }

  /** Look at all that there is. */
  centreOn() {
    const seen = this.objects.filter((object) => !OPEN.includes(object.shape));
    const points = [pad(this.state.tip), ...seen.flatMap((object) => this.pointsOf(object))];
    if (this.hasWall) points.push([this.wall - ABOUT, 0, 0], [this.wall + ABOUT, 0, 0]);
    if (this.hand && this.axes < 3) points.push(...boxCorners(pad(this.hand.start), scaled(this.reaches, 2)));
    const low = [0, 1, 2].map((i) => points.reduce((least, p) => Math.min(least, p[i]), Infinity));
    const high = [0, 1, 2].map((i) => points.reduce((most, p) => Math.max(most, p[i]), -Infinity));
    this.centre = scaled(add(low, high), 0.5);
    this.half = Math.max(0.02, 0.6 * Math.hypot(...sub(high, low)));
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

  draw() {
    const { context, width, height } = fit(this.canvas);
    if (!this.isCentred && this.isWhole) {
      this.isCentred = true;
      this.centreOn();
    }
    this.view = { ...this.basis, scale: this.scale, x: width / 2, y: height / 2 };
    if (this.hand) this.drawBox(context, pad(this.hand.start), scaled(this.reaches, 2));
    if (this.workspace) this.drawBox(context, [0, 0, 0], this.workspace);
    if (this.axes < 3) this.drawGround(context, width, height);
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
    context.fillStyle = colour("limit");
    if (this.hasWall) context.fillRect(x, 0, Math.max(0, width - x), height);
    if (this.axes > 1) return;
    context.strokeStyle = colour("line");
    context.beginPath();
    context.moveTo(0, y);
    context.lineTo(width, y);
    context.stroke();
  }

  /** All that stands in space. */
  get solids() {
    if (this.axes < 3 || !this.hasWall) return this.objects;
    return [...this.objects, { shape: "plane", position: [this.wall, 0, 0], orientation: FACING }];
  }

  /** The objects, from a canvas of their own, which is drawn anew when they or the view have changed. */
  drawLayer(context, width, height) {
    const { solids } = this;
    if (!solids.length) return;
    const shown = JSON.stringify([solids, this.files.size, this.centre, this.view, colour("line")]);
    if (shown !== this.shown) {
      this.shown = shown;
      this.drawObjects(fit(this.layer, this.canvas).context, solids);
    }
    context.drawImage(this.layer, 0, 0, width, height);
  }

  drawObjects(context, solids) {
    const { forward } = this.view;
    const faces = solids.flatMap((object) => this.facesOf(object).map((face) => (
      { ...face, object, depth: dot(face.points[0], forward) + dot(face.points[2], forward) })));
    faces.sort((a, b) => b.depth - a.depth);
    for (const face of faces) this.drawFace(context, face);
    for (const object of solids) {
      const points = pointsOf(object, this.files.get(object.digest));
      if (object.shape === "path" && points.length) this.line(context, points, colour("soft"), 2);
      if (object.shape === "points") this.drawCloud(context, points);
    }
  }

  drawFace(context, { points, light, object }) {
    context.lineWidth = 0.5;
    context.beginPath();
    for (const point of points) context.lineTo(...this.project(point));
    context.closePath();
    context.strokeStyle = colour("line");
    if (!object.is_removed) {
      const grey = Math.round(110 + 110 * light);
      context.fillStyle = object.shape === "plane" ? "rgba(128,128,128,.15)" : `rgb(${grey},${grey},${grey + 10})`;
      context.fill();
      if (object.shape === "mesh") context.strokeStyle = context.fillStyle; // no gaps between its triangles
    }
    context.stroke();
  }

  drawCloud(context, points) {
    context.fillStyle = colour("soft");
    for (const point of points) {
      const [x, y] = this.project(point);
      context.fillRect(x - 1, y - 1, 2, 2);
    }
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
