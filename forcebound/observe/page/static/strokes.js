// Strokes of a scene, between places in pixels.

import { colour } from "./canvas.js";

const TURNS = 14; // of a spring

export function segment(context, from, to, stroke) {
  context.strokeStyle = stroke;
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.stroke();
}

/** The rim of a tip. */
export function ring(context, at, stroke) {
  context.strokeStyle = stroke;
  context.lineWidth = 1.5;
  context.beginPath();
  context.arc(...at, 9.5, 0, 2 * Math.PI);
  context.stroke();
}

/** The spring of a hand, from where it pulls to the tip, and the ring of its end. */
export function spring(context, from, to) {
  const line = [to[0] - from[0], to[1] - from[1]], length = Math.hypot(...line), wide = Math.min(9, length / 4);
  context.strokeStyle = colour("soft");
  context.lineWidth = 1.5;
  context.beginPath();
  for (let i = 0; i <= TURNS && length > 1; i += 1) {
    const off = i % TURNS === 0 ? 0 : i % 2 ? wide : -wide;
    context.lineTo(from[0] + (line[0] * i) / TURNS - (line[1] / length) * off, from[1] + (line[1] * i) / TURNS + (line[0] / length) * off);
  }
  context.stroke();
  context.lineWidth = 3;
  context.beginPath();
  context.arc(...from, 16, 0, 2 * Math.PI);
  context.stroke();
}
