// The paths of selected keypoints around the frame on show: as they were detected, and as the fit has them.

/** @import { Trail } from "../wire" */
/** @import { PosterMap } from "./projection.js" */
/** @typedef {CanvasRenderingContext2D} Context */

import { invalidate, states, watch } from "../connection.js";
import { drawn, toScreen } from "./projection.js";
import { circle, stroke } from "./shapes.js";

const DETECTED = "#ffe14d";
const LATER = 0.45; // how strong frames after the one on show are drawn

/** @param {Context} context @param {PosterMap} map */
export function drawTrail(context, map) {
  const { trail } = states;
  const picture = drawn.maps.indexOf(map);
  if (!trail) return;
  trail.detected.forEach((path) => drawPath(context, map, path, trail, DETECTED, true));
  for (const path of trail.fitted[picture] ?? []) drawPath(context, map, path, trail, trail.colors[picture], false);
}

/** @param {Context} context @param {PosterMap} map @param {Trail["detected"][number]} path @param {Trail} trail
 * @param {string} color @param {boolean} dashed */
function drawPath(context, map, path, { now }, color, dashed) {
  context.save();
  if (dashed) context.setLineDash([4, 3]);
  for (let i = 1; i < path.length; i++) {
    const [from, to] = [path[i - 1], path[i]];
    if (!from || !to) continue;
    const line = new Path2D();
    line.moveTo(...toScreen(map, from));
    line.lineTo(...toScreen(map, to));
    context.globalAlpha = i > now ? LATER : 1;
    stroke(context, line, "rgba(8, 10, 14, 0.75)", 4);
    stroke(context, line, color, 2);
  }
  context.setLineDash([]);
  for (const [i, pixel] of path.entries()) {
    if (!pixel || i === now) continue;
    context.globalAlpha = i > now ? LATER : 1;
    context.fillStyle = color;
    context.fill(circle(...toScreen(map, pixel), 2.5));
  }
  context.restore();
}

watch("trail", () => invalidate("overlay"));
