// Draws keypoints and bones over each poster, in step with viser's own drawing.

/** @import { Poster } from "../wire" */
/** @import { PosterMap } from "./projection.js" */
/** @import { Gesture } from "./picking.js" */
/** @typedef {CanvasRenderingContext2D} Context */

import { addPainter, known, paint, states } from "../connection.js";
import { cleared, overlayCanvas, placeTooltip, shortenedName, tooltip } from "../elements.js";
import { COLORS, FONT } from "../style.js";
import { canvas, canvasSize, onSceneDrawn } from "../viser/bridge.js";
import { REACH, pick, pointer, within } from "./picking.js";
import { drawn, posterMaps, toScreen, viewChanged } from "./projection.js";
import { circle, cross, disc, rim, ring, stamp, stroke } from "./shapes.js";
import {
  badJoints, chosen, editedJoints, groupOf, groupShown, located, position, shown, shownJoints, skeletonReady,
} from "./skeleton.js";

const CONFIDENCE_COLORS = [
  [224, 58, 50],
  [242, 197, 61],
  [62, 190, 90],
];

const FINE_BONES = 1.3; // CSS pixels: too fine for a rim
const PLAIN_BONES = "#c3cad4";

/** Red over yellow to green, in twenty steps. @param {number} confidence */
function confidenceColor(confidence) {
  const place = Math.round(Math.min(Math.max(confidence, 0), 1) * 20) / 10;
  const from = Math.min(Math.floor(place), 1);
  const mixed = CONFIDENCE_COLORS[from].map((c, i) => c + (CONFIDENCE_COLORS[from + 1][i] - c) * (place - from));
  return `rgb(${mixed.map(Math.round).join(", ")})`;
}

const USUAL_HEIGHT = 700; // CSS pixels of a poster that fills a window

/** Points keep their size on the screen, but for a little growth when zoomed in. @param {PosterMap} map */
const zoomFactor = (map) => Math.min(Math.max(0.5 + (0.5 * map.height) / USUAL_HEIGHT, 0.6), 1.9);

/** @param {number} joint @param {PosterMap} map */
const jointRadius = (joint, map) => known("skeleton").groups[groupOf[joint]].radius * zoomFactor(map);

/** @param {number} joint */
function jointPaint(joint) {
  const confidence = known("keypoints").confidence[joint];
  if (known("style").color_by === "confidence") return { color: confidenceColor(confidence), alpha: 1 };
  return { color: known("skeleton").groups[groupOf[joint]].color, alpha: 0.35 + 0.65 * Math.min(confidence, 1) };
}

function drawOverlay() {
  const context = cleared(overlayCanvas);
  drawn.maps = posterMaps();
  drawFitNames(context);
  tooltip.hidden = true;
  if (skeletonReady()) drawSkeleton(context);
  showPointerShape();
}

/** @param {Context} context */
function drawSkeleton(context) {
  if (!pointer.gesture) pointer.hovered = pick(pointer.place, REACH);
  const joints = shownJoints();
  for (const map of drawn.maps) {
    if (known("style").ghosts) drawGhosts(context, map);
    if (known("style").bones) drawBones(context, map);
    for (const joint of [...joints].reverse()) drawJoint(context, map, joint); // the body's last, on top
  }
  drawHovered(context);
  if (pointer.gesture?.kind === "marquee") drawMarquee(context, pointer.gesture);
}

/** @param {Context} context @param {PosterMap} map */
function drawBones(context, map) {
  const { groups, bones } = known("skeleton");
  const { minimum, color_by } = known("style");
  const { confidence } = known("keypoints");
  /** @param {number} joint */
  const sure = (joint) => confidence[joint] > 0 && confidence[joint] >= minimum && !badJoints.has(joint);
  const lines = groups.map(() => new Path2D());
  for (const [a, b] of bones) {
    if (![a, b].every((joint) => sure(joint) && groupShown(joint))) continue;
    lines[groupOf[a]].moveTo(...toScreen(map, position(a)));
    lines[groupOf[a]].lineTo(...toScreen(map, position(b)));
  }
  context.lineCap = "butt"; // points cover the ends
  groups.forEach((group, i) => {
    const width = (0.7 + 0.26 * group.radius) * zoomFactor(map);
    if (width > FINE_BONES) stroke(context, lines[i], "rgba(8, 10, 14, 0.5)", width + 1.6);
    context.globalAlpha = 0.85;
    stroke(context, lines[i], color_by === "group" ? group.color : PLAIN_BONES, width);
    context.globalAlpha = 1;
  });
}

/** @param {Context} context @param {PosterMap} map @param {number} joint */
function drawJoint(context, map, joint) {
  const [x, y] = toScreen(map, position(joint));
  const radius = jointRadius(joint, map);
  if (badJoints.has(joint)) drawBad(context, x, y, radius);
  else drawDisc(context, x, y, radius, joint);
  if (editedJoints.has(joint)) ring(context, x, y, 1.15 * radius + 1.5, COLORS.edited, 1.6);
  if (chosen.joints.has(joint)) ring(context, x, y, 1.5 * radius + 1.8, COLORS.selected, Math.min(1 + radius / 5, 2.2));
}

