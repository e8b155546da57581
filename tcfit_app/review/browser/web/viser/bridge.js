// The one door to viser's page. viser has no API for scripts in its page, so what we need of it is its insides: this
// folder is all that touches them, and `missingParts` says which of them are not as expected.

/** @import { Matrix4, Mesh, Viewer } from "./internals" */

import { FONT } from "../style.js";

/** Of viser, whose insides these are. */
export const KNOWN_VERSION = "1.1.x";

/** Elements of viser's panels, as CSS selectors. */
export const TEXT_INPUT = "input.mantine-TextInput-input";
export const NUMBER_INPUT = "input.mantine-NumberInput-input";
export const DROPDOWN_INPUT = "input[aria-haspopup=listbox]";
/** Of messages and windows, without a name yet. */
export const CLOSE_BUTTON = ":is(.mantine-Notification-closeButton, .mantine-Modal-close):not([aria-label])";
/** The label beside a field. */
export const FIELD_LABEL = 'div[style*="flex-shrink: 0"]:has(> p > label)';
export const WINDOW_SURROUNDINGS = ".mantine-Modal-inner, .mantine-Modal-overlay";

/** How viser's own elements look here. With :has() only below a class or a tag: what may have anything in it has the
 * styles of the whole page worked out again for each element that comes or goes, in 8 ms. */
export const VISER_SHEET = `
.tcfit-lost .mantine-Modal-root { display: none; }
.tcfit-lost .mantine-Paper-root:not(.mantine-Paper-root *) { opacity: 0.45; pointer-events: none; }
.mantine-ScrollArea-content { padding-right: 4px; }
.mantine-Button-root:has(.icon-tabler-upload) { border: 1px solid var(--tcfit-edge) !important; border-radius: 4px; font: 13px/1 ${FONT} !important;
  background: var(--tcfit-button) !important; color: var(--tcfit-text) !important; }
.mantine-Button-root:has(.icon-tabler-upload):hover:not(:disabled) { background: var(--tcfit-raised) !important; }
.mantine-Button-root:has(.icon-tabler-upload):disabled { opacity: 0.42; }
.mantine-Notification-description { overflow-wrap: anywhere; color: var(--tcfit-text) !important; }
.mantine-Paper-root[data-with-border]:has(> :nth-child(2)[aria-hidden=true]) { border-color: transparent; background: none; }
.mantine-Modal-content:has(.tcfit-keys) { flex: 0 1 1160px !important; max-height: 94vh !important; }
.mantine-Modal-header:has(+ .mantine-Modal-body .tcfit-keys) { padding-bottom: 0 !important; min-height: 0 !important; }
.mantine-Slider-markLabel { display: none; }
button:has(svg[class*="tabler-icon-adjustments"]), svg[class*="tabler-icon-cloud"] { display: none !important; }
button[aria-label="Commands"] { width: auto !important; padding: 0 5px; color: var(--tcfit-text) !important; }
[role=tab][aria-selected=true], [role=tab][aria-selected=true] * { color: var(--tcfit-accent) !important; }
button[aria-label="Commands"]::after { content: "Commands"; margin-left: 5px; font-size: 13px; }
${FIELD_LABEL} { width: 112px !important; padding-right: 4px; }
${FIELD_LABEL} > p { font-size: 13px !important; letter-spacing: 0 !important; }
:is(${TEXT_INPUT}, ${NUMBER_INPUT}, ${DROPDOWN_INPUT}) { font-size: 13px !important; letter-spacing: 0 !important; }
:is(${TEXT_INPUT}, ${NUMBER_INPUT}, ${DROPDOWN_INPUT}):disabled { opacity: 0.45 !important; }
${FIELD_LABEL} label { font-family: ${FONT}; color: var(--tcfit-dim); }
`;

/** viser's own references and functions; for this folder alone. */
export const viewer = () => window.__viserMutable;

/** @param {unknown} value */
const isFunction = (value) => typeof value === "function";

