// The onion skin: the fits' bones in the frames around the one on show.

/** @import { FitBody } from "../wire" */
/** @import { Project } from "./fits.js" */
/** @import { PosterMap } from "./projection.js" */
/** @typedef {CanvasRenderingContext2D} Context */

import { states } from "../connection.js";
import { bonePath } from "./fits.js";
import { toScreen } from "./projection.js";
import { stroke } from "./shapes.js";
import { zoomFactor } from "./skeleton.js";

const STRENGTH = 0.9; // of a frame beside the one on show; of the next one half of it

/** On a picture, those of its own fit. @param {Context} context @param {PosterMap} map */
export function drawOnion(context, map) {
  for (const body of states.bodies?.bodies ?? []) {
    if (body.color !== map.poster.color) continue;
    const [fx, fy, cx, cy] = body.camera;
    drawNeighbours(context, map, body, ([x, y, z]) =>
      z > 0.01 ? toScreen(map, [(fx * x) / z + cx, (fy * y) / z + cy]) : null);
  }
}

/** Those that are seen in the frame on show. @param {Context} context @param {PosterMap} map @param {FitBody} body
 * @param {Project} project */
export function drawNeighbours(context, map, { color, neighbours, unseen }, project) {
  const width = 1.6 * zoomFactor(map);
  for (const { offset, points } of neighbours) {
    const lines = bonePath(points, project, (...bone) => !bone.some((joint) => unseen.includes(joint)));
    context.globalAlpha = STRENGTH / Math.abs(offset);
    context.setLineDash(offset > 0 ? [4, 3] : []);
    stroke(context, lines, "rgba(8, 10, 14, 0.5)", width + 1.2);
    stroke(context, lines, color, width);
  }
  context.setLineDash([]);
  context.globalAlpha = 1;
}
