// The scene: the tip, its proxy, the forces, and what the environment says there is to draw.

import { colour, fit } from "./plots.js";

const FORCE = 0.004; // m that an arrow is long for each N
const NEAR = 0.08; // m, half of what is seen at first
const MOST_FACES = 4000; // of a mesh, to be drawn

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
    this.listen();
  }

  describe(hello) {
    this.axes = hello.axes;
    this.wall = hello.wall;
    this.hand = hello.may_change ? hello.hand : null;
    if (this.axes < 3) { this.yaw = 0; this.pitch = Math.PI / 2; }
    if (this.axes === 1) this.half = 0.04;
  }

  get basis() {
    const { yaw, pitch } = this;
    const right = [Math.cos(yaw), Math.sin(yaw), 0];
    const forward = [-Math.sin(yaw) * Math.cos(pitch), Math.cos(yaw) * Math.cos(pitch), -Math.sin(pitch)];
    return { right, forward, up: cross(right, forward) };
  }

  get scale() { return Math.min(this.canvas.clientWidth, this.canvas.clientHeight) / (2 * this.half); }

  project(point) {
    const { right, up } = this.basis, from = sub(pad(point), this.centre);
    return [this.canvas.clientWidth / 2 + dot(from, right) * this.scale,
      this.canvas.clientHeight / 2 - dot(from, up) * this.scale];
  }

  listen() {
    const { canvas } = this;
    let drag = null;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      const turns = event.button === 2 || event.shiftKey || !this.hand;
      drag = { x: event.clientX, y: event.clientY, turns };
      if (!turns) this.target ??= pad(this.state.tip);
    });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointermove", (event) => {
      if (!drag) return;
      for (const one of event.getCoalescedEvents?.() ?? [event]) {
        const dx = one.clientX - drag.x, dy = one.clientY - drag.y;
        Object.assign(drag, { x: one.clientX, y: one.clientY });
        if (!drag.turns) this.move(dx / this.scale, -dy / this.scale, 0);
        else if (this.axes > 2) {
          this.yaw -= dx * 0.01;
          this.pitch = Math.min(Math.max(this.pitch + dy * 0.01, -1.5), 1.5);
        }
      }
    });
    const end = () => { drag = null; };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.half = Math.min(Math.max(this.half * (event.deltaY > 0 ? 1.1 : 0.9), 0.002), 2);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const mm = 1e-3;
      const way = { ArrowLeft: [-mm, 0, 0], ArrowRight: [mm, 0, 0], ArrowUp: [0, mm, 0], ArrowDown: [0, -mm, 0],
        PageUp: [0, 0, mm], PageDown: [0, 0, -mm] }[event.key];
      if (!way || !this.hand) return;
      event.preventDefault();
      this.target ??= pad(this.state.tip);
      this.move(...way);
    });
  }

  /** Move the pointer by ways to the right, up and away on the screen, in m. */
  move(right, up, away) {
    const { basis, hand } = this;
    const way = add(add(scaled(basis.right, right), scaled(basis.up, up)), scaled(basis.forward, away));
    const start = pad(hand.start);
    this.target = add(this.target, way).map((x, i) => Math.min(Math.max(x, start[i] - hand.reach), start[i] + hand.reach));
    this.point(this.target.slice(0, this.axes));
  }

  draw() {
    const { context, width, height } = fit(this.canvas);
    if (this.axes === 1) this.drawWall(context, width, height);
    this.drawObjects(context);
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

  drawObjects(context) {
    const { forward } = this.basis, drawn = [];
    for (const object of this.objects) {
      if (object.shape === "path") { this.line(context, object.points, colour("soft"), 2); continue; }
      let faces = facesOf(object, this.meshes);
      const step = Math.ceil(faces.length / MOST_FACES);
      if (step > 1) faces = faces.filter((_, i) => i % step === 0);
      for (const face of faces) {
        const normal = cross(sub(face[1], face[0]), sub(face[2], face[0]));
        const light = Math.abs(dot(normal, [0.4, -0.5, 0.77])) / (Math.hypot(...normal) || 1);
        drawn.push({ face, light, depth: dot(face[0], forward), object });
      }
    }
    drawn.sort((a, b) => b.depth - a.depth);
    for (const { face, light, object } of drawn) {
      context.beginPath();
      face.forEach((point, i) => { const at = this.project(point); if (i) context.lineTo(...at); else context.moveTo(...at); });
      context.closePath();
      context.strokeStyle = colour("line");
      context.lineWidth = 0.5;
      if (!object.is_removed) {
        const grey = Math.round(110 + 110 * light);
        context.fillStyle = object.shape === "plane" ? "rgba(128,128,128,.15)" : `rgba(${grey},${grey},${grey + 10},.85)`;
        context.fill();
      }
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
