// What viser's meshes cannot do: pictures that are shown at once, colours at vertices, clean transparency, dark plates,
// windows of their own.

/** @import { Mesh, Renderer, Texture } from "./internals" */

import { canvas, meshOf, nodeOf, redrawScene } from "./bridge.js";

// --- pictures ---
//
// viser hands the bytes to an <img>, and so to a later frame than the body's. We hang decoded pictures into its nodes.

/** @type {Map<string, Texture>} */
const textures = new Map(); // by name of a node: ours
/** @type {Map<string, Texture | null | undefined>} */
const yielded = new Map(); // by name of a node: its texture when viser was given a picture, which it then replaces

/** viser shows the next picture of a node itself. @param {string} name */
const leaveToViser = (name) => yielded.set(name, meshOf(name)?.material.map);

/** viser shows the next picture of each node itself. */
export const leavePicturesToViser = () => [...textures.keys()].forEach(leaveToViser);

/** Shows a picture in a node; false if viser must do it, for it has one of its own still to come there.
 * @param {string} name @param {ImageBitmap | null} bitmap */
export function hangPicture(name, bitmap) {
  const material = meshOf(name)?.material;
  if (bitmap && material?.map && material.map !== yielded.get(name)) {
    material.map = textureOf(name, bitmap, material.map);
    return true;
  }
  bitmap?.close();
  leaveToViser(name);
  return false;
}

/** A node's own texture with that picture in it, made like another one.
 * @param {string} name @param {ImageBitmap} bitmap @param {Texture} model */
function textureOf(name, bitmap, model) {
  let texture = textures.get(name);
  const size = texture?.image.width === bitmap.width && texture.image.height === bitmap.height;
  const generateMipmaps = shrinks(name, bitmap);
  const same = size && texture?.generateMipmaps === generateMipmaps;
  texture?.image.close();
  if (!texture || !same) {
    texture?.dispose(); // the graphics card keeps the size that it was given first
    /** @type {Texture} */
    const made = new /** @type {any} */ (model).constructor();
    const minFilter = generateMipmaps ? made.minFilter : made.magFilter;
    texture = Object.assign(made, { colorSpace: model.colorSpace, flipY: false, generateMipmaps, minFilter });
    textures.set(name, texture);
  }
  return Object.assign(texture, { image: bitmap, needsUpdate: true });
}

/** Whether a picture is drawn so much smaller that it would shimmer without smaller copies, which take a tenth of a
 * seek where the processor makes them. @param {string} name @param {ImageBitmap} bitmap */
const shrinks = (name, bitmap) => !name.startsWith("/posters/") || bitmap.width > canvas().width;

// --- how a mesh is drawn ---

/**
 * What the server wishes for a node's mesh.
 * @typedef {object} Dress
 * @property {[lines: string | null, opacities: string | null] | null} [colors] by vertex, one byte each, in base64:
 *   lines of the colour table, null for white, and shares of the opacity, null for all of it
 * @property {boolean | "ghost"} [front] whether it hides its own far side although it is transparent; a ghost hides
 *   nothing else
 * @property {boolean} [nothing] whether it is not drawn, but hides what is behind it
 * @property {boolean} [last] draw it after the bodies
 * @property {boolean} [dark] draw it dark, and not white, until its first picture is there
 */

/** @type {number[]} */
let table = []; // linear red, green, blue, 0 to 1, one after the other
/** @type {{ [name: string]: Dress }} */
const wishes = {};
/** @type {{ [wish: string]: (mesh: Mesh, dress: Dress) => void }} */
const PARTS = {
  colors: paint, front: cover, nothing: empty, last: (mesh) => void (mesh.renderOrder = 3),
  dark: (mesh, { dark }) => void (mesh.userData.tcfitDark = dark),
};
const TRIES = 1000; // for a mesh that viser has not made yet
const SPACING = 5; // ms between them

/** The colours that `dress` means. @param {number[]} colors */
export const setColorTable = (colors) => void (table = colors);

/** Changes how a node's mesh is drawn, as soon as it is there. @param {string} name @param {Dress} wish */
export function dress(name, wish) {
  wishes[name] = { ...wishes[name], ...wish };
  dressMesh(name, wish, TRIES);
}

/** @param {string} name @param {Dress} wish @param {number} tries */
function dressMesh(name, wish, tries) {
  const mesh = meshOf(name);
  if (!mesh) return void (tries && setTimeout(dressMesh, SPACING, name, wish, tries - 1));
  hookOf(mesh);
  const now = /** @type {{ [part: string]: unknown }} */ (wishes[name]);
  for (const [part, value] of Object.entries(wish)) if (now[part] === value) PARTS[part](mesh, wish);
  redrawScene();
}

/** viser's own way to colours at vertices is a GLB file, built and parsed for each frame; this adds an attribute.
 * @param {Mesh} mesh @param {Dress} dress */
