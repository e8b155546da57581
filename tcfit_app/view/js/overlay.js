// Draws keypoints and bones over each poster, in step with viser's own drawing.

const CONFIDENCE_COLOURS = [
  [224, 58, 50],
  [242, 197, 61],
  [62, 190, 90],
];

/** Red over yellow to green. */
function confidenceColour(confidence) {
  const place = Math.min(Math.max(confidence, 0), 1) * 2;
  const from = Math.min(Math.floor(place), 1);
  const mix = (i) => Math.round(CONFIDENCE_COLOURS[from][i] * (1 - place + from) + CONFIDENCE_COLOURS[from + 1][i] * (place - from));
  return `rgb(${mix(0)}, ${mix(1)}, ${mix(2)})`;
}

/** Points keep their size on the screen, but for a little growth when zoomed in. */
const zoomFactor = (scale) => Math.min(Math.max(0.45 + 0.5 * scale, 0.6), 1.9);

function jointRadius(joint, scale) {
  return states.skeleton.groups[groupOf[joint]].radius * states.style.size * zoomFactor(scale);
}

function jointPaint(joint) {
  const confidence = states.keypoints.confidence[joint];
  if (states.style.colour_by === "confidence") return { colour: confidenceColour(confidence), alpha: 1 };
  return { colour: states.skeleton.groups[groupOf[joint]].colour, alpha: 0.35 + 0.65 * Math.min(confidence, 1) };
}

function drawOverlay() {
  const context = cleared(overlayCanvas);
  lastMaps = posterMaps();
  drawPosterLabels(context);
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
  context.lineCap = "round";
  states.skeleton.groups.forEach((group, i) => {
    const width = (0.7 + 0.26 * group.radius) * zoomFactor(map.scale) * Math.sqrt(states.style.size);
    stroke(context, lines[i], "rgba(8, 10, 14, 0.5)", width + 1.6);
    context.globalAlpha = 0.85;
    stroke(context, lines[i], group.colour, width);
    context.globalAlpha = 1;
  });
}

function stroke(context, path, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke(path);
}

function circle(x, y, radius) {
  const path = new Path2D();
  path.arc(x, y, radius, 0, 2 * Math.PI);
  return path;
}

function cross(x, y, arm) {
  const path = new Path2D();
  for (const side of [-1, 1]) {
    path.moveTo(x - arm, y - side * arm);
    path.lineTo(x + arm, y + side * arm);
  }
  return path;
}

function drawJoint(context, map, joint) {
  const [x, y] = toScreen(map, position(joint));
  const radius = jointRadius(joint, map.scale);
  if (badJoints.has(joint)) drawBad(context, x, y, radius);
  else drawDisc(context, x, y, radius, joint);
  if (editedJoints.has(joint)) ring(context, x, y, 1.15 * radius + 1.5, COLOURS.edited, 1.6);
  if (selected.has(joint)) ring(context, x, y, 1.5 * radius + 1.8, COLOURS.selected, Math.min(1 + radius / 5, 2.2));
}

/** A dark rim in a light one is seen on any picture. */
function drawDisc(context, x, y, radius, joint) {
  const disc = circle(x, y, radius);
  const missing = states.keypoints.confidence[joint] === 0;
  const { colour, alpha } = jointPaint(joint);
  stroke(context, disc, "rgba(255, 255, 255, 0.75)", Math.min(0.9 + 0.4 * radius, 2.6));
  stroke(context, disc, "rgba(8, 10, 14, 0.9)", Math.min(0.5 + 0.2 * radius, 1.3));
  if (missing) return;
  context.globalAlpha = alpha;
  context.fillStyle = colour;
  context.fill(disc);
  context.globalAlpha = 1;
}

function drawBad(context, x, y, radius) {
  const mark = cross(x, y, radius * 0.8 + 1);
  context.lineCap = "round";
  stroke(context, mark, "rgba(8, 10, 14, 0.85)", 4);
  stroke(context, mark, COLOURS.bad, 2);
}

function ring(context, x, y, radius, colour, width) {
  stroke(context, circle(x, y, radius), "rgba(8, 10, 14, 0.7)", width + 1.6);
  stroke(context, circle(x, y, radius), colour, width);
}

/** Where edited keypoints were detected, and the way from there. */
function drawGhosts(context, map) {
  for (const [joint, ...xy] of states.keypoints.detections) {
    if (!groupShown(joint)) continue;
    const [x, y] = toScreen(map, xy);
    const way = new Path2D();
    way.moveTo(x, y);
    way.lineTo(...toScreen(map, position(joint)));
    context.globalAlpha = 0.75;
    stroke(context, way, COLOURS.edited, 1);
    stroke(context, cross(x, y, 3.5), "#0a0c10", 3);
    stroke(context, cross(x, y, 3.5), "#dfe6ee", 1.2);
    context.globalAlpha = 1;
  }
}

function drawHovered(context) {
  if (!hovered || !shown(hovered.joint)) return;
  const { joint, map } = { joint: hovered.joint, map: lastMaps[hovered.poster] };
  if (!map) return;
  const [x, y] = toScreen(map, position(joint));
  ring(context, x, y, jointRadius(joint, map.scale) + 1.5, COLOURS.hover, 1.8);
  tooltip.textContent = jointLine(joint);
  place(tooltip, x, y, false);
}

/** "right_wrist  0.83  edited" */
function jointLine(joint) {
  const confidence = states.keypoints.confidence[joint];
  const parts = [nameOf[joint], confidence > 0 ? confidence.toFixed(2) : "missing"];
  if (badJoints.has(joint)) parts.push("bad");
  if (editedJoints.has(joint)) parts.push("edited");
  return parts.join("  ");
}

function drawPosterLabels(context) {
  context.font = `600 12.5px ${FONT}`;
  context.textBaseline = "middle";
  for (const { ox, oy, poster } of lastMaps) {
    if (!poster.label) continue;
    const width = context.measureText(poster.label).width + 32;
    const [x, y] = [ox + 8, Math.max(oy, 0) + 8];
    context.fillStyle = "rgba(16, 19, 24, 0.82)";
    context.beginPath();
    context.roundRect(x, y, width, 24, 6);
    context.fill();
    context.fillStyle = poster.colour;
    context.fill(circle(x + 13, y + 12, 4.5));
    context.fillStyle = "#eef2f6";
    context.fillText(poster.label, x + 23, y + 12.5);
  }
}

painters.overlay = drawOverlay;

// viser draws its scene only now and then; right after it, the overlay follows a camera that has moved.
viewer().scene.onAfterRender = (renderer, scene, camera) => {
  if (camera !== viewer().camera || !viewChanged()) return;
  dirty.add("overlay");
  paint("overlay");
};
ending.signal.addEventListener("abort", () => delete viewer().scene.onAfterRender);
