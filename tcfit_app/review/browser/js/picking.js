// Which keypoint the pointer means: hovering, clicking, and choosing several with a rectangle.

const REACH = 12; // CSS pixels
const HOVER_REACH = REACH;
const TOUCH_REACH = 24;
const RANK_HANDICAP = 1.5; // CSS pixels: where they lie together the body's is meant rather than a hand's or the face's

let pointerPlace = null; // over the canvas: { x, y }
let gesture = null; // a press of the left button: { kind, pointer, ... }

/** The nearest keypoint on show, of all posters, and in which of them; or null. */
function pick(place, reach) {
  if (!place || !skeletonReady()) return null;
  let best = null;
  lastMaps.forEach((map, poster) => {
    for (const joint of shownJoints()) {
      const [x, y] = toScreen(map, position(joint));
      const distance = Math.hypot(x - place.x, y - place.y);
      const score = distance + RANK_HANDICAP * groupOf[joint];
      if (distance <= reach && (!best || score < best.score)) best = { joint, poster, score };
    }
  });
  return best;
}

function select(joints, how) {
  suggested = false;
  if (how === "replace") selected = new Set();
  for (const joint of joints)
    if (how === "toggle" && selected.has(joint)) selected.delete(joint);
    else selected.add(joint);
  emit({ type: "select", joints, how });
  invalidate("overlay");
}

/** Keypoints within the rectangle, in any poster. */
function within({ x0, y0, x, y }) {
  const inside = ([px, py]) => (px - x0) * (px - x) <= 0 && (py - y0) * (py - y) <= 0;
  return shownJoints().filter((joint) => lastMaps.some((map) => inside(toScreen(map, position(joint)))));
}

function drawMarquee(context) {
  if (gesture?.kind !== "marquee") return;
  const { x0, y0, x, y } = gesture;
  context.fillStyle = "rgba(255, 225, 77, 0.12)";
  context.strokeStyle = COLORS.selected;
  context.lineWidth = 1;
  context.fillRect(x0, y0, x - x0, y - y0);
  context.strokeRect(x0, y0, x - x0, y - y0);
  for (const joint of within(gesture))
    for (const map of lastMaps) {
      const [px, py] = toScreen(map, position(joint));
      ring(context, px, py, 1.5 * jointRadius(joint, map) + 1.8, COLORS.selected, 1.2);
    }
}

const GESTURE_SHAPES = { drag: "grabbing", marquee: "crosshair" };
let pointerShape = "";

/** Sets the pointer's shape, and leaves it alone while it is viser's to set. */
function showPointerShape() {
  const shape = !skeletonReady() ? "" : (GESTURE_SHAPES[gesture?.kind] ?? (hovered ? "grab" : ""));
  if (shape !== pointerShape) viewer().canvas.style.cursor = shape;
  pointerShape = shape;
}

/** Of an event, over the canvas. */
function canvasPlace(event) {
  const { left, top } = viewer().canvas.getBoundingClientRect();
  return { x: event.clientX - left, y: event.clientY - top };
}

const overPoster = (event) => event.target === viewer()?.canvas && states.layout?.mode === "poster";

function hover(event) {
  const now = overPoster(event) && event.pointerType !== "touch" && event.buttons === 0 ? canvasPlace(event) : null;
  if (!now && !pointerPlace) return;
  pointerPlace = now;
  invalidate("overlay");
}

window.addEventListener("pointermove", hover, capturing);
document.documentElement.addEventListener("pointerleave", hover, listening);
