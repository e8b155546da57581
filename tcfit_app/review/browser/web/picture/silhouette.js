// What the person covers of the picture, as the detector has it: a dashed outline.

/** @import { PosterMap } from "./projection.js" */

import { invalidate, states, watch } from "../connection.js";
import { COLORS } from "../theme.js";
import { toScreen } from "./projection.js";
import { stroke } from "./shapes.js";

const WIDTH = 1.6; // CSS pixels

/** @param {CanvasRenderingContext2D} context @param {PosterMap} map */
export function drawSilhouette(context, map) {
  if (!states.silhouette) return;
  const outline = new Path2D();
  for (const line of states.silhouette.lines) {
    line.forEach((pixel, i) => (i ? outline.lineTo(...toScreen(map, pixel)) : outline.moveTo(...toScreen(map, pixel))));
    outline.closePath();
  }
  stroke(context, outline, "rgba(8, 10, 14, 0.5)", WIDTH + 1.4);
  context.setLineDash([6, 4]);
  stroke(context, outline, COLORS.strong, WIDTH);
  context.setLineDash([]);
}

watch("silhouette", () => invalidate("overlay"));
