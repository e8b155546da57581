// The timeline's gestures: seek, select frames, zoom and move the axis.

/** @import { Mark } from "./lanes.js" */

import { clearRange, letGo, showChosen } from "../bars/bar.js";
import { emit, emitLast, emitSoon, invalidate, states, watch } from "../connection.js";
import { DRAG_THRESHOLD, leaveField, strip, stripCanvas } from "../elements.js";
import {
  GUTTER, MARGIN, axis, clipLength, edgeX, followCursor, frameAt, plotWidth, showAll, showFrames, shownCount,
  zoomAxis,
} from "./axis.js";
import { markAt } from "./lanes.js";
import { fitBand, overview, ruler, within } from "./layout.js";
import { bringWindowTo } from "./overview.js";
import { chosenRange, cursorFrame, pointed } from "./pointed.js";

/** "key" moves a keyframe, "view" the overview's window.
 * @typedef {"seek" | "range" | "key" | "view"} Kind
 * @typedef {{ kind: Kind, pointer: number, x: number, start: number, anchor: number, grabbed: boolean,
 *   moved: boolean, mark: Mark | null }} StripGesture `grabbed`: an end of the selected frames, of which `anchor` is
 *   the other; `mark`: what was pressed */

const GRAB = 6; // CSS pixels around an end of the selected frames where it is grabbed

/** @type {StripGesture | null} */
let gesture = null;

/** @param {MouseEvent} event */
const placeOf = (event) => {
  const { left, top } = strip.getBoundingClientRect();
  return { x: event.clientX - left, y: event.clientY - top };
};

/** The frame at the other end of the selected ones, where the pointer grabs an end of them; else null.
 * @param {number} x @param {number} y */
function otherEnd(x, y) {
  const range = chosenRange();
  if (!range || !within({ top: ruler.top, bottom: fitBand.bottom }, y)) return null;
  const [left, right] = [Math.abs(x - edgeX(range.first)), Math.abs(x - edgeX(range.last + 1))];
  if (Math.min(left, right) > GRAB) return null;
  return left < right ? range.last : range.first;
}

/** What a press of the left button begins.
 * @param {number} y @param {boolean} shift @returns {Kind} */
function kindAt(y, shift) {
  if (within(overview(), y)) return "view";
  return shift || within({ top: ruler.top, bottom: fitBand.bottom }, y) ? "range" : "seek";
}

/** @param {PointerEvent} event */
function press(event) {
  if (gesture || event.target !== stripCanvas || !states.timeline || event.button !== 0) return;
  const { x, y } = placeOf(event);
  if (x < GUTTER - GRAB || x > GUTTER + plotWidth() + MARGIN) return;
  event.preventDefault();
  leaveField();
  stripCanvas.setPointerCapture(event.pointerId);
  const mark = markAt(x, y);
  const at = kindAt(y, event.shiftKey);
  const kind = at === "seek" && mark?.mark.key ? "key" : at;
  const other = kind === "range" ? otherEnd(x, y) : null;
  const anchor = other ?? mark?.frame ?? frameAt(x);
  const grabbed = other !== null;
  gesture = { kind, pointer: event.pointerId, x, start: x, anchor, grabbed, moved: false, mark: mark?.mark ?? null };
  if (kind === "view") bringWindowTo(x);
  if ((kind === "seek" || kind === "key") && mark) seekTo(mark.frame);
  else MOVES[kind](gesture, x);
}

/** @param {number} frame */
function seekTo(frame) {
  pointed.cursor = frame;
  emitSoon({ type: "seek", frame });
  invalidate("cursor");
}

/** @type {{ [kind in Kind]: (gesture: StripGesture, x: number) => void }} */
const MOVES = {
  seek: (_, x) => seekTo(frameAt(x)),
  range({ anchor, moved }, x) {
    if (!moved) return;
    pointed.range = between(anchor, frameAt(x));
    emitSoon({ type: "range", ...pointed.range });
    showChosen();
  },
  key({ moved }, x) {
    pointed.key = moved ? frameAt(x) : null;
    invalidate("cursor");
  },
  view(moved, x) {
    showFrames(axis.first + ((x - moved.x) / plotWidth()) * clipLength(), shownCount());
    moved.x = x;
  },
};

/** @param {number} a @param {number} b */
const between = (a, b) => ({ first: Math.min(a, b), last: Math.max(a, b) });