/** What must be there, and how to tell. @type {[name: string, present: (viser: Viewer) => unknown][]} */
const PARTS = [
  ["canvas", ({ canvas }) => canvas instanceof HTMLCanvasElement && boxOf(canvas)],
  ["camera", ({ camera }) => isFunction(camera.projectionMatrix.multiply) && isFunction(camera.position.applyMatrix4)],
  ["camera.matrixWorldInverse", ({ camera }) => camera.matrixWorldInverse.elements.length === 16],
  ["cameraControl", (viser) => "cameraControl" in viser],
  ["scene", ({ scene }) => isFunction(scene.__r3f?.root.getState().invalidate)],
  ["nodeRefFromName", ({ nodeRefFromName }) => nodeRefFromName[""]?.matrixWorld.elements.length === 16],
  ["nodeRefFromName.position", ({ nodeRefFromName }) => isFunction(nodeRefFromName[""]?.position.set)],
  ["scene.gl", ({ scene }) => isFunction(scene.__r3f?.root.getState().gl.setScissor)],
  ["messageQueue", ({ messageQueue }) => Array.isArray(messageQueue)],
  ["drainMessageQueue", (viser) => "drainMessageQueue" in viser],
  ["getRenderRequestState", (viser) => typeof viser.getRenderRequestState === "string"],
  ["requestRender", (viser) => isFunction(viser.requestRender)],
  ["sendMessage", (viser) => isFunction(viser.sendMessage)],
  ["syncCanvasSize", (viser) => "syncCanvasSize" in viser],
];

/** Names of what this viser lacks of what tcfit needs. */
export function missingParts() {
  const viser = viewer();
  if (!viser) return ["__viserMutable"];
  return PARTS.filter(([, present]) => !holds(() => present(viser))).map(([name]) => name);
}

/** @param {() => unknown} claim */
function holds(claim) {
  try {
    return Boolean(claim());
  } catch {
    return false; // it looked into something that is not there
  }
}

// --- the canvas ---

export const canvas = () => viewer().canvas;

/** In CSS pixels. */
export function canvasSize() {
  // The canvas itself follows its box some frames later.
  return { width: canvas().clientWidth, height: Math.min(canvas().clientHeight, canvasBox().clientHeight) };
}

/** Whether the canvas has followed its box. */
export const canvasFits = () => Math.abs(canvas().clientHeight - canvasBox().clientHeight) <= 1;

/**
 * viser's box around its canvas: a stacking context, so what is put into it stays below panels and messages.
 * @param {HTMLCanvasElement} inner
 */
function boxOf(inner) {
  for (let box = inner.parentElement; box; box = box.parentElement) if (box.style.zIndex === "0") return box;
  return inner.parentElement;
}

export const canvasBox = () => /** @type {HTMLElement} */ (boxOf(canvas()));

let room = 0;

/** Leaves CSS pixels free above and below the canvas. @param {number} above @param {number} below */
export function leaveRoom(above, below) {
  room = above + below;
  Object.assign(canvasBox().style, { top: `${above}px`, height: `calc(100% - ${room}px)` });
}

/** While a docked panel is resized viser sets its canvas's size by itself, from the room that it knows of. */
export function correctCanvasSize() {
  const usual = viewer().syncCanvasSize;
  if (usual) viewer().syncCanvasSize = (width, height) => usual(width, height - room);
}

// --- the connection ---

/** Whether `sendText` works even where other parts are missing. */
export const canSend = () => isFunction(viewer()?.sendMessage);

/** Sends a text to the server as the value of a text field. @param {string} field viser's id @param {string} value */
export const sendText = (field, value) =>
  viewer().sendMessage({ type: "GuiUpdateMessage", ...{ uuid: field, updates: { value } } });

/**
 * Calls back when viser's connection has ended, and when another has begun: viser then gives itself another function to
 * send with, and tells in no other way.
 * @param {() => void} change
 */
export function onOtherConnection(change) {
  let send = viewer().sendMessage;
  Object.defineProperty(viewer(), "sendMessage", {
    configurable: true,
    enumerable: true,
    get: () => send,
    set(next) {
      send = next;
      change();
    },
  });
}

