// The left button: it selects and drags keypoints. viser's camera it turns in 3D alone.

/** @import { Found, Gesture, Place } from "./picking.js" */
/** @import { Held } from "./skeleton.js" */
/** @import { Drag, Keypoints } from "../wire" */

import { PATIENCE, emit, emitLast, emitSoon, invalidate, known, states, watch } from "../connection.js";
import { DRAG_THRESHOLD, leaveField } from "../elements.js";
import { canvas, canvasSize, keepCameraFlat, moveWheel } from "../viser/bridge.js";
import { beginDepthDrag, endDepthDrag, followInDepth } from "./depth.js";
import { selectPersonAt } from "./people.js";
import {
  REACH, TOUCH_REACH, canvasPlace, inPicture, inView, overPoster, overScene, pick, pictureAt, pointer, within,
} from "./picking.js";
import { drawn, inBox, toImage } from "./projection.js";
import {
  chosen, groupShown, isPicture, isSide, marked, pointsOf, position, select, skeletonReady,
} from "./skeleton.js";

/** @param {PointerEvent} event */
function press(event) {
  if (pointer.gesture || event.button !== 0 || !overScene(event) || !skeletonReady()) return;
  const place = canvasPlace(event);
  const framed = states.framing && pictureAt(place);
  if (framed) {
    begin(event, place, { found: null, anchor: toImage(framed, place.x, place.y), kind: "framing" });
    return;
  }
  const touch = event.pointerType === "touch";
  const found = pick(place, touch ? TOUCH_REACH : REACH);
  if (!found && (touch || !overPoster(event))) return; // that pans and zooms the picture, or turns 3D
  const anchor = found && toImage(drawn.maps[found.poster], place.x, place.y);
  const kind = found ? beginOnJoint(found, event.shiftKey) : event.shiftKey ? "marquee" : "empty";
  begin(event, place, { found, anchor, kind });
}

/** @param {PointerEvent} event @param {Place} place @param {Pick<Gesture, "found" | "anchor" | "kind">} what */
function begin(event, place, what) {
  pointer.gesture = { pointer: event.pointerId, x0: place.x, y0: place.y, ...place, ...what };
  pointer.hovered = what.found;
  canvas().setPointerCapture(event.pointerId);
  invalidate("overlay");
  event.stopPropagation();
}

/** Selects what was pressed; a press on one of several that the user has selected may begin to drag them all.
 * @param {Found} found @param {boolean} shift */
function beginOnJoint(found, shift) {
  const { joint } = found;
  const view = inView(found);
  const same = chosen.view === view;
  if (shift && same) {
    select([joint], "toggle", view);
    return "toggled";
  }
  if (chosen.suggested || !chosen.joints.has(joint) || !same) select([joint], "replace", view);
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
  if (gesture.kind === "press" && way >= DRAG_THRESHOLD) {
    if (inPicture(gesture.found)) beginDrag(gesture);
    else beginDepthDrag(gesture);
  }
  if (gesture.kind === "drag") followPointer(gesture);
  if (gesture.kind === "depth") followInDepth(gesture);
  invalidate("overlay");
  event.stopPropagation();
}

/** @param {Gesture} gesture */
function beginDrag(gesture) {
  if (!gesture.found) return;
  const [points, view] = [pointsOf(drawn.maps[gesture.found.poster]), inView(gesture.found)];
  const joints = withHands([...chosen.joints].filter(groupShown), points).sort((a, b) => a - b);
  gesture.kind = "drag";
  const from = Object.fromEntries(joints.map((joint) => [joint, position(joint, points)]));
  const { frame } = known("keypoints");
  chosen.held = { joints: new Set(joints), from, dx: 0, dy: 0, frame, view, left: false };
  emit(dragEvent("start", chosen.held));
}

/** With the hands whose wrists are among them, if these go along. @param {number[]} joints @param {Keypoints} points */
function withHands(joints, points) {
  const all = new Set(joints);
  const hands = known("style").hand_along ? known("skeleton").hands : [];
  for (const [wrist, start, stop] of hands) {
    if (!all.has(wrist) && !all.has(start)) continue;
    for (let joint = start; joint < stop; joint++) if (detected(joint, points)) all.add(joint);
    if (detected(wrist, points)) all.add(wrist);
  }
  return [...all];
}

/** @param {number} joint @param {Keypoints} points */
const detected = (joint, points) => points.confidence[joint] > 0 && !marked("bad", joint, points);

