// The timeline's gestures: seek, choose a range, zoom and move the axis, fold.

import { PATIENCE, emitLast, emitSoon, invalidate, states, watch } from "../connection.js";
import { DRAG_THRESHOLD, leaveField, setStripHeight, strip, stripCanvas, stripToggle } from "../elements.js";
import {
  axis, clipLength, followCursor, frameAt, plotWidth, showAll, showFrames, shownCount, zoomAxis,
} from "./axis.js";
import { FULL_HEIGHT, RULER, cursorFrame, pointed } from "./drawing.js";

/** @typedef {{ kind: "seek" | "range" | "pan", pointer: number, x: number, start: number, anchor: number,
 *   moved: boolean }} StripGesture */

/** @type {StripGesture | null} */
let gesture = null;

/** @param {MouseEvent} event */
const stripX = (event) => event.clientX - strip.getBoundingClientRect().left;

/** @param {PointerEvent} event @returns {StripGesture["kind"] | null} */
const kindOf = ({ button, shiftKey }) => (button === 1 ? "pan" : button !== 0 ? null : shiftKey ? "range" : "seek");

/** @param {PointerEvent} event */
function press(event) {
  const kind = kindOf(event);
  if (!kind || gesture || event.target !== stripCanvas || !states.timeline) return;
  event.preventDefault();
  leaveField();
  stripCanvas.setPointerCapture(event.pointerId);
  const x = stripX(event);
  gesture = { kind, pointer: event.pointerId, x, start: x, anchor: frameAt(x), moved: false };
  MOVES[kind](gesture, x);
}

/** @type {{ [kind in StripGesture["kind"]]: (gesture: StripGesture, x: number) => void }} */
const MOVES = {
  seek(_, x) {
    pointed.cursor = frameAt(x);
    emitSoon({ type: "seek", frame: pointed.cursor });
    invalidate("timeline");
  },
  range({ anchor, moved }, x) {
    if (!moved) return;
    pointed.range = between(anchor, frameAt(x));
    emitSoon({ type: "range", ...pointed.range });
    invalidate("timeline");
  },
  pan(panned, x) {
    showFrames(axis.first - ((x - panned.x) / plotWidth()) * shownCount(), shownCount());
    panned.x = x;
  },
};

/** @param {number} a @param {number} b */
const between = (a, b) => ({ first: Math.min(a, b), last: Math.max(a, b) });

/** @param {PointerEvent} event */
function move(event) {
  pointed.x = stripX(event);
  invalidate("timeline");
  if (event.pointerId !== gesture?.pointer) return;
  gesture.moved ||= Math.abs(pointed.x - gesture.start) >= DRAG_THRESHOLD;
  MOVES[gesture.kind](gesture, pointed.x);
}

/** @param {PointerEvent} event */
function release(event) {
  if (event.pointerId !== gesture?.pointer) return;
  const { kind, anchor, moved } = gesture;
  if (kind === "range" && !moved) pointed.range = between(cursorFrame() ?? anchor, anchor); // Shift and a click
  gesture = null;
  if (kind === "seek" && pointed.cursor !== null) emitLast({ type: "seek", frame: pointed.cursor });
  if (kind === "range" && pointed.range) emitLast({ type: "range", ...pointed.range });
  letGo();
}

/** What was pointed at stays as it is until the server says the same, or has had its time. */
function letGo() {
  const { cursor, range } = pointed;
  setTimeout(() => {
    if (gesture) return;
    if (pointed.cursor === cursor) pointed.cursor = null;
    if (pointed.range === range) pointed.range = undefined;
    invalidate("timeline");
  }, PATIENCE);
  invalidate("timeline");
}

function clearRange() {
  pointed.range = null;
  emitLast({ type: "range", first: null, last: null });
  letGo();
}

/** @param {WheelEvent} event */
function wheel(event) {
  if (!states.timeline) return;
  event.preventDefault();
  const way = event.deltaMode === 1 ? 30 : 1; // lines or pixels
  const [dx, dy] = [event.deltaX * way, event.deltaY * way];
  const sideways = event.shiftKey ? dx || dy : Math.abs(dx) > Math.abs(dy) ? dx : 0;
  if (sideways) showFrames(axis.first + (sideways / plotWidth()) * shownCount(), shownCount());
  else zoomAxis(Math.exp(Math.max(-1, Math.min(1, dy * 0.002))), stripX(event));
}

function leave() {
  pointed.x = null;
  invalidate("timeline");
}

/** @param {PointerEvent} event */
function interrupted(event) {
  if (event.pointerId !== gesture?.pointer) return;
  gesture = null;
  letGo();
}

strip.addEventListener("pointerdown", press);
strip.addEventListener("pointermove", move);
strip.addEventListener("pointerup", release);
strip.addEventListener("pointercancel", interrupted);
strip.addEventListener("lostpointercapture", interrupted);
strip.addEventListener("pointerleave", leave);
strip.addEventListener("wheel", wheel, { passive: false });
stripCanvas.addEventListener("dblclick", clearRange);
new ResizeObserver(() => invalidate("timeline")).observe(strip);

/** Folds the strip, or unfolds it. */
function toggleCollapsed() {
  pointed.collapsed = !pointed.collapsed;
  sessionStorage.setItem("tcfit-collapsed", pointed.collapsed ? "yes" : "no");
  layOut();
}

function layOut() {
  const { collapsed } = pointed;
  setStripHeight(clipLength() ? (collapsed ? RULER + 3 : FULL_HEIGHT) : 0);
  stripToggle.textContent = collapsed ? "▴" : "▾";
  stripToggle.title = collapsed ? "Show curves and marks" : "Hide curves and marks";
  invalidate("timeline");
}

stripToggle.addEventListener("click", toggleCollapsed);

let shownLength = 0;
watch("timeline", () => {
  if (clipLength() !== shownLength) showAll();
  shownLength = clipLength();
  layOut();
});
watch("cursor", (cursor) => {
  if (!gesture && pointed.cursor === cursor?.frame) pointed.cursor = null;
  if (cursor && states.timeline && !gesture) followCursor(cursor.frame);
  invalidate("timeline");
});
watch("lost", () => {
  gesture = pointed.cursor = null;
  pointed.range = undefined;
  leave();
});
watch("range", () => {
  if (!gesture) pointed.range = undefined;
  invalidate("timeline");
});
for (const name of /** @type {const} */ (["marks", "fit"])) watch(name, () => invalidate("timeline"));
