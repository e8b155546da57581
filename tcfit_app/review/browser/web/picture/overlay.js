// Draws keypoints and bones over each picture, in step with viser's own drawing; over the side view see side.js.

/** @import { PosterMap } from "./projection.js" */
/** @import { Gesture } from "./picking.js" */
/** @import { Keypoints } from "../wire" */
/** @typedef {CanvasRenderingContext2D} Context */

import { addPainter, invalidate, known, paint, states, watch } from "../connection.js";
import { cleared, overlayCanvas, placeTooltip, shortenedName, tooltip } from "../elements.js";
import { FONT } from "../style.js";
import { COLORS, tones } from "../theme.js";
import { beforeSceneDrawn, canvas, canvasSize, onSceneDrawn, redrawScene } from "../viser/bridge.js";
import { drawInWindow } from "../viser/meshes.js";
import { placeDivider } from "./divider.js";
import { REACH, inPicture, pick, pictureAt, pointer, within } from "./picking.js";
import { drawPeople, placePeople } from "./people.js";
import { drawn, placeInWorld, plateSeen, posterMaps, toScreen, viewChanged } from "./projection.js";
import { circle, clipTo, cross, disc, rim, ring, stamp, stroke } from "./shapes.js";
import { wayOf } from "./depth.js";
import { fitLine } from "./fits.js";
import { drawFits, drawSide } from "./side.js";
import {
  chosen, groupColor, groupOf, groupShown, isFilmed, isPicture, isSide, isSpace, jointRadius, marked, placesOf,
  pointsOf, position, shown, shownJoints, skeletonReady, zoomFactor,
} from "./skeleton.js";

const GAP = 0.01; // image diagonals beyond which a correction counts as not reached
const FADED = 0.7; // share of the ground over what lies outside the picture
const FINE_BONES = 1.3; // CSS pixels: too fine for a rim
const OUTLINE = 1.6; // CSS pixels, of a silhouette
const NAME_HEIGHT = 34; // of a fit's name with the room around it, in CSS pixels
const NAME_ROOM = 260; // CSS pixels for a fit's name, also beyond a narrow picture

function drawOverlay() {
  const context = cleared(overlayCanvas);
  drawn.maps = posterMaps();
  placeDivider(drawn.maps, Boolean(states.layout?.wipe));
  placePeople(drawn.maps);
  tooltip.hidden = true;
  for (const map of drawn.maps) if (isPicture(map) && !map.poster.clipped) fadeOutside(context, map);
  if (skeletonReady()) drawSkeleton(context);
  drawFitNames(context);
  showPointerShape();
}

/** Fades what bodies cover outside the picture. @param {Context} context @param {PosterMap} map */
function fadeOutside(context, map) {
  const area = new Path2D();
  for (const { left, top, right, bottom } of [map.seen, plateSeen(map)])
    area.rect(left, top, Math.max(right - left, 0), Math.max(bottom - top, 0));
  context.globalAlpha = FADED;
  context.fillStyle = tones.stage;
  context.fill(area, "evenodd");
  context.globalAlpha = 1;
}

/** @param {Context} context */
function drawSkeleton(context) {
  if (!pointer.gesture) pointer.hovered = pick(pointer.place, REACH);
  for (const map of drawn.maps) clipTo(context, map.seen, () => drawOnPoster(context, map));
  drawHovered(context);
  if (pointer.gesture?.kind === "marquee") drawMarquee(context, pointer.gesture);
  if (pointer.gesture?.kind === "framing") drawFrame(context, pointer.gesture);
}

/** @param {Context} context @param {PosterMap} map */
function drawOnPoster(context, map) {
  if (isSide(map)) return drawSide(context, map);
  if (isSpace(map)) return drawFits(context, map);
  if (!isFilmed(map)) return;
  if (isPicture(map)) {
    drawStraightLines(context, map);
    drawSilhouette(context, map);
    drawGaps(context, map);
    drawPeople(context, map);
  }
  if (known("style").points) drawBones(context, map);
  for (const joint of shownJoints(map).reverse()) drawJoint(context, map, joint); // the body's last, on top
}

/** What the person covers of the picture, as the detector has it: a dashed outline.
 * @param {Context} context @param {PosterMap} map */