/** @param {Gesture} gesture */
function followPointer({ found, anchor, x, y }) {
  if (!chosen.held || !found || !anchor) return;
  const [u, v] = toImage(drawn.maps[found.poster], x, y);
  Object.assign(chosen.held, { dx: u - anchor[0], dy: v - anchor[1] });
  emitSoon(dragEvent("move", chosen.held));
}

/** @param {Drag["phase"]} phase @param {Held} held @returns {Drag} */
const dragEvent = (phase, { joints, dx, dy, frame, view }) =>
  ({ type: "drag", phase, joints: [...joints], dx, dy, frame, view });

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
  if (gesture.kind === "depth") {
    followInDepth(gesture);
    endDepthDrag("end");
  }
  if (gesture.kind === "press" && gesture.found && chosen.joints.size > 1)
    select([gesture.found.joint], "replace", inView(gesture.found));
  if (gesture.kind === "empty") pressBesides(gesture);
  if (gesture.kind === "marquee") selectWithin(gesture);
  if (gesture.kind === "framing") frameWithin(gesture);
  endGesture();
  event.stopPropagation();
}

/** A press where there is no keypoint of this person. @param {Gesture} gesture */
function pressBesides(gesture) {
  if (chosen.joints.size) select([], "replace", false);
  const map = drawn.maps.find((one) => isPicture(one) && inBox(one.seen, gesture));
  const still = Math.hypot(gesture.x - gesture.x0, gesture.y - gesture.y0) < DRAG_THRESHOLD;
  if (map && still) selectPersonAt(map, gesture);
}

/** @param {Gesture} gesture */
function selectWithin(gesture) {
  const joints = within(gesture);
  const at = drawn.maps.find(({ window }) => inBox(window, { x: gesture.x0, y: gesture.y0 }));
  if (joints.length) select(joints, "add", at?.poster.kind === "view");
}

/** Tells the rectangle that was drawn; a press alone draws none. @param {Gesture} gesture */
function frameWithin({ x0, y0, x, y, anchor }) {
  const map = pictureAt({ x: x0, y: y0 });
  if (!map || !anchor || Math.hypot(x - x0, y - y0) < DRAG_THRESHOLD) return;
  const [u, v] = toImage(map, x, y);
  emit({ type: "framed", left: anchor[0], top: anchor[1], right: u, bottom: v, frame: known("keypoints").frame });
}

function endGesture() {
  pointer.gesture = null;
  invalidate("overlay");
}

/** Whether there was something to give up of which the server knows by that alone. */
export function cancelGesture() {
  const { gesture } = pointer;
  if (gesture?.kind === "drag" && chosen.held) endDrag("cancel", chosen.held);
  if (gesture?.kind === "depth") endDepthDrag("cancel");
  if (gesture) endGesture();
  return gesture !== null && gesture.kind !== "framing"; // Esc ends the command, too
}

/** @param {PointerEvent} event */
const interrupted = (event) => {
  if (event.pointerId === pointer.gesture?.pointer) cancelGesture();
};

let layoutForm = ""; // of the last layout

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

// Another frame, another layout or another connection ends a drag; another title of a picture does not.
watch("keypoints", (keypoints) => {
  const frame = (chosen.held ?? chosen.inDepth)?.frame;
  if (!["drag", "depth"].includes(pointer.gesture?.kind ?? "") || keypoints?.frame === frame) return;
  cancelGesture();
  chosen.held = null;
});
watch("lost", () => {
  cancelGesture();
  chosen.held = null; // whether the server took what was let go just now is not known
});
watch("layout", (layout) => {
  const form = JSON.stringify(layout, (name, value) => (name === "label" ? undefined : value));
  if (form === layoutForm) return;
  layoutForm = form;
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
// viser zooms about the pointer: about what lies there in a poster's window, as if that were the whole canvas.
moveWheel((event) => {
  const place = canvasPlace(event);
  const map = drawn.maps.find(({ seen }) => inBox(seen, place));
  if (!map || states.layout?.mode !== "poster") return null;
  const { width, height } = canvasSize();
  const { left, top, right, bottom } = map.window;
  const x = isSide(map) ? 0 : place.x - (left + right) / 2; // depth is not what the picture has there
  return { x: width / 2 + x, y: height / 2 + place.y - (top + bottom) / 2 };
});
window.addEventListener("pointerdown", tellCameraGesture, true);
