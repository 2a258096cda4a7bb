// Words on a canvas, which move out of each other's way.

import { colour } from "./canvas.js";

const HEIGHT = 18; // pixels of a line
const ROOM = 6; // pixels beside words
const FARTHEST = 4; // lines that words are moved, at most

const meets = (a, b) => Math.abs(a.x - b.x) < (a.wide + b.wide) / 2 && Math.abs(a.y - b.y) < (a.high + b.high) / 2;

/** Places near one, the nearest first: above and below in turn, then also beside it. */
function* near({ x, y, wide, high }) {
  for (let lines = 0; lines <= FARTHEST; lines += 1) {
    for (const away of lines ? [-lines, lines] : [0]) yield { x, y: y + away * high, wide, high };
    for (const away of lines ? [-lines, lines] : []) yield { x: x + (away * wide) / 2, y, wide, high };
  }
}

/** The words on one canvas, and the places that they take; `begin` for each picture. */
export class Labels {
  begin(context, width, height) { Object.assign(this, { context, width, height, taken: [], placed: [], waiting: [] }); }

  /** Keep a place free of words: {x, y} of its middle, how wide and high it is, in pixels. */
  keep(place) { this.taken.push(place); }

  /** Where words with this place can be; undefined: nowhere near, all is full. */
  find(place) {
    const isIn = ({ y, high }) => y >= high / 2 && y <= this.height - high / 2;
    const within = (one) => ({ ...one, x: Math.max(Math.min(one.x, this.width - one.wide / 2), one.wide / 2) });
    return [...near(place)].map(within).find((one) => isIn(one) && !this.taken.some((other) => meets(one, other)));
  }

  /** Have words about a place, once all places to keep free are known. */
  put(words, x, y, fill) { this.waiting.push({ all: [words], x, y, fill }); }

  /** Have a name to the right of a place, with more words if there is room; names come first. */
  name(name, more, x, y, fill) { this.waiting.unshift({ all: [name + more, name], x, y, fill, isBeside: true }); }

  /** Draw the words, with a rim, so that they can be read on whatever is behind. */
  draw() {
    const { context } = this;
    context.font = context.font.replace("12px", "600 14px");
    Object.assign(context, { textAlign: "center", textBaseline: "middle", lineWidth: 4, lineJoin: "round", strokeStyle: colour("scene") });
    for (const { all, x, y, fill, isBeside } of this.waiting) {
      const [place] = all.flatMap((words) => {
        const wide = context.measureText(words).width + 2 * ROOM, found = this.find({ x: isBeside ? x + wide / 2 : x, y, wide, high: HEIGHT });
        return found ? [{ ...found, words }] : [];
      });
      if (!place) continue; // the states have it, too
      const { words } = place;
      this.keep(place);
      this.placed.push(place);
      context.fillStyle = fill;
      context.strokeText(words, place.x, place.y);
      context.fillText(words, place.x, place.y);
    }
    context.font = context.font.replace("600 14px", "12px");
  }
}
