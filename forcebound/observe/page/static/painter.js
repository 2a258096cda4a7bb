// The objects of a scene, painted from far to near, where no graphics card draws them.

import { colour } from "./canvas.js";
import { dot, pointsOf } from "./shapes.js";

export function paint(scene, context, solids) {
  const { forward } = scene.view;
  const depth = (points) => points.reduce((sum, point) => sum + dot(point, forward), 0) / points.length;
  const faces = solids.flatMap((object) => scene.facesOf(object).map((face) => ({ ...face, object, depth: depth(face.points) })));
  faces.sort((a, b) => b.depth - a.depth);
  for (const face of faces) paintFace(scene, context, face);
  for (const object of solids) {
    const points = pointsOf(object, scene.files.get(object.digest));
    if (object.shape === "path" && points.length) scene.line(context, points, colour("soft"), 2);
    if (object.shape === "points") drawCloud(scene, context, points);
  }
}

function paintFace(scene, context, { points, light, object }) {
  context.lineWidth = 0.5;
  context.beginPath();
  for (const point of points) context.lineTo(...scene.project(point));
  context.closePath();
  context.strokeStyle = colour("line");
  if (!object.is_removed) {
    const grey = Math.round(95 + 120 * light);
    context.fillStyle = object.shape === "plane" ? "rgba(128,140,150,.18)" : `rgb(${grey - 8},${grey + 4},${grey + 14})`;
    context.fill();
    if (["mesh", "sphere"].includes(object.shape)) context.strokeStyle = context.fillStyle; // no gaps between its faces
  }
  context.stroke();
}

function drawCloud(scene, context, points) {
  context.fillStyle = colour("soft");
  for (const point of points) {
    const [x, y] = scene.project(point);
    context.fillRect(x - 1, y - 1, 2, 2);
  }
}