function drawSilhouette(context, map) {
  if (!states.silhouette) return;
  const outline = new Path2D();
  for (const line of states.silhouette.lines) {
    line.forEach((pixel, i) => (i ? outline.lineTo(...toScreen(map, pixel)) : outline.moveTo(...toScreen(map, pixel))));
    outline.closePath();
  }
  stroke(context, outline, "rgba(8, 10, 14, 0.5)", OUTLINE + 1.4);
  stroke(context, outline, COLORS.strong, OUTLINE, { dash: [6, 4] });
}

/** The straight edges that the camera is estimated from; those that do not count are thin.
 * @param {Context} context @param {PosterMap} map */
function drawStraightLines(context, map) {
  if (!states.straight_lines) return;
  const [along, other] = [states.straight_lines.along, states.straight_lines.other].map((segments) => {
    const path = new Path2D();
    for (const [x0, y0, x1, y1] of segments) {
      path.moveTo(...toScreen(map, [x0, y0]));
      path.lineTo(...toScreen(map, [x1, y1]));
    }
    return path;
  });
  stroke(context, along, "rgba(8, 10, 14, 0.5)", OUTLINE + 1.4);
  stroke(context, along, COLORS.strong, OUTLINE);
  stroke(context, other, COLORS.strong, 0.5 * OUTLINE);
}

/** @param {Context} context @param {PosterMap} map */
function drawBones(context, map) {
  const { groups, bones } = known("skeleton");
  const points = pointsOf(map);
  /** @param {number} joint */
  const sure = (joint) => points.confidence[joint] > 0 && !marked("bad", joint, points);
  const lines = groups.map(() => new Path2D());
  for (const [a, b] of bones) {
    if (![a, b].every((joint) => sure(joint) && groupShown(joint))) continue;
    lines[groupOf[a]].moveTo(...toScreen(map, position(a, points)));
    lines[groupOf[a]].lineTo(...toScreen(map, position(b, points)));
  }
  context.lineCap = "butt"; // points cover the ends
  groups.forEach(({ radius }, i) => {
    const width = (0.7 + 0.26 * radius) * zoomFactor(map);
    if (width > FINE_BONES) stroke(context, lines[i], "rgba(8, 10, 14, 0.5)", width + 1.6);
    stroke(context, lines[i], groupColor(i), width, { alpha: 0.85 });
  });
}

/** @param {Context} context @param {PosterMap} map @param {number} joint */
function drawJoint(context, map, joint) {
  const points = pointsOf(map);
  const [x, y] = toScreen(map, position(joint, points));
  const radius = jointRadius(joint, map);
  if (marked("bad", joint, points)) drawBad(context, x, y, radius);
  else drawDisc(context, x, y, radius, joint, points);
  const around = 1.6 * radius + 3.5; // beyond all rings
  if (marked("pinned", joint, points)) drawPin(context, x, y, around);
  if (marked("locked", joint, points)) drawLock(context, x, y, 1.2 * around);
  if (marked("deep", joint, points)) drawDepth(context, x, y, around);
  if (marked("edited", joint, points)) ring(context, x, y, 1.25 * radius + 2, COLORS.strong, 1.6);
  if (chosen.joints.has(joint)) ring(context, x, y, 1.5 * radius + 1.8, COLORS.selected, Math.min(1 + radius / 5, 2.2));
}

/** @param {Context} context @param {number} x @param {number} y @param {number} radius @param {number} joint
 * @param {Keypoints} points */
function drawDisc(context, x, y, radius, joint, points) {
  const color = groupColor(groupOf[joint]);
  const confidence = points.confidence[joint];
  if (marked("ignored", joint, points)) return ring(context, x, y, radius, color, 1);
  stamp(context, rim(radius), x, y);
  if (confidence === 0) return;
  context.globalAlpha = 0.35 + 0.65 * Math.min(confidence, 1);
  stamp(context, disc(color, radius), x, y);
  context.globalAlpha = 1;
}

/** @param {Context} context @param {number} x @param {number} y @param {number} radius */
function drawBad(context, x, y, radius) {
  const mark = cross(x, y, radius * 0.8 + 1);
  context.lineCap = "round";
  stroke(context, mark, "rgba(8, 10, 14, 0.85)", 4);
  stroke(context, mark, COLORS.bad, 2);
}

/** A square around all rings. @param {Context} context @param {number} x @param {number} y @param {number} half */
function drawPin(context, x, y, half) {
  const square = new Path2D();
  square.rect(x - half, y - half, 2 * half, 2 * half);
  drawMark(context, square);
}

