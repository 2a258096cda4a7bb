// A hand whose axes are joints: a dial for each angle, a bar for each length, which are no places in space.

import { colour } from "./canvas.js";
import { quantity } from "./scale.js";
import { segment } from "./strokes.js";

const LONG = 0.25; // m, half of what a bar shows
const HEAD = 18; // pixels for the name of a hand
const LINE = 15; // pixels of a line of words
const LARGEST = 60; // pixels of the radius of a dial
const NARROW = 112; // pixels that the words below a dial need

/** Draw the joints of hands into `width` x `height` pixels; `axes`: [{name, isAngle}]. */
export function drawJoints(context, hands, axes, width, height) {
  const columns = Math.max(1, Math.min(axes.length, Math.floor(width / NARROW))), rows = Math.ceil(axes.length / columns);
  const own = height / hands.length, wide = width / columns, high = (own - HEAD) / rows;
  const radius = Math.max(4, Math.min(wide / 2 - 8, (high - 3 * LINE) / 2, LARGEST));
  hands.forEach((hand, k) => {
    Object.assign(context, { textAlign: "left", textBaseline: "top", fillStyle: colour(hand.colour ?? "text") });
    if (hands.length > 1) context.fillText(hand.name, 8, k * own + 4);
    axes.forEach((axis, i) => {
      const x = wide * ((i % columns) + 0.5), y = k * own + HEAD + high * Math.floor(i / columns) + radius;
      drawJoint(context, { x, y, radius, axis, value: hand.tip[i], force: hand.applied[i], stroke: colour(hand.colour ?? "true") });
    });
  });
}

function drawJoint(context, { x, y, radius, axis: { name, isAngle }, value, force, stroke }) {
  context.lineWidth = 1;
  context.strokeStyle = colour("soft");
  const share = Math.min(Math.max(value / LONG, -1), 1);
  if (isAngle) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
  } else context.strokeRect(x - radius, y - 4, 2 * radius, 8);
  context.lineWidth = 4;
  if (isAngle) segment(context, [x, y], [x + radius * Math.cos(value), y - radius * Math.sin(value)], stroke); // 0: to the right
  else segment(context, [x, y], [x + radius * share, y], stroke);
  Object.assign(context, { textAlign: "center", textBaseline: "top", fillStyle: colour("text") });
  [name, quantity(value, isAngle ? "rad" : "m"), quantity(force, isAngle ? "N m" : "N")].forEach((words, line) => context.fillText(words, x, y + radius + 3 + line * LINE));
}
