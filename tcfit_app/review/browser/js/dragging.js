// The left button on a poster: it selects and drags keypoints, and never moves viser's camera.

const DRAG_THRESHOLD = 3; // CSS pixels
const PATIENCE = 2000; // ms that keypoints stay where they were left, for the server to show them there

function press(event) {
  if (gesture || event.button !== 0 || !overPoster(event) || !skeletonReady()) return;
  const place = canvasPlace(event);
  const touch = event.pointerType === "touch";
  const found = pick(place, touch ? TOUCH_REACH : REACH);
  if (touch && !found) return; // fingers pan and zoom the picture
  gesture = { pointer: event.pointerId, x0: place.x, y0: place.y, ...place, found };
  gesture.anchor = found && toImage(lastMaps[found.poster], place.x, place.y);
  gesture.kind = found ? beginOnJoint(found.joint, event.shiftKey) : event.shiftKey ? "marquee" : "empty";
  hovered = found;
  viewer().canvas.setPointerCapture(event.pointerId);
  invalidate("overlay");
  event.stopPropagation();
}

/** Selects what was pressed; a press on one of several that the user has selected may begin to drag them all. */
function beginOnJoint(joint, shift) {
  if (shift) {
    select([joint], "toggle");
    return "toggled";
  }
  if (suggested || !selected.has(joint)) select([joint], "replace");
  return "press";
}

function move(event) {
  if (!gesture || event.pointerId !== gesture.pointer) return;
  Object.assign(gesture, canvasPlace(event));
  const way = Math.hypot(gesture.x - gesture.x0, gesture.y - gesture.y0);
  if (gesture.kind === "press" && way >= DRAG_THRESHOLD) beginDrag();
  if (gesture.kind === "drag") followPointer();
  invalidate("overlay");
  event.stopPropagation();
}

function beginDrag() {
  const joints = [...selected].filter(groupShown).sort((a, b) => a - b);
  gesture.kind = "drag";
  const from = Object.fromEntries(joints.map((joint) => [joint, position(joint)]));
  held = { joints: new Set(joints), from, dx: 0, dy: 0, frame: states.keypoints.frame, until: null };
  emit(dragEvent("start"));
}

function followPointer() {
  const [u, v] = toImage(lastMaps[gesture.found.poster], gesture.x, gesture.y);
  Object.assign(held, { dx: u - gesture.anchor[0], dy: v - gesture.anchor[1] });
  emitSoon(dragEvent("move"));
}

const dragEvent = (phase) => ({
  type: "drag",
  phase,
  joints: [...held.joints],
  dx: held.dx,
  dy: held.dy,
  frame: held.frame,
});

/** Ends a drag: its keypoints stay where they are now until the server shows them there. */
function endDrag(phase) {
  if (phase === "cancel") Object.assign(held, { dx: 0, dy: 0 });
  emitLast(dragEvent(phase));
  const left = held;
  left.until = performance.now() + PATIENCE;
  setTimeout(() => {
    if (held !== left) return;
    held = null;
    invalidate("overlay");
  }, PATIENCE);
}

function release(event) {
  if (!gesture || event.pointerId !== gesture.pointer) return;
  Object.assign(gesture, canvasPlace(event));
  const { kind, found } = gesture;
  if (kind === "drag") {
    followPointer();
    endDrag("end");
  }
  if (kind === "press" && selected.size > 1) select([found.joint], "replace");
  if (kind === "empty" && selected.size) select([], "replace");
  if (kind === "marquee") selectWithin();
  endGesture();
  event.stopPropagation();
}

function selectWithin() {
  const joints = within(gesture);
  if (joints.length) select(joints, "add");
}

function endGesture() {
  gesture = null;
  invalidate("overlay");
}

/** Whether there was something to give up. */
function cancelGesture() {
  if (!gesture) return false;
  if (gesture.kind === "drag" && held) endDrag("cancel");
  endGesture();
  return true;
}

const interrupted = (event) => {
  if (event.pointerId === gesture?.pointer) cancelGesture();
};

window.addEventListener("pointerdown", press, capturing);
window.addEventListener("pointermove", move, capturing);
window.addEventListener("pointerup", release, capturing);
window.addEventListener("pointercancel", interrupted, capturing);
window.addEventListener("lostpointercapture", interrupted, capturing);
window.addEventListener(
  "mousedown",
  (event) => {
    if (event.button !== 0 || !overPoster(event)) return;
    event.preventDefault(); // a drag across the page would select its text; but a field in use is to lose the focus
    document.activeElement?.blur();
  },
  capturing,
);

// Another frame, another layout or another connection ends a drag.
watch("keypoints", (keypoints) => {
  if (gesture?.kind !== "drag" || keypoints?.frame === held.frame) return;
  cancelGesture();
  held = null;
});
watch("lost", () => {
  cancelGesture();
  held = null; // whether the server took what was let go just now is not known
});
watch("layout", () => {
  cancelGesture();
  lastMaps = [];
  steerCamera();
});

let usualButtons = null; // viser's own

/** On posters viser's camera has no left button: nothing turns it, and the wheel zooms where the pointer is. */
function steerCamera() {
  const control = viewer().cameraControl;
  if (!control) return;
  usualButtons ??= { mouse: { ...control.mouseButtons }, touch: { ...control.touches }, cursor: control.dollyToCursor };
  const { mouse, touch, cursor } = usualButtons;
  const flat = states.layout?.mode === "poster";
  Object.assign(control.mouseButtons, mouse, flat ? { left: 0, middle: mouse.right } : {});
  Object.assign(control.touches, touch, flat ? { one: touch.three } : {});
  control.dollyToCursor = flat || cursor;
}

ending.signal.addEventListener("abort", () => {
  if (usualButtons) Object.assign(states, { layout: null });
  steerCamera();
});