function paint(mesh, { colors }) {
  const old = mesh.userData.tcfitColors;
  mesh.userData.tcfitColors = null;
  if (!colors) return;
  const [lines, opacities] = colors.map((text) => text && atob(text));
  const count = (lines ?? opacities ?? "").length;
  const mixed = old?.length === 4 * count ? old : new Float32Array(4 * count);
  for (let i = 0; i < count; i++) {
    for (let k = 0; k < 3; k++) mixed[4 * i + k] = lines ? table[3 * lines.charCodeAt(i) + k] : 1;
    mixed[4 * i + 3] = opacities ? opacities.charCodeAt(i) / 255 : 1;
  }
  const { attributes } = mesh.geometry;
  if (attributes.color?.array === mixed) attributes.color.needsUpdate = true;
  else mesh.geometry.setAttribute("color", new /** @type {any} */ (attributes.position).constructor(mixed, 4));
  mesh.userData.tcfitColors = mixed;
}

/** A browser blends triangles in the order in which they are listed, so that the back of an arm may shine through its
 * front. Drawn into the depth buffer first, the mesh lets only its nearest surface through.
 * @param {Mesh} mesh @param {Dress} dress */
function cover(mesh, { front }) {
  const depth = mesh.userData.tcfitDepth ?? (front && depthOnly(mesh));
  if (!depth) return;
  depth.visible = Boolean(front);
  [depth.renderOrder, mesh.renderOrder] = front === "ghost" ? [3, 4] : [1, 2];
}

/** After the picture behind it, and before the lines that it hides. @param {Mesh} mesh @param {Dress} dress */
function empty(mesh, { nothing }) {
  mesh.userData.tcfitNothing = nothing;
  mesh.renderOrder = nothing || mesh.userData.tcfitDark === undefined ? 2 : 0; // a picture is behind the bodies again
}

/** @param {Mesh} mesh @returns {Mesh} */
function depthOnly(mesh) {
  const depth = new /** @type {any} */ (mesh).constructor(mesh.geometry, mesh.material.clone());
  Object.assign(depth.material, { colorWrite: false, transparent: true, vertexColors: false });
  depth.raycast = () => {};
  mesh.parent?.add(depth);
  return (mesh.userData.tcfitDepth = depth);
}

/** @typedef {{ left: number, top: number, right: number, bottom: number }} Box in CSS pixels of the canvas */
/** @typedef {{ window: Box | null }} Hook how a mesh is drawn: only in a window, if it has one */

/** @param {Mesh} mesh @returns {Hook} */
function hookOf(mesh) {
  if (mesh.userData.tcfitHook) return mesh.userData.tcfitHook;
  /** @type {Hook} */
  const hook = { window: null };
  // viser makes a new material when the opacity changes, so it is looked at before each drawing.
  mesh.onBeforeRender = (renderer) => {
    prepare(mesh);
    if (hook.window) cutOff(renderer, hook.window);
  };
  mesh.onAfterRender = (renderer) => {
    if (hook.window) renderer.setScissorTest(false);
  };
  return (mesh.userData.tcfitHook = hook);
}

/** @param {Renderer} renderer @param {Box} window */
function cutOff(renderer, { left, top, right, bottom }) {
  renderer.setScissor(left, canvas().clientHeight - bottom, Math.max(right - left, 0), Math.max(bottom - top, 0));
  renderer.setScissorTest(true);
}

/** @param {Mesh} mesh */
function prepare({ geometry, material, userData }) {
  if (userData.tcfitDark) {
    const pictured = Boolean(material.map);
    material.color.setScalar(pictured ? 1 : 0.02);
    // A material that was drawn before its picture came may have been compiled without one: it would stay white.
    if (material.userData.tcfitPictured !== pictured) material.needsUpdate = true;
    material.userData.tcfitPictured = pictured;
    material.transparent = false; // drawn before what hides its part of an outline
  }
  if (userData.tcfitNothing !== undefined) material.colorWrite = !userData.tcfitNothing;
  const on = 3 * (userData.tcfitColors?.length ?? 0) === 4 * geometry.attributes.position.array.length;
  if (material.vertexColors !== on) Object.assign(material, { vertexColors: on, needsUpdate: true });
}

// --- windows ---
//
// Posters have windows on viser's one canvas: each is moved into its own right before the scene is drawn, and nothing
// of it is drawn outside.

/** Draws a node in a window. @param {string} name @param {[x: number, y: number]} place its own, in viser's world
 * @param {Box} window */
export function drawInWindow(name, [x, y], window) {
  const node = nodeOf(name);
  if (!node) return;
  node.position.set(x, y, 0);
  node.updateMatrixWorld(true);
  node.traverse((child) => {
    if (child.isMesh) hookOf(child).window = window;
  });
}
