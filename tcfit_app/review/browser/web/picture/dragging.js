// The left button on a poster: it selects and drags keypoints, and never moves viser's camera.

/** @import { Gesture } from "./picking.js" */
/** @import { Held } from "./skeleton.js" */
/** @import { Drag } from "../wire" */

import { PATIENCE, emit, emitLast, emitSoon, invalidate, known, states, watch } from "../connection.js";
import { DRAG_THRESHOLD, leaveField } from "../elements.js";
import { canvas, keepCameraFlat } from "../viser/bridge.js";
import { REACH, TOUCH_REACH, canvasPlace, overPoster, pick, pointer, within } from "./picking.js";
import { drawn, toImage } from "./projection.js";
import { chosen, groupShown, position, select, skeletonReady } from "./skeleton.js";

/** @param {PointerEvent} event */
function press(event) {
  if (pointer.gesture || event.button !== 0 || !overPoster(event) || !skeletonReady()) return;
  const place = canvasPlace(event);
  const touch = event.pointerType === "touch";
  const found = pick(place, touch ? TOUCH_REACH : REACH);
  if (touch && !found) return; // fingers pan and zoom the picture
  const anchor = found && toImage(drawn.maps[found.poster], place.x, place.y);
  const kind = found ? beginOnJoint(found.joint, event.shiftKey) : event.shiftKey ? "marquee" : "empty";
  pointer.gesture = { pointer: event.pointerId, x0: place.x, y0: place.y, ...place, found, anchor, kind };
  pointer.hovered = found;
  canvas().setPointerCapture(event.pointerId);
  invalidate("overlay");
  event.stopPropagation();
}

/** Selects what was pressed; a press on one of several that the user has selected may begin to drag them all.
 * @param {number} joint @param {boolean} shift */
function beginOnJoint(joint, shift) {
  if (shift) {
    select([joint], "toggle");
    return "toggled";
  }
  if (chosen.suggested || !chosen.joints.has(joint)) select([joint], "replace");
  return "press";
}

/** The gesture of this event's pointer, at its new place. @param {PointerEvent} event */
function gestureOf(event) {
  if (event.pointerId !== pointer.gesture?.pointer) return null;
  return Object.assign(pointer.gesture, canvasPlace(event));
}

/** @param {PointerEvent} event */
function move(event) {
  const gesture = gestureOf(event);
  if (!gesture) return;
  const way = Math.hypot(gesture.x - gesture.x0, gesture.y - gesture.y0);
  if (gesture.kind === "press" && way >= DRAG_THRESHOLD) beginDrag(gesture);
  if (gesture.kind === "drag") followPointer(gesture);
  invalidate("overlay");
  event.stopPropagation();
}

/** @param {Gesture} gesture */
function beginDrag(gesture) {
  const joints = [...chosen.joints].filter(groupShown).sort((a, b) => a - b);
  gesture.kind = "drag";
  const from = Object.fromEntries(joints.map((joint) => [joint, position(joint)]));
  chosen.held = { joints: new Set(joints), from, dx: 0, dy: 0, frame: known("keypoints").frame, left: false };
  emit(dragEvent("start", chosen.held));
}

/** @param {Gesture} gesture */
function followPointer({ found, anchor, x, y }) {
  if (!chosen.held || !found || !anchor) return;
  const [u, v] = toImage(drawn.maps[found.poster], x, y);
  Object.assign(chosen.held, { dx: u - anchor[0], dy: v - anchor[1] });
  emitSoon(dragEvent("move", chosen.held));
}

/** @param {Drag["phase"]} phase @param {Held} held @returns {Drag} */
const dragEvent = (phase, { joints, dx, dy, frame }) =>
  ({ type: "drag", phase, joints: [...joints], dx, dy, frame });

/** Ends a drag: its keypoints stay where they are now until the server shows them there.
 * @param {"end" | "cancel"} phase @param {Held} held */
function endDrag(phase, held) {
  if (phase === "cancel") Object.assign(held, { dx: 0, dy: 0 });
  emitLast(dragEvent(phase, held));
  held.left = true;
  setTimeout(() => {
    if (chosen.held !== held) return;
    chosen.held = null;
    invalidate("overlay");
  }, PATIENCE);
}

/** @param {PointerEvent} event */
function release(event) {
  const gesture = gestureOf(event);
  if (!gesture) return;
  if (gesture.kind === "drag") {
    followPointer(gesture);
    if (chosen.held) endDrag("end", chosen.held);
  }
  if (gesture.kind === "press" && gesture.found && chosen.joints.size > 1) select([gesture.found.joint], "replace");
  if (gesture.kind === "empty" && chosen.joints.size) select([], "replace");
  if (gesture.kind === "marquee") selectWithin(gesture);
  endGesture();
  event.stopPropagation();
}

/** @param {Gesture} gesture */
function selectWithin(gesture) {
  const joints = within(gesture);
  if (joints.length) select(joints, "add");
}

function endGesture() {
  pointer.gesture = null;
  invalidate("overlay");
}

/** Whether there was something to give up. */
export function cancelGesture() {
  const { gesture } = pointer;
  if (gesture?.kind === "drag" && chosen.held) endDrag("cancel", chosen.held);
  if (gesture) endGesture();
  return gesture !== null;
}

/** @param {PointerEvent} event */
const interrupted = (event) => {
  if (event.pointerId === pointer.gesture?.pointer) cancelGesture();
};

window.addEventListener("pointerdown", press, true);
window.addEventListener("pointermove", move, true);
window.addEventListener("pointerup", release, true);
window.addEventListener("pointercancel", interrupted, true);
window.addEventListener("lostpointercapture", interrupted, true);
window.addEventListener("mousedown", (event) => {
  if (event.button !== 0 || !overPoster(event)) return;
  event.preventDefault(); // a drag across the page would select its text; but a field in use is to lose the focus
  leaveField();
}, true);

// Another frame, another layout or another connection ends a drag.
watch("keypoints", (keypoints) => {
  if (pointer.gesture?.kind !== "drag" || keypoints?.frame === chosen.held?.frame) return;
  cancelGesture();
  chosen.held = null;
});
watch("lost", () => {
  cancelGesture();
  chosen.held = null; // whether the server took what was let go just now is not known
});
watch("layout", (layout) => {
  cancelGesture();
  drawn.maps = [];
  keepCameraFlat(layout?.mode === "poster");
});

// The server stops fitting the picture into the window when the user moves viser's camera.

/** @param {PointerEvent | WheelEvent} event */
function tellCameraGesture(event) {
  if (event.target !== canvas() || !states.layout) return;
  const touch = event instanceof PointerEvent && event.pointerType === "touch";
  const moves = event.type === "wheel" || states.layout.mode === "space" || event.button !== 0 || touch;
  if (moves) emitSoon({ type: "gesture" });
}

window.addEventListener("wheel", tellCameraGesture, { capture: true, passive: true });
window.addEventListener("pointerdown", tellCameraGesture, true);
