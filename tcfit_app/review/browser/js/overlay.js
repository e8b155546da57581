// Draws keypoints and bones over each poster, in step with viser's own drawing.

const CONFIDENCE_COLORS = [
  [224, 58, 50],
  [242, 197, 61],
  [62, 190, 90],
];

const FINE_BONES = 1.3; // CSS pixels: too fine for a rim
const PLAIN_BONES = "#c3cad4";

/** Red over yellow to green, in twenty steps. */
function confidenceColor(confidence) {
  const place = Math.round(Math.min(Math.max(confidence, 0), 1) * 20) / 10;
  const from = Math.min(Math.floor(place), 1);
  const mixed = CONFIDENCE_COLORS[from].map((c, i) => c + (CONFIDENCE_COLORS[from + 1][i] - c) * (place - from));
  return `rgb(${mixed.map(Math.round).join(", ")})`;
}

const USUAL_HEIGHT = 700; // CSS pixels of a poster that fills a window

/** Points keep their size on the screen, but for a little growth when zoomed in. */
const zoomFactor = (map) => Math.min(Math.max(0.5 + (0.5 * map.height) / USUAL_HEIGHT, 0.6), 1.9);

function jointRadius(joint, map) {
  return states.skeleton.groups[groupOf[joint]].radius * states.style.size * zoomFactor(map);
}

function jointPaint(joint) {
  const confidence = states.keypoints.confidence[joint];
  if (states.style.color_by === "confidence") return { color: confidenceColor(confidence), alpha: 1 };
  return { color: states.skeleton.groups[groupOf[joint]].color, alpha: 0.35 + 0.65 * Math.min(confidence, 1) };
}

function drawOverlay() {
  const context = cleared(overlayCanvas);
  lastMaps = posterMaps();
  drawFitNames(context);
  tooltip.hidden = true;
  if (skeletonReady()) drawSkeleton(context);
  showPointerShape();
}

function drawSkeleton(context) {
  hovered = gesture ? hovered : pick(pointerPlace, HOVER_REACH);
  const joints = shownJoints();
  for (const map of lastMaps) {
    if (states.style.ghosts) drawGhosts(context, map);
    if (states.style.bones) drawBones(context, map);
    for (const joint of [...joints].reverse()) drawJoint(context, map, joint); // the body's last, on top
  }
  drawHovered(context);
  drawMarquee(context);
}

/** The posters' maps as they were drawn last: what the pointer meets. */
let lastMaps = [];

function drawBones(context, map) {
  const drawn = (joint) => states.keypoints.confidence[joint] > 0 && !badJoints.has(joint) && groupShown(joint);
  const enough = (joint) => states.keypoints.confidence[joint] >= states.style.minimum;
  const lines = states.skeleton.groups.map(() => new Path2D());
  for (const [a, b] of states.skeleton.bones) {
    if (![a, b].every((joint) => drawn(joint) && enough(joint))) continue;
    lines[groupOf[a]].moveTo(...toScreen(map, position(a)));
    lines[groupOf[a]].lineTo(...toScreen(map, position(b)));
  }
  context.lineCap = "butt"; // points cover the ends, and round ones cost twice the time in software
  states.skeleton.groups.forEach((group, i) => {
    const width = (0.7 + 0.26 * group.radius) * zoomFactor(map) * Math.sqrt(states.style.size);
    if (width > FINE_BONES) stroke(context, lines[i], "rgba(8, 10, 14, 0.5)", width + 1.6);
    context.globalAlpha = 0.85;
    stroke(context, lines[i], states.style.color_by === "group" ? group.color : PLAIN_BONES, width);
    context.globalAlpha = 1;
  });
}

function drawJoint(context, map, joint) {
  const [x, y] = toScreen(map, position(joint));
  const radius = jointRadius(joint, map);
  if (badJoints.has(joint)) drawBad(context, x, y, radius);
  else drawDisc(context, x, y, radius, joint);
  if (editedJoints.has(joint)) ring(context, x, y, 1.15 * radius + 1.5, COLORS.edited, 1.6);
  if (selected.has(joint)) ring(context, x, y, 1.5 * radius + 1.8, COLORS.selected, Math.min(1 + radius / 5, 2.2));
}

function drawDisc(context, x, y, radius, joint) {
  const { color, alpha } = jointPaint(joint);
  stamp(context, rim(radius), x, y);
  if (states.keypoints.confidence[joint] === 0) return;
  context.globalAlpha = alpha;
  stamp(context, disc(color, radius), x, y);
  context.globalAlpha = 1;
}

function drawBad(context, x, y, radius) {
  const mark = cross(x, y, radius * 0.8 + 1);
  context.lineCap = "round";
  stroke(context, mark, "rgba(8, 10, 14, 0.85)", 4);
  stroke(context, mark, COLORS.bad, 2);
}

/** Where edited keypoints were detected, and the way from there. */
function drawGhosts(context, map) {
  for (const [joint, ...xy] of states.keypoints.detections) {
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

function drawHovered(context) {
  if (!hovered || !shown(hovered.joint)) return;
  const { joint, poster } = hovered;
  const places = lastMaps.map((map) => toScreen(map, position(joint)));
  lastMaps.forEach((map, i) => ring(context, ...places[i], jointRadius(joint, map) + 1.5, COLORS.hover, 1.8));
  if (!places[poster]) return;
  tooltip.textContent = jointLine(joint);
  place(tooltip, ...places[poster], false);
}

/** "right wrist  0.83  edited" */
function jointLine(joint) {
  const confidence = states.keypoints.confidence[joint];
  const parts = [nameOf[joint], confidence > 0 ? confidence.toFixed(2) : "missing"];
  if (badJoints.has(joint)) parts.push("bad");
  if (editedJoints.has(joint)) parts.push("edited");
  return parts.join("  ");
}

/** In their upper right corners: viser's messages come up at the upper left, chips and legend lie below. */
function drawFitNames(context) {
  context.font = `600 12.5px ${FONT}`;
  context.textBaseline = "middle";
  const { width } = canvasSize();
  if (states.layout?.mode === "space") {
    states.layout.posters.forEach((poster, i) => drawFitName(context, poster, width, 28 * i, width));
  }
  for (const { ox, oy, ux, poster } of lastMaps) {
    const across = ux * states.layout.image[0];
    drawFitName(context, poster, Math.min(ox + across, width), Math.max(oy, 0), across);
  }
}

/** A colour and a name, with its upper right corner near (right, top), at most as wide as `across`. */
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

painters.overlay = drawOverlay;

// viser draws its scene only now and then; right after it, the overlay follows a camera that has moved.
viewer().scene.onAfterRender = (renderer, scene, camera) => {
  if (camera !== viewer().camera || !viewChanged()) return;
  dirty.add("overlay");
  paint("overlay");
};
ending.signal.addEventListener("abort", () => delete viewer().scene.onAfterRender);