/** @param {Context} context @param {number} x @param {number} y @param {number} radius @param {number} joint */
function drawDisc(context, x, y, radius, joint) {
  const { color, alpha } = jointPaint(joint);
  stamp(context, rim(radius), x, y);
  if (known("keypoints").confidence[joint] === 0) return;
  context.globalAlpha = alpha;
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

/** Where edited keypoints were detected, and the way from there. @param {Context} context @param {PosterMap} map */
function drawGhosts(context, map) {
  for (const [joint, ...xy] of known("keypoints").detections) {
    if (!groupShown(joint) || !located(joint)) continue;
    const [x, y] = toScreen(map, xy);
    const way = new Path2D();
    way.moveTo(x, y);
    way.lineTo(...toScreen(map, position(joint)));
    context.globalAlpha = 0.75;
    stroke(context, way, COLORS.edited, 1);
    stroke(context, cross(x, y, 3.5), "#0a0c10", 3);
    stroke(context, cross(x, y, 3.5), "#dfe6ee", 1.2);
    context.globalAlpha = 1;
  }
}

/** @param {Context} context */
function drawHovered(context) {
  if (!pointer.hovered || !shown(pointer.hovered.joint)) return;
  const { joint, poster } = pointer.hovered;
  const places = drawn.maps.map((map) => toScreen(map, position(joint)));
  drawn.maps.forEach((map, i) => ring(context, ...places[i], jointRadius(joint, map) + 1.5, COLORS.hover, 1.8));
  if (!places[poster]) return;
  tooltip.textContent = jointLine(joint);
  placeTooltip(tooltip, ...places[poster], false);
}

/** "right wrist  0.83  edited" @param {number} joint */
function jointLine(joint) {
  const confidence = known("keypoints").confidence[joint];
  const parts = [known("skeleton").names[joint], confidence > 0 ? confidence.toFixed(2) : "missing"];
  if (badJoints.has(joint)) parts.push("bad");
  if (editedJoints.has(joint)) parts.push("edited");
  return parts.join("  ");
}

/** @param {Context} context @param {Gesture} gesture */
function drawMarquee(context, gesture) {
  const { x0, y0, x, y } = gesture;
  context.fillStyle = "rgba(255, 225, 77, 0.12)";
  context.strokeStyle = COLORS.selected;
  context.lineWidth = 1;
  context.fillRect(x0, y0, x - x0, y - y0);
  context.strokeRect(x0, y0, x - x0, y - y0);
  for (const joint of within(gesture))
    for (const map of drawn.maps) {
      const [px, py] = toScreen(map, position(joint));
      ring(context, px, py, 1.5 * jointRadius(joint, map) + 1.8, COLORS.selected, 1.2);
    }
}

/** @type {{ [kind: string]: string }} */
const GESTURE_SHAPES = { drag: "grabbing", marquee: "crosshair" };
let pointerShape = "";

/** Sets the pointer's shape, and leaves it alone while it is viser's to set. */
function showPointerShape() {
  const usual = pointer.hovered ? "grab" : "";
  const shape = skeletonReady() ? (GESTURE_SHAPES[pointer.gesture?.kind ?? ""] ?? usual) : "";
  if (shape !== pointerShape) canvas().style.cursor = shape;
  pointerShape = shape;
}

/** In their upper right corners: viser's messages come up at the upper left, chips and legend lie below.
 * @param {Context} context */
function drawFitNames(context) {
  context.font = `600 12.5px ${FONT}`;
  context.textBaseline = "middle";
  const { width } = canvasSize();
  const layout = states.layout;
  if (layout?.mode === "space")
    layout.posters.forEach((poster, i) => drawFitName(context, poster, width, 28 * i, width));
  for (const { ox, oy, ux, poster } of drawn.maps) {
    const across = ux * known("layout").image[0];
    drawFitName(context, poster, Math.min(ox + across, width), Math.max(oy, 0), across);
  }
}

/** A colour and a name, with its upper right corner near (right, top), at most as wide as `across`.
 * @param {Context} context @param {Poster} poster @param {number} right @param {number} top @param {number} across */
function drawFitName(context, { label, color }, right, top, across) {
  const text = shortenedName(context, label, across - 60);
  if (!text) return;
  const width = context.measureText(text).width + 32;
  const [x, y] = [right - width - 8, top + 8];
  context.fillStyle = "rgba(16, 19, 24, 0.82)";
  context.beginPath();
  context.roundRect(x, y, width, 24, 6);
  context.fill();
  context.fillStyle = color;
  context.fill(circle(x + 13, y + 12, 4.5));
  context.fillStyle = "#eef2f6";
  context.fillText(text, x + 23, y + 12.5);
}

addPainter("overlay", drawOverlay);

// viser draws its scene only now and then; right after it, the overlay follows a camera that has moved.
onSceneDrawn(() => {
  if (viewChanged()) paint("overlay");
});
