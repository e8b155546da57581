// States from the server, events to it, and one animation frame for all drawing.

const states = {};
const watchers = {}; // by name of a state: functions of it
const painters = {}; // by name of what is drawn
const dirty = new Set();
const waiting = new Map(); // the newest event of each kind that is sent once per animation frame
let field = null; // viser's id of the hidden text field that carries events
let eventCount = 0;
let frameRequest = 0;
let toAcknowledge = null;

function watch(name, change) {
  (watchers[name] ??= []).push(change);
}

/** Has it drawn in the next animation frame. */
function invalidate(...parts) {
  for (const part of parts) dirty.add(part);
  frameRequest ||= requestAnimationFrame(animate);
}

function paint(part) {
  if (!dirty.delete(part)) return;
  painters[part]();
}

function animate() {
  frameRequest = 0;
  for (const kind of [...waiting.keys()]) sendWaiting(kind);
  for (const part of [...dirty]) paint(part);
  if (toAcknowledge !== null) emit({ type: "drawn", frame: toAcknowledge });
  toAcknowledge = null;
}

function emit(event) {
  if (field === null) return;
  const value = JSON.stringify({ number: ++eventCount, event });
  viewer().sendMessage({ type: "GuiUpdateMessage", uuid: field, updates: { value } });
}

/** Sends it at once if none of its kind was sent just now, else in the next animation frame unless a newer one comes
 * first. Not always with the frame: while the graphics card is busy that is a tenth of a second away. */
function emitSoon(event) {
  if (performance.now() - (sentAt.get(event.type) ?? -Infinity) >= SPACING) return emitLast(event);
  waiting.set(event.type, event);
  invalidate();
}

const SPACING = 16; // milliseconds between events of a kind
const sentAt = new Map();

function sendWaiting(kind) {
  const event = waiting.get(kind);
  waiting.delete(kind);
  if (event) emitLast(event);
}

/** Sends it now; a waiting one of its kind is superseded. */
function emitLast(event) {
  waiting.delete(event.type);
  sentAt.set(event.type, performance.now());
  emit(event);
}

function receive(name, state) {
  states[name] = state;
  if (state && (name === "keypoints" || name === "cursor")) {
    toAcknowledge = state.frame;
    invalidate();
  }
  for (const change of watchers[name] ?? []) change(state);
}

const randomName = () =>
  [...crypto.getRandomValues(new Uint8Array(12))].map((byte) => byte.toString(16).padStart(2, "0")).join("");

/** This tab's own name, the same after a reload. */
function tabName() {
  // A duplicated tab inherits the storage; so the name is taken out of it while the page is open.
  if (tabName.known) return tabName.known;
  const kept = sessionStorage.getItem("tcfit-tab");
  sessionStorage.removeItem("tcfit-tab");
  tabName.known = kept ?? randomName();
  const keep = () => sessionStorage.setItem("tcfit-tab", tabName.known);
  window.addEventListener("pagehide", keep, listening);
  ending.signal.addEventListener("abort", keep);
  return tabName.known;
}

const canvasSize = () => ({ width: viewer().canvas.clientWidth, height: viewer().canvas.clientHeight });

/** Begins anew with an empty page: the first time, and whenever viser has connected again. */
function connect(uuid) {
  field = resting = null; // what ends now belongs to a connection that is gone
  for (const name of Object.keys(states)) receive(name, null);
  field = uuid;
  eventCount = 0;
  waiting.clear();
  toAcknowledge = null;
  emit({ type: "hello", tab: tabName(), ...canvasSize() });
}

/** The connection has ended. Nothing more goes out, for nobody would take it, until `connect`. */
function loseConnection() {
  if (field === null && resting === null) return;
  field = resting = null;
  clearTimeout(silence);
  waiting.clear();
  receive("fit", null); // whether it goes on is not known here
  receive("chips", { chips: (states.chips?.chips ?? []).filter(({ kind }) => kind !== "busy") });
  receive("lost", true);
}

const MISSED_BEATS = 4; // after which the server counts as silent
let silence = 0; // the timer of that
let resting = null; // `field` while it is

/** The server is there. A tunnel may hang for minutes before the connection ends, and a server may be stopped. */
watch("beat", (beat) => {
  clearTimeout(silence);
  if (!beat) return;
  if (resting !== null) {
    [field, resting] = [resting, null];
    receive("lost", null);
  }
  silence = setTimeout(fallSilent, MISSED_BEATS * beat.milliseconds, beat);
});

/** Nothing more goes out but the end of a drag. */
function fallSilent(beat) {
  if (document.hidden) return void (silence = setTimeout(fallSilent, beat.milliseconds, beat)); // it hears late
  if (field === null) return;
  waiting.clear();
  receive("lost", "silent");
  [field, resting] = [null, field];
}

// viser gives itself another function to send with when a connection has ended or begun, and tells in no other way.
let send = viewer().sendMessage;
const sender = { configurable: true, enumerable: true };
Object.defineProperty(viewer(), "sendMessage", {
  ...sender,
  get: () => send,
  set(next) {
    send = next;
    loseConnection();
  },
});
ending.signal.addEventListener("abort", () =>
  Object.defineProperty(viewer(), "sendMessage", { ...sender, writable: true, value: send }),
);

/** Tells when an element's size changes. */
function watchSize(watched, change) {
  const observer = new ResizeObserver(change);
  observer.observe(watched);
  ending.signal.addEventListener("abort", () => observer.disconnect());
}

watchSize(viewer().canvas, () => {
  emitSoon({ type: "resized", ...canvasSize() });
  invalidate("overlay");
});
watchSize(strip, () => invalidate("timeline"));
