// Numbers as people read them: three digits, steps of 1, 2 and 5, ranges of plots. No element of the page is used here.

const LEAST = 1e-9; // below, a number is a rounding error
/** SI unit -> [how many everyday units it has, which]; the server sends it. */
export const units = {};
/** SI units of the axes, which may be angles; the server sends them. */
export const si = { position: "m", force: "N", stiffness: "N/m" };

export const magnitude = (vector) => (vector.length === 1 ? vector[0] : Math.hypot(...vector)); // on one axis with its sign

/** A number with three digits. */
export function text(value) {
  if (!Number.isFinite(value)) return "–";
  return Math.abs(value) < LEAST ? "0" : String(Number(value.toPrecision(3)));
}

/** How many everyday units an SI unit has, and which. */
export const everyday = (of) => units[of] ?? [1, of];

/** A value in SI, in its everyday unit. */
export function quantity(value, of) {
  const [factor, unit] = everyday(of);
  return `${text(factor * value)} ${unit}`;
}

const round = (rough, factors) => {
  const power = 10 ** Math.floor(Math.log10(rough));
  return factors.map((f) => f * power);
};

/** Where a scale from `low` to `high` has its about `count` ticks, and at least two. */
export function ticks(low, high, count) {
  const rough = (high - low) / count, step = round(rough, [1, 2, 5, 10]).find((s) => s >= rough), found = [];
  for (let tick = Math.ceil(low / step) * step; tick <= high + step * 1e-9; tick += step) found.push(tick);
  return found.length > 1 ? found : ticks(low, high, 2 * count);
}

/** The scale bar of a scene: a round length that is at most `most` pixels long. */
export function scaleBar(pixelsPerMetre, most) {
  const metres = round(most / pixelsPerMetre, [5, 2, 1]).find((length) => length * pixelsPerMetre <= most);
  return { pixels: metres * pixelsPerMetre, words: quantity(metres, si.position) };
}

/** The range of a plot's columns [{at, low, high}] after the pixel `from`, with 0 and some room; at least `least`. */
export function rangeOf(columns, from, least) {
  let low = 0, high = 0;
  for (const column of columns) {
    if (column.at <= from) continue;
    low = Math.min(low, column.low);
    high = Math.max(high, column.high);
  }
  if (high - low < least) high = low + least;
  const room = 0.08 * (high - low);
  return [low - (low < 0 ? room : 0), high + room];
}
