// States from the server, events to it, and one animation frame for all drawing.

/** @import { PageEvent, States } from "./wire" */

import { STEPS, remember, remembered } from "./remembered.js";
import { isDark, onOtherTheme } from "./theme.js";
import { canvas, canvasFits, canvasSize, onOtherConnection, sendText } from "./viser/bridge.js";

/**
 * What the server sent last under each name; and under "lost" whether the connection has ended, the server is silent,
 * or another one has begun in its place; and under "strip" whether there will be a timeline.
 * @typedef {{ [name in keyof States]?: States[name] | null } & { lost?: true | "silent" | "restarted" | null,
 *   strip?: boolean | null }} Known
 */

/** @type {Known} */
export const states = {};
/** Milliseconds that something stays where the user has put it, for the server to show it there. */
export const PATIENCE = 2000;

/** @type {{ [name: string]: ((state: any) => void)[] }} */
const watchers = {}; // by name of a state
/** @type {{ [part: string]: () => void }} */
const painters = {};
/** @type {Set<string>} */
const dirty = new Set(); // parts to draw
/** @type {Map<string, PageEvent>} */
const waiting = new Map(); // the newest event of each kind that is sent once per animation frame
/** @type {string | null} */
let field = null; // viser's id of the hidden text field that carries events
let eventCount = 0;
let frameRequest = 0;
/** @type {number | null} */
let toAcknowledge = null;

// --- states and drawing ---

/**
 * A state that must be there.
 * @template {keyof States} N
 * @param {N} name
 * @returns {States[N]}
 */
export function known(name) {
  const state = states[name];
  if (!state) throw new Error(`There is no state "${name}"`);
  return /** @type {States[N]} */ (state);
}

/**
 * Calls back whenever the state is another one.
 * @template {keyof Known} N
 * @param {N} name
 * @param {(state: Known[N]) => void} change
 */
export function watch(name, change) {
  (watchers[name] ??= []).push(change);
}

/** @param {string} part @param {() => void} draw */
export const addPainter = (part, draw) => void (painters[part] = draw);

/** Has it drawn in the next animation frame. @param {string[]} parts */
export function invalidate(...parts) {
  for (const part of parts) dirty.add(part);
  frameRequest ||= requestAnimationFrame(animate);
}

/** Draws it now. @param {string} part */
export function paint(part) {
  dirty.delete(part);
  painters[part]();
}

function animate() {
  frameRequest = 0;
  for (const kind of [...waiting.keys()]) sendWaiting(kind);
  for (const part of [...dirty]) paint(part);
  if (toAcknowledge !== null) emit({ type: "drawn", frame: toAcknowledge });
  toAcknowledge = null;
}

/** A state has come. @param {keyof Known} name @param {any} state */
export function receive(name, state) {
  states[name] = state;
  if (state && (name === "keypoints" || name === "cursor")) {
    toAcknowledge = state.frame;
    invalidate();
  }
  for (const change of watchers[name] ?? []) change(state);
}

// --- events ---

/** @param {PageEvent} event */
export function emit(event) {
  if (field !== null) sendText(field, JSON.stringify({ number: ++eventCount, event }));
}

const SPACING = 16; // milliseconds between events of a kind
/** @type {Map<string, number>} */
const sentAt = new Map();

/** Sends it at once if none of its kind was sent just now, else in the next animation frame unless a newer one comes
 * first. Not always with the frame: while the graphics card is busy that is a tenth of a second away.
 * @param {PageEvent} event */
export function emitSoon(event) {
  if (performance.now() - (sentAt.get(event.type) ?? -Infinity) >= SPACING) return emitLast(event);
  waiting.set(event.type, event);
  invalidate();
}

/** @param {string} kind */
function sendWaiting(kind) {
  const event = waiting.get(kind);
  waiting.delete(kind);
  if (event) emitLast(event);
}

/** Sends it now; a waiting one of its kind is superseded. @param {PageEvent} event */
export function emitLast(event) {
  waiting.delete(event.type);
  sentAt.set(event.type, performance.now());
  emit(event);
}

// --- the connection's beginning and end ---

const randomName = () =>
  [...crypto.getRandomValues(new Uint8Array(12))].map((byte) => byte.toString(16).padStart(2, "0")).join("");

// A duplicated tab inherits the storage; so the name is taken out of it while the page is open.
const TAB = "tcfit-tab";
/** This tab's own name, the same after a reload. */
const tabName = sessionStorage.getItem(TAB) ?? randomName();
sessionStorage.removeItem(TAB);
window.addEventListener("pagehide", () => sessionStorage.setItem(TAB, tabName));

