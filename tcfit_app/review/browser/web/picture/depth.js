// A keypoint of a fit is dragged in the side view or in 3D: along its line of sight, so the picture looks the same.

/** @import { DragDepth } from "../wire" */
/** @import { Found, Gesture } from "./picking.js" */

import { emitLast, emitSoon, invalidate, known, states } from "../connection.js";
import { wayInDepth } from "./fits.js";
import { drawn } from "./projection.js";
import { chosen } from "./skeleton.js";

const DEEPEST = 10; // metres: what the server takes

/** The way of a keypoint that can be dragged, on the screen for each metre: of the body that is corrected, seen from
 * aside. @param {Found} found */
export const wayOf = ({ joint, body, poster }) =>
  body === (states.bodies?.bodies.length ?? 0) - 1 ? wayInDepth(drawn.maps[poster], joint, body) : null;

/** @param {Gesture} gesture */
export function beginDepthDrag(gesture) {
  const { found, x0, y0 } = gesture;
  const way = found && wayOf(found);
  if (!way) return;
  gesture.kind = "depth";
  chosen.inDepth = { joint: found.joint, from: [x0, y0], way, metres: 0, frame: known("keypoints").frame };
  emitLast(depthEvent("start"));
}

/** @param {Gesture} gesture */
export function followInDepth({ x, y }) {
  const held = chosen.inDepth;
  if (!held) return;
  const [[u, v], [du, dv]] = [held.from, held.way];
  const along = ((x - u) * du + (y - v) * dv) / (du * du + dv * dv);
  held.metres = Math.min(Math.max(along, -DEEPEST), DEEPEST);
  emitSoon(depthEvent("move"));
}

/** @param {"end" | "cancel"} phase */
export function endDepthDrag(phase) {
  if (chosen.inDepth) emitLast(depthEvent(phase));
  chosen.inDepth = null;
  invalidate("overlay");
}

/** @param {DragDepth["phase"]} phase @returns {DragDepth} */
function depthEvent(phase) {
  const { joint = 0, metres = 0, frame = 0 } = chosen.inDepth ?? {};
  return { type: "drag_depth", phase, joint, metres, frame };
}
