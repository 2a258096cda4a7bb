// What every canvas of the page needs: its size, and the colours of the style sheet.

const colours = new Map(); // reading a style makes the browser compute all that has changed
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => colours.clear());

/** A colour of the style sheet. */
export function colour(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return colours.get(name);
}

const font = getComputedStyle(document.body).fontFamily;

const sizes = new WeakMap(); // of elements, in pixels: to read them where the page has changed makes the browser lay it out
const observer = new ResizeObserver((entries) => { for (const { target } of entries) sizes.set(target, [target.clientWidth, target.clientHeight]); });

/** Width and height of an element, in pixels, as they were laid out last. */
export function sizeOf(element) {
  if (!sizes.has(element)) {
    observer.observe(element);
    sizes.set(element, [element.clientWidth, element.clientHeight]);
  }
  return sizes.get(element);
}

/** Clear a canvas and give it the size that `shown`, an element of the page, has. */
export function fit(canvas, shown = canvas) {
  const ratio = window.devicePixelRatio || 1, [width, height] = sizeOf(shown);
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = `12px ${font}`;
  return { context, width, height };
}