const BROWSER = "tcfit-browser";

/** This browser's own name. */
function browserName() {
  const name = remembered(BROWSER) || randomName();
  remember(BROWSER, name);
  return name;
}

/** Bytes of the largest file that the server takes. */
export let largestUpload = Infinity;

/** Starts with an empty page: the first time, and whenever viser has connected again.
 * @param {string} uuid @param {boolean} strip whether there will be a timeline @param {number} largest upload */
export function connect(uuid, strip, largest) {
  largestUpload = largest;
  field = resting = null; // what ends now belongs to a connection that is gone
  greeting = uuid;
  for (const name of /** @type {(keyof Known)[]} */ (Object.keys(states))) receive(name, null);
  eventCount = 0;
  waiting.clear();
  toAcknowledge = null;
  clearTimeout(asking);
  receive("strip", strip); // before the page tells the size of its canvas
  greet(uuid, performance.now() + FOLLOWING);
}

/** @type {string | null} */
let greeting = null; // the field of a connection to which hello is still to be said
const FOLLOWING = 500; // milliseconds that viser's canvas has for following its box

/** Says hello, upon which the first picture comes: in a busy browser it would be drawn on a canvas that still has the
 * strip's room, and then be moved. @param {string} uuid @param {number} end */
function greet(uuid, end) {
  if (greeting !== uuid) return; // that connection is gone
  if (!canvasFits() && performance.now() < end) return void setTimeout(greet, SPACING, uuid, end);
  [field, greeting] = [uuid, null];
  const plots = remembered(ROWS)?.split(",").filter(Boolean).map(decodeURIComponent);
  const about = { browser: browserName(), hinted: remembered(STEPS) !== undefined, plots: plots ?? null };
  emit({ type: "hello", tab: tabName, ...canvasSize(), ...about, dark: isDark() });
}

const ROWS = "tcfit-rows";
watch("rows", (state) => {
  if (state) remember(ROWS, state.rows.map(({ name }) => encodeURIComponent(name)).join(","));
});

const connected = () => (field ?? resting ?? greeting) !== null;

/** Sends nothing until `connect`, because there is no receiver. */
function loseConnection() {
  if (!connected()) return;
  field = resting = greeting = null;
  clearTimeout(silence);
  waiting.clear();
  receive("fit", null); // whether it goes on is not known here
  receive("lost", true);
  asking = setTimeout(askAgain, ASK_AGAIN, false);
}

const ASK_AGAIN = 2000; // milliseconds
let asking = 0; // the timer of that

/** Looks whether there is a server again: one that was started since knows this page only once its link was opened.
 * One that has answered before, and still is not connected, will not be: after many failures browsers hold connections
 * back for seconds, and viser gives each of them up after one. A reloaded page gets through.
 * @param {boolean} answered before */
async function askAgain(answered) {
  const answer = await fetch("/favicon.ico", { cache: "no-store" }).catch(() => null);
  if (connected()) return;
  if (answer?.ok && answered) return location.reload();
  const found = answer?.status === 403 ? "restarted" : true;
  if (states.lost !== found) receive("lost", found);
  asking = setTimeout(askAgain, ASK_AGAIN, answer?.ok === true);
}

const MISSED_BEATS = 4; // after which the server counts as silent
let silence = 0; // the timer of that
/** @type {string | null} */
let resting = null; // `field` while it is

// A tunnel may hang for minutes before the connection ends, and a server may be stopped.
watch("beat", (beat) => {
  clearTimeout(silence);
  if (!beat) return;
  if (resting !== null) {
    [field, resting] = [resting, null];
    receive("lost", null);
    emitSoon({ type: "resized", ...canvasSize() }); // or the theme, while nothing went out
    emit({ type: "theme", dark: isDark() });
  }
  silence = setTimeout(fallSilent, MISSED_BEATS * beat.milliseconds, beat);
});

/** Nothing more goes out but the end of a drag. @param {{ milliseconds: number }} beat */
function fallSilent(beat) {
  if (document.hidden) return void (silence = setTimeout(fallSilent, beat.milliseconds, beat)); // it hears late
  if (field === null) return;
  waiting.clear();
  receive("lost", "silent");
  [field, resting] = [null, field];
}

onOtherConnection(loseConnection);

onOtherTheme(() => {
  emit({ type: "theme", dark: isDark() });
  for (const name of /** @type {const} */ (["marks", "keyframes", "suspicions"])) receive(name, states[name]);
  invalidate("timeline", "overlay");
});

new ResizeObserver(() => {
  emitSoon({ type: "resized", ...canvasSize() });
  invalidate("overlay");
}).observe(canvas());
