// From image pixels of a poster to CSS pixels of the canvas, by viser's own camera.

/** @import { Matrix4 } from "../viser/internals" */
/** @import { Poster } from "../wire" */

import { states } from "../connection.js";
import { canvasPoint, canvasSize, worldToCanvas } from "../viser/bridge.js";

/**
 * The affine map (a poster faces the camera) from its image's pixels to CSS pixels.
 * @typedef {{ ox: number, oy: number, ux: number, uy: number, vx: number, vy: number, height: number,
 *   poster: Poster }} PosterMap
 */

/** One for each poster. @returns {PosterMap[]} */
export function posterMaps() {
  const layout = states.layout;
  if (layout?.mode !== "poster") return [];
  const [width, height] = layout.image;
  const matrix = worldToCanvas();
  return layout.posters.map((poster) => {
    /** @param {number} u @param {number} v */
    const corner = (u, v) =>
      canvasPoint(matrix, [(u - width / 2) / height + poster.x, (v - height / 2) / height, 0]);
    const [ox, oy] = corner(0, 0);
    const [rx, ry] = corner(width, 0);
    const [bx, by] = corner(0, height);
    const [ux, uy, vx, vy] = [(rx - ox) / width, (ry - oy) / width, (bx - ox) / height, (by - oy) / height];
    return { ox, oy, ux, uy, vx, vy, height: by - oy, poster };
  });
}

/** The posters' maps as they were drawn last: what the pointer meets. */
export const drawn = { maps: /** @type {PosterMap[]} */ ([]) };

/** @param {PosterMap} map @param {number[]} pixel @returns {[x: number, y: number]} */
export const toScreen = (map, [x, y]) => [map.ox + map.ux * x + map.vx * y, map.oy + map.uy * x + map.vy * y];

/** @param {PosterMap} map @param {number} x @param {number} y @returns {[u: number, v: number]} */
export function toImage(map, x, y) {
  const [dx, dy] = [x - map.ox, y - map.oy];
  const area = map.ux * map.vy - map.uy * map.vx;
  return [(dx * map.vy - dy * map.vx) / area, (dy * map.ux - dx * map.uy) / area];
}

/** @type {{ matrix: Matrix4, width: number, height: number } | null} */
let lastView = null;

/** Whether the camera or the canvas is another than when this was last asked. */
export function viewChanged() {
  const view = { matrix: worldToCanvas(), ...canvasSize() };
  const last = lastView;
  lastView = view;
  return !last || !view.matrix.equals(last.matrix) || view.width !== last.width || view.height !== last.height;
}
