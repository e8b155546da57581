// From image pixels of a poster to CSS pixels of the canvas, by viser's own camera.

/** @import { Matrix4 } from "../viser/internals" */
/** @import { Poster } from "../wire" */

import { states } from "../connection.js";
import { canvasPoint, canvasSize, worldToCanvas } from "../viser/bridge.js";
import { imageHeight, sideMiddle } from "./following.js";

/** @typedef {{ left: number, top: number, right: number, bottom: number }} Box in CSS pixels of the canvas */
/**
 * Where its image's corner is on the canvas and how large its pixels are (a poster faces the camera), its size, its
 * window, and what is seen of that: all but what is across the divider.
 * @typedef {{ ox: number, oy: number, pixel: number, width: number, height: number,
 *   window: Box, seen: Box, poster: Omit<Poster, "kind"> & { kind: Poster["kind"] | "space" } }} PosterMap
 */

/** @type {PosterMap["poster"]} */
const ROOM = {
  node: "", window: [0, 0, 1, 1], width: 0, kind: "space", clipped: false, label: "", color: null,
};

/** Where A ends and B begins, as a share of their window's width. */
export const divider = { share: 0.5 };

/** One for each poster; in 3D one for the whole canvas, whose pixels are CSS pixels. @returns {PosterMap[]} */
export function posterMaps() {
  const layout = states.layout;
  const canvas = canvasSize();
  if (layout?.mode === "space") {
    const window = { left: 0, top: 0, right: canvas.width, bottom: canvas.height };
    return [{ ox: 0, oy: 0, pixel: 1, ...canvas, window, seen: window, poster: ROOM }];
  }
  if (!layout) return [];
  const matrix = worldToCanvas();
  const [x, y] = canvasPoint(matrix, [0, 0, 0]);
  const scale = canvasPoint(matrix, [1, 0, 0])[0] - x; // of an image's height
  const { focus } = states;
  const [width, height] = layout.image;
  const [followedX, followedY] = focus ? [(focus.x - width / 2) / height, (focus.y - height / 2) / height] : [0, 0];
  const seenFrom = {
    x: (canvas.width / 2 - x) / scale + followedX, y: (canvas.height / 2 - y) / scale + followedY, scale,
  };
  return layout.posters.map((poster, i) => {
    const window = windowOf(poster, canvas);
    const { x: u, y: v } = ["side", "view"].includes(poster.kind) ? sideMiddle(poster, window, seenFrom) : seenFrom;
    const across = poster.width * scale;
    const ox = (window.left + window.right) / 2 - u * scale - across / 2;
    const oy = (window.top + window.bottom) / 2 - v * scale - scale / 2;
    const seen = layout.wipe && poster.kind === "picture" ? besideDivider(window, i) : window;
    return { ox, oy, pixel: scale / imageHeight(poster), width: across, height: scale, window, seen, poster };
  });
}

/** @param {Poster} poster @param {{ width: number, height: number }} canvas @returns {Box} */
function windowOf({ window: [left, top, right, bottom] }, { width, height }) {
  return { left: left * width, top: top * height, right: right * width, bottom: bottom * height };
}

/** @param {Box} window @param {number} i which of the two pictures @returns {Box} */
function besideDivider(window, i) {
  const x = window.left + divider.share * (window.right - window.left);
  return i === 0 ? { ...window, right: x } : { ...window, left: x };
}

/** The part of a poster's plate that its window shows. @param {PosterMap} map @returns {Box} */
export const plateSeen = ({ seen, ox, oy, width, height }) => ({
  left: Math.max(seen.left, ox),
  top: Math.max(seen.top, oy),
  right: Math.min(seen.right, ox + width),
  bottom: Math.min(seen.bottom, oy + height),
});

/** @param {Box} box @param {{ x: number, y: number }} place */
export const inBox = ({ left, top, right, bottom }, { x, y }) => x >= left && x <= right && y >= top && y <= bottom;

/** The posters' maps as they were drawn last: what the pointer meets. */
export const drawn = { maps: /** @type {PosterMap[]} */ ([]) };

/** @param {PosterMap} map @param {number[]} pixel @returns {[x: number, y: number]} */
export const toScreen = ({ ox, oy, pixel }, [x, y]) => [ox + pixel * x, oy + pixel * y];

/** @param {PosterMap} map @param {number} x @param {number} y @returns {[u: number, v: number]} */
export const toImage = ({ ox, oy, pixel }, x, y) => [(x - ox) / pixel, (y - oy) / pixel];

/** @type {{ matrix: Matrix4, width: number, height: number } | null} */
let lastView = null;

/** Where a poster's middle lies in viser's world when it is drawn there.
 * @param {PosterMap} map @returns {[x: number, y: number]} */
export function placeInWorld(map) {
  const [x, y] = canvasPoint(worldToCanvas(), [0, 0, 0]);
  return [(map.ox + map.width / 2 - x) / map.height, (map.oy + map.height / 2 - y) / map.height];
}

/** Whether the camera or the canvas is another than when this was last asked. */
export function viewChanged() {
  const view = { matrix: worldToCanvas(), ...canvasSize() };
  const last = lastView;
  lastView = view;
  return !last || !view.matrix.equals(last.matrix) || view.width !== last.width || view.height !== last.height;
}
