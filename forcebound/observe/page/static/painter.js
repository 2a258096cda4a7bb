// The objects of a scene, painted from far to near, where no graphics card draws them.

import { colour } from "./canvas.js";
import { dot, pointsOf } from "./shapes.js";

export function paint(scene, context, solids) {
  const { forward } = scene.view, faces = [];
  for (const object of solids) {
    for (const { points, light } of scene.facesOf(object)) {
      let depth = 0;
      for (const point of points) depth += dot(point, forward) / points.length;
      faces.push({ points, light, object, depth });
    }
  }
  faces.sort((a, b) => b.depth - a.depth);
  context.lineWidth = 0.5;
  for (const face of faces) paintFace(scene, context, face);
  for (const object of solids) {
    const points = pointsOf(object, scene.files.get(object.digest));
    if (object.shape === "path" && points.length) scene.line(context, points, colour("soft"), 2);
    if (object.shape === "points") drawCloud(scene, context, points);
  }
}

/** Paint a face; thousands of a mesh have their turn in one picture, so nothing is made for a point. */
function paintFace({ view: { right, up, scale, x, y }, centre }, context, { points, light, object }) {
  context.beginPath();
  for (const point of points) {
    const a = point[0] - centre[0], b = point[1] - centre[1], c = point[2] - centre[2];
    context.lineTo(x + (a * right[0] + b * right[1] + c * right[2]) * scale, y - (a * up[0] + b * up[1] + c * up[2]) * scale);
  }
  context.closePath();
  let edge = colour("line");
  if (!object.is_removed) {
    const grey = Math.round(95 + 120 * light), fill = object.shape === "plane" ? "rgba(128,140,150,.18)" : `rgb(${grey - 8},${grey + 4},${grey + 14})`;
    context.fillStyle = fill;
    context.fill();
    if (["mesh", "sphere"].includes(object.shape)) edge = fill; // no gaps between its faces
  }
  context.strokeStyle = edge;
  context.stroke();
}

function drawCloud(scene, context, points) {
  context.fillStyle = colour("soft");
  for (const point of points) {
    const [x, y] = scene.project(point);
    context.fillRect(x - 1, y - 1, 2, 2);
  }
}
