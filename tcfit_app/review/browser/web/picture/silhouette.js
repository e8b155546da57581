// What the person covers of the picture, as the detector has it: a light tint, and an outline.

/** @import { PosterMap } from "./projection.js" */

import { invalidate, states, watch } from "../connection.js";
import { COLORS } from "../style.js";
import { toScreen } from "./projection.js";
import { stroke } from "./shapes.js";

const TINT = 0.18; // opacity
const WIDTH = 1.6; // CSS pixels

/** @param {CanvasRenderingContext2D} context @param {PosterMap} map */
export function drawSilhouette(context, map) {
  if (!states.silhouette) return;
  const outline = new Path2D();
  for (const line of states.silhouette.lines) {
    line.forEach((pixel, i) => (i ? outline.lineTo(...toScreen(map, pixel)) : outline.moveTo(...toScreen(map, pixel))));
    outline.closePath();
  }
  context.globalAlpha = TINT;
  context.fillStyle = COLORS.silhouette;
  context.fill(outline, "evenodd"); // holes stay free
  context.globalAlpha = 1;
  stroke(context, outline, "rgba(8, 10, 14, 0.5)", WIDTH + 1.4);
  stroke(context, outline, COLORS.silhouette, WIDTH);
}

watch("silhouette", () => invalidate("overlay"));
