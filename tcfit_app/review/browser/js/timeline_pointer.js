// The timeline's gestures: seek, choose a range, zoom and move the axis, fold.

let stripGesture = null; // { kind: "seek" | "range" | "pan", pointer, x, anchor }

const stripX = (event) => event.clientX - strip.getBoundingClientRect().left;

function stripPress(event) {
  if (stripGesture || event.target !== stripCanvas || !states.timeline) return;
  const kind = event.button === 1 ? "pan" : event.button !== 0 ? null : event.shiftKey ? "range" : "seek";
  if (!kind) return;
  event.preventDefault();
  document.activeElement?.blur();
  stripCanvas.setPointerCapture(event.pointerId);
  const x = stripX(event);
  stripGesture = { kind, pointer: event.pointerId, x, start: x, anchor: frameAt(x), moved: false };
  STRIP_MOVES[kind](x);
}

const STRIP_MOVES = {
  seek(x) {
    pointedCursor = { frame: frameAt(x) };
    emitSoon({ type: "seek", frame: pointedCursor.frame, dragging: true });
    invalidate("timeline");
  },
  range(x) {
    if (!stripGesture.moved) return;
    const [a, b] = [stripGesture.anchor, frameAt(x)];
    pointedRange = { first: Math.min(a, b), last: Math.max(a, b) };
    emitSoon({ type: "range", ...pointedRange, dragging: true });
    invalidate("timeline");
  },
  pan(x) {
    showFrames(axis.first - ((x - stripGesture.x) / plotWidth()) * shownCount(), shownCount());
    stripGesture.x = x;
  },
};

function stripMove(event) {
  stripPointer = stripX(event);
  invalidate("timeline");
  if (event.pointerId !== stripGesture?.pointer) return;
  stripGesture.moved ||= Math.abs(stripPointer - stripGesture.start) >= DRAG_THRESHOLD;
  STRIP_MOVES[stripGesture.kind](stripPointer);
}

function stripRelease(event) {
  if (event.pointerId !== stripGesture?.pointer) return;
  const { kind, anchor, moved } = stripGesture;
  if (kind === "range" && !moved) rangeFromCursor(anchor);
  stripGesture = null;
  if (kind === "seek") emitLast({ type: "seek", frame: pointedCursor.frame, dragging: false });
  if (kind === "range" && pointedRange) emitLast({ type: "range", ...pointedRange, dragging: false });
  letGo();
}

/** Shift and a click: from the cursor to there. */
function rangeFromCursor(frame) {
  const cursor = cursorFrame() ?? frame;
  pointedRange = { first: Math.min(cursor, frame), last: Math.max(cursor, frame) };
}

/** What was pointed at stays as it is until the server says the same, or has had its time. */
function letGo() {
  const [cursor, range] = [pointedCursor, pointedRange];
  setTimeout(() => {
    if (stripGesture) return;
    if (pointedCursor === cursor) pointedCursor = null;
    if (pointedRange === range) pointedRange = undefined;
    invalidate("timeline");
  }, PATIENCE);
  invalidate("timeline");
}

function clearRange() {
  pointedRange = null;
  emitLast({ type: "range", first: null, last: null, dragging: false });
  letGo();
}

function stripWheel(event) {
  if (!states.timeline) return;
  event.preventDefault();
  const way = event.deltaMode === 1 ? 30 : 1; // lines or pixels
  const [dx, dy] = [event.deltaX * way, event.deltaY * way];
  const sideways = event.shiftKey ? dx || dy : Math.abs(dx) > Math.abs(dy) ? dx : 0;
  if (sideways) showFrames(axis.first + (sideways / plotWidth()) * shownCount(), shownCount());
  else zoomAxis(Math.exp(Math.max(-1, Math.min(1, dy * 0.002))), stripX(event));
}

function leaveStrip() {
  stripPointer = null;
  invalidate("timeline");
}

function stripInterrupted(event) {
  if (event.pointerId !== stripGesture?.pointer) return;
  stripGesture = null;
  letGo();
}

strip.addEventListener("pointerdown", stripPress, listening);
strip.addEventListener("pointermove", stripMove, listening);
strip.addEventListener("pointerup", stripRelease, listening);
strip.addEventListener("pointercancel", stripInterrupted, listening);
strip.addEventListener("lostpointercapture", stripInterrupted, listening);
strip.addEventListener("pointerleave", leaveStrip, listening);
strip.addEventListener("wheel", stripWheel, { ...listening, passive: false });
stripCanvas.addEventListener("dblclick", clearRange, listening);

function setCollapsed(now) {
  collapsed = now;
  sessionStorage.setItem("tcfit-collapsed", now ? "yes" : "no");
  layOutStrip();
}

function layOutStrip() {
  setStripHeight(clipLength() ? (collapsed ? RULER + 3 : FULL_HEIGHT) : 0);
  stripToggle.textContent = collapsed ? "▴" : "▾";
  stripToggle.title = collapsed ? "Show curves and marks" : "Hide curves and marks";
  invalidate("timeline");
}

stripToggle.addEventListener("click", () => setCollapsed(!collapsed), listening);

let shownLength = 0;
watch("timeline", (timeline) => {
  if ((timeline?.length ?? 0) !== shownLength) {
    shownLength = timeline?.length ?? 0;
    axis = { first: 0, last: Math.max(shownLength, 1) };
  }
  layOutStrip();
});
watch("cursor", (cursor) => {
  if (!stripGesture && pointedCursor?.frame === cursor?.frame) pointedCursor = null;
  if (cursor && states.timeline && !stripGesture) followCursor(cursor.frame);
  invalidate("timeline");
});
watch("lost", () => {
  stripGesture = pointedCursor = null;
  pointedRange = undefined;
  leaveStrip();
});
watch("range", () => {
  if (!stripGesture) pointedRange = undefined;
  invalidate("timeline");
});
for (const name of ["marks", "fit"]) watch(name, () => invalidate("timeline"));