// --- the scene and its camera ---

/** Has viser draw its scene soon. */
export const redrawScene = () => viewer().requestRender();

/** Calls back right before each drawing of the scene, where everything has its place. @param {() => void} change */
export function beforeSceneDrawn(change) {
  viewer().scene.onBeforeRender = (_renderer, _scene, camera) => {
    if (camera === viewer().camera) change();
  };
}

/** Calls back right after each drawing of the scene. @param {() => void} change */
export function onSceneDrawn(change) {
  viewer().scene.onAfterRender = (_renderer, _scene, camera) => {
    if (camera === viewer().camera) change();
  };
}

/** From viser's world (which three.js turns so that its upward axis is up) to the canvas, each -1 to 1. */
export function worldToCanvas() {
  const { camera, nodeRefFromName } = viewer();
  const matrix = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse);
  const root = nodeRefFromName[""];
  return root ? matrix.multiply(root.matrixWorld) : matrix;
}

/**
 * A point of the world in CSS pixels of the canvas.
 * @param {Matrix4} matrix of `worldToCanvas`
 * @param {[x: number, y: number, z: number]} point
 * @returns {[x: number, y: number]}
 */
export function canvasPoint(matrix, point) {
  const [x, y] = scenePoint(matrix, point);
  return [x, y];
}

/**
 * The same, and its depth: between -1 and 1 if it lies ahead of the viewer, neither too near nor too far.
 * @param {Matrix4} matrix of `worldToCanvas`
 * @param {[x: number, y: number, z: number]} point
 * @returns {[x: number, y: number, depth: number]}
 */
export function scenePoint(matrix, point) {
  const { width, height } = canvasSize();
  const { x, y, z } = viewer().camera.position.clone().set(...point).applyMatrix4(matrix);
  return [((x + 1) / 2) * width, ((1 - y) / 2) * height, z];
}

/** @type {{ mouse: { [button: string]: number }, touch: { [fingers: string]: number }, cursor: boolean } | null} */
let usual = null; // viser's own way with buttons and fingers

/** Whether the camera only pans and zooms: no left button turns it, and the wheel zooms where the pointer is.
 * @param {boolean} flat */
export function keepCameraFlat(flat) {
  const control = viewer().cameraControl;
  if (!control) return;
  usual ??= { mouse: { ...control.mouseButtons }, touch: { ...control.touches }, cursor: control.dollyToCursor };
  const { mouse, touch, cursor } = usual;
  Object.assign(control.mouseButtons, mouse, flat ? { left: 0, middle: mouse.right } : {});
  Object.assign(control.touches, touch, flat ? { one: touch.three } : {});
  control.dollyToCursor = flat || cursor;
}

/** Where the wheel is turned over the canvas, viser takes the pointer to be elsewhere.
 * @param {(event: WheelEvent) => { x: number, y: number } | null} place CSS pixels of the canvas; null: where it is */
export function moveWheel(place) {
  window.addEventListener("wheel", (event) => {
    if (!event.isTrusted || event.target !== canvas()) return;
    const there = place(event);
    if (!there) return;
    event.preventDefault();
    event.stopPropagation();
    const { left, top } = canvas().getBoundingClientRect();
    const { deltaX, deltaY, deltaMode, ctrlKey, shiftKey, altKey, metaKey } = event;
    const turn = { deltaX, deltaY, deltaMode, ctrlKey, shiftKey, altKey, metaKey, bubbles: true, cancelable: true };
    canvas().dispatchEvent(new WheelEvent("wheel", { ...turn, clientX: left + there.x, clientY: top + there.y }));
  }, { capture: true, passive: false });
}

/** A node of the scene, if it is there. @param {string} name */
export const nodeOf = (name) => viewer().nodeRefFromName[name] ?? null;

/** The mesh of a node of the scene, if it is there. @param {string} name @returns {Mesh | null} */
export function meshOf(name) {
  /** @type {Mesh | null} */
  let found = null;
  viewer().nodeRefFromName[name]?.traverse((child) => (found ??= child.isMesh ? child : null));
  return found;
}
