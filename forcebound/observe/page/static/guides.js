// What guides a hand in space: a line to the nearest surface, a mark at the edge, and a hint where to drag.

import { colour } from "./canvas.js";
import { quantity, si } from "./scale.js";
import { add, closest, dot, pad, placeOf, scaled, sub } from "./shapes.js";
import { segment } from "./strokes.js";

const FAR = 0.15; // m, from which on nothing is near
const EDGE = 22; // pixels between the edge and a mark at it
const HINT = 95; // pixels, length of the hint

/** A face with how far from its first point its others are, at most. */
function bounded(face) {
  face.reach ??= Math.max(...face.points.map((point) => Math.hypot(...sub(point, face.points[0]))));
  return face;
}

/** Points of an object that may be nearest to a place, and nearer than `limit` gives. */
function* candidates(scene, object, place, limit) {
  const position = pad(object.position), away = sub(place, position);
  if (object.shape === "sphere" && object.size?.length) yield add(position, scaled(away, object.size[0] / (Math.hypot(...away) || 1)));
  else if (object.shape === "plane") {
    const normal = sub(placeOf(object)([0, 0, 1]), position);
    yield sub(place, scaled(normal, dot(away, normal)));
  } else {
    for (const face of scene.facesOf(object)) {
      const { points, reach } = bounded(face), [x, y, z] = points[0];
      if (Math.hypot(x - place[0], y - place[1], z - place[2]) - reach >= limit()) continue;
      for (let i = 2; i < points.length; i += 1) yield closest(place, [points[0], points[i - 1], points[i]]);
    }
  }
}

/** The point of the surfaces nearest to a place; null: there is none near, or something is cut out of them. */
export function nearest(scene, place) {
  if (scene.solids.some((object) => object.is_removed)) return null;
  let found = null, least = FAR;
  for (const object of scene.solids) {
    for (const point of candidates(scene, object, place, () => least)) {
      const distance = Math.hypot(point[0] - place[0], point[1] - place[1], point[2] - place[2]);
      if (distance < least) [found, least] = [point, distance];
    }
  }
  return found;
}

/** A line from a tip in space to the nearest surface, with the distance. */
export function drawNearest(scene, context, tip, point) {
  const [from, to] = [scene.project(tip), scene.project(point)];
  context.lineWidth = 1.5;
  context.setLineDash([2, 4]);
  segment(context, from, to, colour("soft"));
  context.setLineDash([]);
  context.fillStyle = colour("soft");
  context.beginPath();
  context.arc(...to, 3.5, 0, 2 * Math.PI);
  context.fill();
  if (Math.hypot(to[0] - from[0], to[1] - from[1]) > 30) scene.labels.put(quantity(Math.hypot(...sub(tip, point)), si.position), (from[0] + to[0]) / 2, (from[1] + to[1]) / 2 + 16, colour("soft"));
}

/** Mark at the edge where a tip is that is out of the picture. */
export function drawEdgeMark(scene, context, { tip, name, colour: own }, width, height) {
  const [x, y] = scene.project(tip);
  if (x >= 0 && x <= width && y >= 0 && y <= height) return;
  const at = [Math.min(Math.max(x, EDGE), width - EDGE), Math.min(Math.max(y, EDGE), height - EDGE)];
  const angle = Math.atan2(y - at[1], x - at[0]), stroke = colour(own ?? "text");
  context.save();
  context.translate(...at);
  context.rotate(angle);
  context.fillStyle = stroke;
  context.beginPath();
  for (const corner of [[15, 0], [-9, -11], [-3, 0], [-9, 11]]) context.lineTo(...corner);
  context.fill();
  context.restore();
  scene.labels.keep({ x: at[0], y: at[1], wide: 30, high: 30 });
  scene.labels.put(own ? name : "tip: Centre shows it", at[0], at[1] + (at[1] > height / 2 ? -26 : 26), stroke);
}

/** Where to drag, until somebody does: towards what can be touched. */
export function drawHint(scene, context, tip, towards) {
  const from = scene.project(tip), to = towards ? scene.project(towards) : [from[0] + 1, from[1]], beat = (performance.now() / 1400) % 1;
  const away = [to[0] - from[0], to[1] - from[1]], long = Math.hypot(...away) || 1, [ux, uy] = long > 4 ? away.map((x) => x / long) : [1, 0];
  const tint = colour("true"), [x, y] = [from[0] + ux * HINT, from[1] + uy * HINT];
  context.save();
  Object.assign(context, { lineWidth: 3, lineCap: "round", fillStyle: tint });
  context.globalAlpha = 1 - beat;
  context.beginPath();
  context.strokeStyle = tint;
  context.arc(...from, 12 + 22 * beat, 0, 2 * Math.PI);
  context.stroke();
  context.globalAlpha = 0.9;
  segment(context, [from[0] + 18 * ux, from[1] + 18 * uy], [x, y], tint);
  context.beginPath();
  for (const [along, across] of [[14, 0], [-6, -9], [-6, 9]]) context.lineTo(x + along * ux - across * uy, y + along * uy + across * ux);
  context.fill();
  context.restore();
  scene.labels.keep({ x: (x + from[0]) / 2, y: (y + from[1]) / 2, wide: Math.abs(x - from[0]) + 16, high: Math.abs(y - from[1]) + 16 });
  scene.labels.put("drag", (x + from[0]) / 2, Math.min(from[1], y) - 22, tint);
}
