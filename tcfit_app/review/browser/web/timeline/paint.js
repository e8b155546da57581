// How text, boxes and lines come onto the strip's canvases.

/** @typedef {CanvasRenderingContext2D} Context */
/** @import { Band } from "./layout.js" */

import { clipTo } from "../picture/shapes.js";
import { FONT } from "../style.js";
import { GUTTER, edgeX, plotWidth } from "./axis.js";

export const NAMES = 8; // where the names of lanes and rows begin
const LEAST_WIDTH = 2; // of a mark: a single frame of ten thousand must be seen

/** Nothing is drawn beside the plot. @param {Context} context @param {Band} band @param {() => void} draw */
export const clipToPlot = (context, band, draw) =>
  clipTo(context, { ...band, left: GUTTER, right: GUTTER + plotWidth() }, draw);

/** @param {Context} context @param {string} text @param {number} x @param {number} y its middle @param {string} color
 * @param {CanvasTextAlign} [align] */
export function write(context, text, x, y, color, align = "left") {
  context.font = `13px ${FONT}`;
  context.textAlign = align;
  context.textBaseline = "middle";
  context.fillStyle = color;
  context.fillText(text, x, y);
}

/** @param {Context} context @param {string} color @param {number} x @param {number} y @param {number} width
 * @param {number} height */
export function fillBox(context, color, x, y, width, height) {
  context.fillStyle = color;
  context.fillRect(x, y, width, height);
}

/** Frames as a box. @param {Context} context @param {string} color @param {number} first @param {number} last
 * @param {number} y @param {number} height */
export function fillFrames(context, color, first, last, y, height) {
  const [left, right] = [edgeX(first), edgeX(last + 1)];
  fillBox(context, color, left, y, Math.max(right - left - (right - left > 6 ? 1 : 0), LEAST_WIDTH), height);
}