/** A square on its corner. @param {Context} context @param {number} x @param {number} y @param {number} half */
function drawLock(context, x, y, half) {
  const diamond = new Path2D(`M${x - half} ${y}L${x} ${y - half}L${x + half} ${y}L${x} ${y + half}Z`);
  drawMark(context, diamond);
}

/** An arrowhead to either side. @param {Context} context @param {number} x @param {number} y @param {number} half */
function drawDepth(context, x, y, half) {
  const [left, right] = [x - half - 1, x + half + 1];
  drawMark(context, new Path2D(`M${left} ${y - 5}l-6 5l6 5M${right} ${y - 5}l6 5l-6 5`));
}

/** Attributes of a keypoint other than its position. @param {Context} context @param {Path2D} path */
function drawMark(context, path) {
  stroke(context, path, "rgba(8, 10, 14, 0.7)", 3.6);
  stroke(context, path, COLORS.strong, 2);
}

/** From corrected keypoints to where the body has them, if it cannot reach them.
 * @param {Context} context @param {PosterMap} map */
function drawGaps(context, map) {
  const body = states.bodies?.bodies.find(({ color }) => color === map.poster.color);
  const { image } = known("layout");
  if (!body || !image) return;
  const [fx, fy, cx, cy] = body.camera;
  const gaps = new Path2D();
  body.points.forEach((point, joint) => {
    const corrected = marked("edited", joint) || (!chosen.held?.view && chosen.held?.joints.has(joint));
    if (!point || point[2] <= 0 || !corrected || marked("bad", joint) || !shown(joint)) return;
    /** @type {[number, number]} */
    const reached = [(fx * point[0]) / point[2] + cx, (fy * point[1]) / point[2] + cy];
    const [x, y] = position(joint);
    if (Math.hypot(reached[0] - x, reached[1] - y) < GAP * Math.hypot(...image)) return;
    gaps.moveTo(...toScreen(map, [x, y]));
    gaps.lineTo(...toScreen(map, reached));
    const [u, v] = toScreen(map, reached);
    gaps.addPath(circle(u, v, 4));
  });
  stroke(context, gaps, "rgba(8, 10, 14, 0.75)", 4, { dash: [5, 4] });
  stroke(context, gaps, COLORS.bad, 2, { dash: [5, 4] });
}

/** @param {Context} context */
function drawHovered(context) {
  const { hovered } = pointer;
  if (!hovered) return;
  const { joint, poster, body } = hovered;
  if (inPicture(hovered) && !shown(joint, pointsOf(drawn.maps[poster]))) return;
  for (const map of drawn.maps)
    clipTo(context, map.seen, () => {
      for (const { x, y } of !isFilmed(map) || shown(joint, pointsOf(map)) ? placesOf(map, [joint]) : [])
        ring(context, x, y, jointRadius(joint, map) + 1.5, COLORS.accent, 1.8);
    });
  const place = drawn.maps[poster] && placesOf(drawn.maps[poster], [joint]).find((placed) => placed.body === body);
  if (!place) return;
  tooltip.textContent = inPicture(hovered) ? jointLine(joint, pointsOf(drawn.maps[poster])) : fitLine(joint, body);
  placeTooltip(tooltip, place.x, place.y, false);
}

/** "right wrist  0.83  edited" @param {number} joint @param {Keypoints} points */
function jointLine(joint, points) {
  const confidence = points.confidence[joint];
  const parts = [known("skeleton").names[joint], confidence > 0 ? confidence.toFixed(2) : "missing"];
  if (marked("bad", joint, points)) parts.push("bad");
  if (marked("pinned", joint, points)) parts.push("pinned");
  else if (marked("edited", joint, points)) parts.push("edited");
  if (marked("locked", joint, points)) parts.push("rotation locked");
  if (marked("deep", joint, points)) parts.push("depth set");
  if (marked("ignored", joint, points)) parts.push("does not count: the hand has a given shape");
  return parts.join("  ");
}

/** A rectangle around something, and what that is. @param {Context} context @param {Gesture} gesture */
function drawFrame(context, gesture) {
  drawBox(context, gesture);
  context.font = `600 13px ${FONT}`;
  context.textBaseline = "bottom";
  context.fillStyle = COLORS.selected;
  const { x0, y0, x, y } = gesture;
  context.fillText(states.framing?.around ?? "", Math.min(x0, x), Math.min(y0, y) - 4);
}

