// Small shapes. Discs, of which there are hundreds a frame, are drawn once and stamped.

/** @typedef {CanvasRenderingContext2D} Context */

export const NOT_SURE = 0.5; // opacity of what is not seen, relative to what is

/** @param {Context} context @param {Path2D} path @param {string} color @param {number} width
 * @param {{ alpha?: number, dash?: number[] }} [style] its opacity, and the lengths of dashes and gaps */
export function stroke(context, path, color, width, { alpha = 1, dash = [] } = {}) {
  context.strokeStyle = color;
  context.lineWidth = width;
  context.globalAlpha = alpha;
  context.setLineDash(dash);
  context.stroke(path);
  context.globalAlpha = 1;
  context.setLineDash([]);
}

/** Draws nothing outside a box. @param {Context} context
 * @param {{ left: number, top: number, right: number, bottom: number }} box @param {() => void} draw */
export function clipTo(context, { left, top, right, bottom }, draw) {
  context.save();
  context.beginPath();
  context.rect(left, top, right - left, bottom - top);
  context.clip();
  draw();
  context.restore();
}

/** @param {number} x @param {number} y @param {number} radius */
export function circle(x, y, radius) {
  const path = new Path2D();
  path.arc(x, y, radius, 0, 2 * Math.PI);
  return path;
}

/** @param {number} x @param {number} y @param {number} arm */
export function cross(x, y, arm) {
  const path = new Path2D();
  for (const side of [-1, 1]) {
    path.moveTo(x - arm, y - side * arm);
    path.lineTo(x + arm, y + side * arm);
  }
  return path;
}

/** @param {Context} context @param {number} x @param {number} y @param {number} radius @param {string} color
 * @param {number} width */
export function ring(context, x, y, radius, color, width) {
  stroke(context, circle(x, y, radius), "rgba(8, 10, 14, 0.7)", width + 1.6);
  stroke(context, circle(x, y, radius), color, width);
}

/** @typedef {{ picture: HTMLCanvasElement, size: number }} Stamp of that size in CSS pixels */
/** @type {Map<string, Stamp>} */
const stamps = new Map(); // by what they show

/** A picture of half that size, as fine as the screen, drawn when it is first needed.
 * @param {string} name @param {number} half @param {(context: Context) => void} draw @returns {Stamp} */
function made(name, half, draw) {
  const ratio = window.devicePixelRatio || 1;
  const key = `${name} ${ratio}`;
  const known = stamps.get(key);
  if (known) return known;
  if (stamps.size > 500) stamps.clear();
  const picture = document.createElement("canvas");
  picture.width = picture.height = Math.ceil(2 * half * ratio);
  const context = /** @type {Context} */ (picture.getContext("2d"));
  context.setTransform(ratio, 0, 0, ratio, picture.width / 2, picture.height / 2);
  draw(context);
  const stamp = { picture, size: picture.width / ratio };
  stamps.set(key, stamp);
  return stamp;
}

/** @param {Context} context @param {Stamp} stamp @param {number} x @param {number} y */
export const stamp = (context, { picture, size }, x, y) =>
  context.drawImage(picture, x - size / 2, y - size / 2, size, size);

/** @param {number} radius */
const rounded = (radius) => Math.round(4 * radius) / 4;

/** A dark rim in a light one is seen on any picture. @param {number} radius */
export const rim = (radius) =>
  made(`rim ${rounded(radius)}`, radius + 3, (context) => {
    const edge = circle(0, 0, rounded(radius));
    stroke(context, edge, "rgba(255, 255, 255, 0.75)", Math.min(0.9 + 0.4 * radius, 2.6));
    stroke(context, edge, "rgba(8, 10, 14, 0.9)", Math.min(0.5 + 0.2 * radius, 1.3));
  });

/** @param {string} color @param {number} radius */
export const disc = (color, radius) =>
  made(`${color} ${rounded(radius)}`, radius + 2, (context) => {
    context.fillStyle = color;
    context.fill(circle(0, 0, rounded(radius)));
  });
