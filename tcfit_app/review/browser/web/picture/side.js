// Draws over the side view: the floor, the fits' keypoints, and the lines of sight of selected ones.

/** @import { FitBody, SidePlate } from "../wire" */
/** @import { PosterMap } from "./projection.js" */
/** @typedef {CanvasRenderingContext2D} Context */

import { known, states } from "../connection.js";
import { FONT } from "../style.js";
import { COLORS, tones } from "../theme.js";
import { bonePath, ellipse, projections } from "./fits.js";
import { plateSeen, toScreen } from "./projection.js";
import { NOT_SURE, clipTo, disc, rim, ring, stamp, stroke } from "./shapes.js";
import { chosen, groupShown, jointRadius, located, placedOn, position, zoomFactor } from "./skeleton.js";

const TICKS = [0.5, 0.1, 0.02]; // metres apart: the first that suits the plate
const FAR = 200; // metres from the camera: the end of a line of sight, beyond any plate
const BODY = 25; // keypoints; those of hands and face come after them
const NARROW = 260; // CSS pixels of a plate, below which a scale would lie on the body
const FEW = 4; // selected keypoints of which every line of sight is drawn

/** @param {Context} context @param {PosterMap} map */
export function drawSide(context, map) {
  const { side } = states;
  if (!side) return;
  clipTo(context, plateSeen(map), () => {
    drawRuler(context, map, side);
    drawSights(context, map, side);
    drawFits(context, map);
  });
}

/** The fits' keypoints and bones. @param {Context} context @param {PosterMap} map of the side view or of 3D */
export function drawFits(context, map) {
  const bodies = states.bodies?.bodies ?? [];
  drawErrorBars(context, map, bodies);
  if (known("style").points && groupShown(0)) drawBones(context, map, bodies);
  // The body that is corrected on top, and on each body the joints in the order of the picture.
  for (const { joint, x, y, body } of placedOn(map).sort((a, b) => a.body - b.body || b.joint - a.joint)) {
    const radius = 0.8 * jointRadius(joint, map);
    context.globalAlpha = bodies[body].unseen.includes(joint) ? NOT_SURE : 1;
    stamp(context, rim(radius), x, y);
    stamp(context, disc(COLORS[bodies[body].color], radius), x, y);
    context.globalAlpha = 1;
    if (chosen.joints.has(joint)) ring(context, x, y, 1.5 * radius + 1.8, COLORS.selected, 2);
  }
  drawInDepth(context, map);
}

/** Where the pointer has a keypoint, while the fit follows. @param {Context} context @param {PosterMap} map */
function drawInDepth(context, map) {
  const held = chosen.inDepth;
  if (!held) return;
  const [x, y] = held.from.map((pixel, i) => pixel + held.metres * held.way[i]);
  ring(context, x, y, 8 * zoomFactor(map), COLORS.selected, 2);
}

/** The floor with ticks, or, where that is not on the plate, the length between two of them.
 * @param {Context} context @param {PosterMap} map @param {SidePlate} side */
function drawRuler(context, map, side) {
  const { left, right, bottom } = plateSeen(map);
  const metre = side.metre * map.pixel; // in CSS pixels
  const tick = TICKS.find((length) => length * metre < 0.6 * (right - left)) ?? 0;
  const step = tick * metre;
  if (step < 8) return;
  const floor = side.floor === null ? Infinity : map.oy + side.floor * map.pixel;
  const standing = floor < bottom;
  const y = standing ? floor : bottom - 24;
  const zero = map.ox + side.zero * map.pixel;
  const last = standing ? zero + Math.floor((right - 8 - zero) / step) * step : right - 8;
  const first = standing ? left : last - step;
  const lines = new Path2D();
  lines.moveTo(first, y);
  lines.lineTo(standing ? right : last, y);
  const wide = right - left >= NARROW;
  for (let x = last; wide && x > first - 1; x -= step) {
    lines.moveTo(x, y);
    lines.lineTo(x, y + 5);
  }
  if (standing || wide) stroke(context, lines, tones.thumb, 1);
  if (step > 36 && wide) write(context, `${tick} m`, last - step / 2, y + (y + 18 < bottom ? 10 : -10), "center");
}

/** Small text, legible over a body. @param {Context} context @param {string} text @param {number} x
 * @param {number} y @param {CanvasTextAlign} align */
function write(context, text, x, y, align) {
  context.font = `13px ${FONT}`;
  context.textBaseline = "middle";
  context.textAlign = align;
  context.lineJoin = "round";
  context.lineWidth = 3.5;
  context.strokeStyle = tones.stage;
  context.strokeText(text, x, y);
  context.fillStyle = tones.dim;
  context.fillText(text, x, y);
  context.textAlign = "start";
}

/** How far off joints may be, as the outline of an ellipsoid that is longest along the camera's ray.
 * @param {Context} context @param {PosterMap} map @param {readonly FitBody[]} bodies */
function drawErrorBars(context, map, bodies) {
  for (const [i, project] of projections(map).entries()) {
    const { points, error_bars } = bodies[i] ?? { points: [], error_bars: [] };
    error_bars.forEach((bars, joint) => {
      const point = points[joint];
      const outline = bars && point && ellipse(project, point, bars);
      if (!outline) return;
      context.fillStyle = "rgba(255, 255, 255, 0.2)"; // on a body of the fit's own colour
      context.fill(outline);
      stroke(context, outline, "rgba(8, 10, 14, 0.5)", 2.2);
      stroke(context, outline, "rgba(255, 255, 255, 0.8)", 1);
    });
  }
}

/** @param {Context} context @param {PosterMap} map @param {readonly FitBody[]} bodies */
function drawBones(context, map, bodies) {
  const width = 2 * zoomFactor(map);
  for (const [i, project] of projections(map).entries()) {
    if (!bodies[i]) continue;
    const { points, unseen } = bodies[i];
    const color = COLORS[bodies[i].color];
    /** @param {number} a @param {number} b */
    const hidden = (a, b) => unseen.includes(a) || unseen.includes(b);
    const seen = bonePath(points, project, (a, b) => !hidden(a, b));
    const notSeen = bonePath(points, project, hidden);
    stroke(context, seen, "rgba(8, 10, 14, 0.5)", width + 1.6);
    stroke(context, seen, color, width);
    stroke(context, notSeen, color, width, { alpha: NOT_SURE, dash: [2 * width, 2 * width] });
  }
}

/** On the plate, for each metre away from the camera: the way of a picture's pixel.
 * @param {SidePlate} side @param {number[]} pixel */
const wayOf = ({ sight }, [u, v]) => sight.map(([a, b, c]) => a * u + b * v + c);

/** Where the camera that filmed stands. @param {SidePlate} side */
const cameraOf = ({ shifts }) => shifts[shifts.length - 1];

/** @param {Context} context @param {PosterMap} map @param {SidePlate} side */
function drawSights(context, map, side) {
  const lines = new Path2D();
  for (const joint of chosen.joints) {
    if (!groupShown(joint) || !located(joint)) continue;
    if (joint >= BODY && chosen.joints.size > FEW) continue; // a hand's would hide the arm's
    const [du, dv] = wayOf(side, position(joint));
    const [u, v] = cameraOf(side);
    lines.moveTo(...toScreen(map, [u, v]));
    lines.lineTo(...toScreen(map, [u + FAR * du, v + FAR * dv]));
  }
  stroke(context, lines, tones.selected, 1.2, { alpha: 0.8, dash: [5, 4] });
}