/** @param {Context} context @param {Gesture} gesture */
function drawBox(context, { x0, y0, x, y }) {
  context.fillStyle = "rgba(255, 225, 77, 0.12)";
  context.strokeStyle = COLORS.selected;
  context.lineWidth = 1;
  context.fillRect(x0, y0, x - x0, y - y0);
  context.strokeRect(x0, y0, x - x0, y - y0);
}

/** @param {Context} context @param {Gesture} gesture */
function drawMarquee(context, gesture) {
  drawBox(context, gesture);
  for (const joint of within(gesture))
    for (const map of drawn.maps)
      clipTo(context, map.seen, () => {
        for (const place of placesOf(map, [joint]))
          ring(context, place.x, place.y, 1.5 * jointRadius(joint, map) + 1.8, COLORS.selected, 1.2);
      });
}

/** @type {{ [kind: string]: string }} */
const GESTURE_SHAPES = {
  drag: "grabbing", depth: "grabbing", marquee: "crosshair", framing: "crosshair",
};
let pointerShape = "";

/** Sets the pointer's shape, and leaves it alone while it is viser's to set. */
function showPointerShape() {
  const { hovered, place } = pointer;
  const met = !hovered ? "" : inPicture(hovered) || wayOf(hovered) ? "grab" : "pointer";
  const usual = states.framing && pictureAt(place) ? "crosshair" : met;
  const shape = skeletonReady() ? (GESTURE_SHAPES[pointer.gesture?.kind ?? ""] ?? usual) : "";
  if (shape !== pointerShape) canvas().style.cursor = shape;
  pointerShape = shape;
}

/** In their upper right corners: viser's messages come up at the upper left.
 * @param {Context} context */
function drawFitNames(context) {
  context.font = `600 13px ${FONT}`;
  context.textBaseline = "middle";
  const across = canvasSize().width;
  const layout = states.layout;
  if (layout?.mode === "space")
    layout.posters.forEach((poster, i) => drawFitName(context, poster, across, 28 * i, across));
  for (const map of layout?.mode === "poster" ? drawn.maps : []) {
    const { seen, ox, oy, width, poster } = map;
    const end = ox + width;
    const right = Math.min(seen.right, Math.max(end, seen.left + NAME_ROOM));
    const beside = { end, free: width < NAME_ROOM ? seen.right - end : 0 };
    const top = isSide(map) ? seen.top : Math.max(seen.top, oy - NAME_HEIGHT); // above the picture, if there is room
    drawFitName(context, poster, right, top, isSide(map) ? NAME_ROOM : right - seen.left, beside);
  }
}

/** A colour and a name, with its upper right corner near (right, top), at most as wide as `across`; or right of a small
 * picture's end, as it would cover much of it, if there is room.
 * @param {Context} context @param {PosterMap["poster"]} poster @param {number} right @param {number} top
 * @param {number} across @param {{ end: number, free: number }} [beside] */
function drawFitName(context, { label, color }, right, top, across, beside = { end: 0, free: 0 }) {
  const dot = color ? 14 : 0;
  const text = shortenedName(context, label, across - 32 - 2 * dot);
  if (!text) return;
  const width = context.measureText(text).width + 18 + dot;
  const [x, y] = [beside.free < width + 16 ? right - width - 8 : beside.end + 8, top + 8];
  context.fillStyle = tones.surface;
  context.beginPath();
  context.roundRect(x, y, width, 24, 6);
  context.fill();
  if (color) {
    context.fillStyle = tones[color];
    context.fill(circle(x + 13, y + 12, 4.5));
  }
  context.fillStyle = tones.text;
  context.fillText(text, x + 9 + dot, y + 12.5);
}

addPainter("overlay", drawOverlay);
for (const name of /** @type {const} */ (["framing", "silhouette", "straight_lines"]))
  watch(name, () => invalidate("overlay"));

// viser draws its scene only now and then; right after it, the overlay follows a camera that has moved.
beforeSceneDrawn(() => {
  if (states.layout?.mode === "space") return;
  for (const map of posterMaps())
    drawInWindow(map.poster.node, placeInWorld(map), map.poster.clipped ? plateSeen(map) : map.seen);
});
onSceneDrawn(() => {
  if (viewChanged()) paint("overlay");
});
for (const name of /** @type {const} */ (["layout", "focus"]))
  watch(name, () => {
    invalidate("overlay");
    redrawScene(); // posters have other places
  });