/** @param {PointerEvent} event */
function move(event) {
  const { x, y } = placeOf(event);
  const { clicked } = pointed;
  if (clicked && Math.hypot(x - clicked.x, y - clicked.y) > GRAB) pointed.clicked = null;
  Object.assign(pointed, { x: event.target === stripCanvas ? x : null, y });
  invalidate("cursor");
  if (!gesture) return void (stripCanvas.style.cursor = cursorAt(x, y));
  if (event.pointerId !== gesture.pointer) return;
  gesture.moved ||= Math.abs(x - gesture.start) >= DRAG_THRESHOLD;
  if (gesture.moved || gesture.kind !== "seek") MOVES[gesture.kind](gesture, x);
}

/** The pointer's shape, which says what a press would do. @param {number} x @param {number} y */
function cursorAt(x, y) {
  if (x < GUTTER - GRAB || x > GUTTER + plotWidth() + GRAB) return "default";
  if (otherEnd(x, y) !== null) return "ew-resize";
  if (within(overview(), y)) return "grab";
  if (within({ top: ruler.top, bottom: fitBand.bottom }, y)) return "text"; // as where text is selected
  return markAt(x, y) ? "pointer" : "default";
}

function tellCursor() {
  if (pointed.cursor !== null) emitLast({ type: "seek", frame: pointed.cursor });
}

/** What a release does.
 * @type {{ [kind in Kind]?: (gesture: StripGesture, x: number, shift: boolean) => void }} */
const ENDS = {
  seek({ mark, moved }) {
    tellCursor();
    if (mark?.suspicion && !moved) emit({ type: "look_at", entry: mark.suspicion });
  },
  range({ anchor, moved, grabbed }, x, shift) {
    if (!moved && !shift) {
      if (!grabbed) seekTo(frameAt(x)); // a click in the ruler
      return tellCursor();
    }
    if (!moved) pointed.range = between(cursorFrame() ?? anchor, anchor);
    if (pointed.range) emitLast({ type: "range", ...pointed.range });
  },
  key({ anchor }) {
    tellCursor();
    if (pointed.key !== null && pointed.key !== anchor) emit({ type: "move_key", frame: anchor, to: pointed.key });
    pointed.key = null;
  },
};

/** @param {PointerEvent} event */
function release(event) {
  if (event.pointerId !== gesture?.pointer) return;
  const ended = gesture;
  gesture = null;
  if (!ended.moved) pointed.clicked = placeOf(event);
  invalidate("cursor");
  ENDS[ended.kind]?.(ended, placeOf(event).x, event.shiftKey);
  letGo();
}

/** @param {MouseEvent} event */
function doubleClick(event) {
  const { x, y } = placeOf(event);
  if (within(overview(), y)) return showFrames(0, clipLength());
  if (x < GUTTER || otherEnd(x, y) !== null) return;
  clearRange();
}

/** @param {WheelEvent} event */
function wheel(event) {
  if (!states.timeline) return;
  event.preventDefault();
  pointed.clicked = null;
  const way = event.deltaMode === 1 ? 30 : 1; // lines or pixels
  const [dx, dy] = [event.deltaX * way, event.deltaY * way];
  const sideways = event.shiftKey ? dx || dy : Math.abs(dx) > Math.abs(dy) ? dx : 0;
  if (sideways) showFrames(axis.first + (sideways / plotWidth()) * shownCount(), shownCount());
  else zoomAxis(Math.exp(Math.max(-1, Math.min(1, dy * 0.002))), placeOf(event).x);
}

function leave() {
  pointed.x = pointed.clicked = null;
  invalidate("cursor");
}

/** @param {PointerEvent} event */
function interrupted(event) {
  if (event.pointerId !== gesture?.pointer) return;
  gesture = pointed.key = null;
  letGo();
}

strip.addEventListener("pointerdown", press);
strip.addEventListener("pointermove", move);
strip.addEventListener("pointerup", release);
strip.addEventListener("pointercancel", interrupted);
strip.addEventListener("lostpointercapture", interrupted);
strip.addEventListener("pointerleave", leave);
strip.addEventListener("wheel", wheel, { passive: false });
stripCanvas.addEventListener("dblclick", doubleClick);
new ResizeObserver(() => invalidate("timeline")).observe(strip);

let shownLength = 0;
watch("timeline", () => {
  if (clipLength() !== shownLength) showAll();
  shownLength = clipLength();
});
watch("cursor", (cursor) => {
  if (!gesture && pointed.cursor === cursor?.frame) pointed.cursor = null;
  if (cursor && states.timeline && !gesture) followCursor(cursor.frame);
  invalidate("cursor");
});
watch("lost", () => {
  gesture = pointed.cursor = pointed.key = null;
  pointed.range = undefined;
  leave();
});
watch("range", () => {
  if (!gesture) pointed.range = undefined;
  showChosen();
});
watch("fit", () => invalidate("timeline"));
