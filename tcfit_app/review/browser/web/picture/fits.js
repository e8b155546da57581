// The fits' keypoints in space: where they are in the side view and in 3D, and what can be read off them.

/** @import { PosterMap } from "./projection.js" */
/** @import { Placed } from "./skeleton.js" */
/** @typedef {[x: number, y: number, z: number]} Point in camera space, metres */

import { known, states } from "../connection.js";
import { scenePoint, worldToCanvas } from "../viser/bridge.js";
import { dot, waysBeside } from "./following.js";
import { toScreen } from "./projection.js";

const STEP = 0.01; // metres: short enough for the perspective of 3D to be even

/** @param {number[]} a @param {number[]} b */
const minus = (a, b) => a.map((value, i) => value - b[i]);

/** How points of each body come onto the screen: null for what lies behind the viewer.
 * @param {PosterMap} map of the side view, of another view or of 3D
 * @returns {((point: number[]) => [x: number, y: number] | null)[]} by body */
export function projections(map) {
  const { kind } = map.poster;
  if (kind !== "space") return waysBeside(kind).map((way) => (point) => toScreen(map, way(point)));
  const matrix = worldToCanvas();
  return (states.bodies?.bodies ?? []).map(() => (point) => {
    const { turn, place } = known("space");
    const [right, down, ahead] = turn.map((row, axis) => dot(row, point) + place[axis]);
    const [x, y, depth] = scenePoint(matrix, [right, down, ahead]);
    return Math.abs(depth) < 1 ? [x, y] : null;
  });
}

/** @typedef {(point: number[]) => [x: number, y: number] | null} Project onto the screen */

/** The bones of a body, where both ends are known.
 * @param {readonly (Point | null)[]} points @param {Project} project
 * @param {(a: number, b: number) => boolean} wanted which of them, by their keypoints */
export function bonePath(points, project, wanted) {
  const places = points.map((point) => point && project(point));
  const lines = new Path2D();
  for (const [a, b] of known("skeleton").bones) {
    const [from, to] = [places[a], places[b]];
    if (!from || !to || !wanted(a, b)) continue;
    lines.moveTo(...from);
    lines.lineTo(...to);
  }
  return lines;
}

/** The outline on the screen of an ellipsoid around a point; null where that lies behind the viewer. With the images of
 * its three half axes as columns of M, that is the ellipse of M Mᵀ.
 * @param {(point: number[]) => [number, number] | null} project
 * @param {Point} point
 * @param {readonly [along: number, across: number]} bars half axes along the camera's ray and across it, metres */
export function ellipse(project, point, [along, across]) {
  const centre = project(point);
  const [x, y, z] = unit(point);
  const aside = unit([z, 0, -x]);
  const below = [y * aside[2], z * aside[0] - x * aside[2], -y * aside[0]];
  let [uu, uv, vv] = [0, 0, 0];
  for (const [i, axis] of [[x, y, z], aside, below].entries()) {
    const end = project(point.map((value, k) => value + STEP * axis[k]));
    if (!centre || !end) return null;
    const [u, v] = minus(end, centre).map((pixels) => (pixels * (i ? across : along)) / STEP);
    [uu, uv, vv] = [uu + u * u, uv + u * v, vv + v * v];
  }
  if (!centre) return null;
  const [mean, off] = [(uu + vv) / 2, Math.hypot((uu - vv) / 2, uv)];
  const path = new Path2D();
  const [long, short] = [Math.sqrt(mean + off), Math.sqrt(Math.max(mean - off, 0))];
  path.ellipse(...centre, long, short, Math.atan2(2 * uv, uu - vv) / 2, 0, 2 * Math.PI);
  return path;
}

/** @param {number[]} a */
const unit = (a) => a.map((value) => value / Math.hypot(...a));

/** Keypoints of the fits on the screen. @param {PosterMap} map @param {number[]} joints @returns {Placed[]} */
export function fitPlaces(map, joints) {
  const ways = projections(map);
  return (states.bodies?.bodies ?? []).flatMap(({ points }, body) =>
    joints.flatMap((joint) => {
      const point = points[joint];
      const place = point && ways[body]?.(point);
      return place ? [{ joint, x: place[0], y: place[1], body }] : [];
    }),
  );
}

/** On the screen, for each metre that a keypoint is further from the camera while the picture looks the same; null if
 * it is seen too much from ahead. @param {PosterMap} map @param {number} joint @param {number} body */
export function wayInDepth(map, joint, body) {
  const point = states.bodies?.bodies[body]?.points[joint];
  const project = projections(map)[body];
  const from = point && project?.(point);
  if (!from) return null;
  /** @param {number[]} direction of a length as `point` has ahead, so that nearer ones seem as long */
  const seen = (direction) => {
    const to = project(point.map((value, i) => value + STEP * direction[i]));
    return to ? minus(to, from).map((pixels) => pixels / STEP) : [0, 0];
  };
  const [x, y, z] = point;
  const way = seen([x / z, y / z, 1]);
  const across = Math.max(...[[1, 0, -x / z], [0, 1, -y / z]].map((direction) => Math.hypot(...seen(direction))));
  return Math.hypot(...way) >= LEAST * Math.max(across, 1) ? way : null;
}

const LEAST = 0.4; // share of its length at which a line of sight must be seen for depth to be dragged along it

/** "right wrist  12 cm in front of the pelvis  95 cm above the floor" @param {number} joint @param {number} body */
export function fitLine(joint, body) {
  const { names } = known("skeleton");
  const fit = states.bodies?.bodies[body];
  const points = fit?.points;
  const point = points?.[joint];
  if (!fit || !points || !point) return names[joint];
  const { down, floor } = known("bodies");
  const parts = [names[joint]];
  const depth = centimetres(point[2] - fit.pelvis);
  parts.push(`${Math.abs(depth)} cm ${depth < 0 ? "in front of" : "behind"} the pelvis`); // as edits of depth say it
  const height = centimetres(floor - dot(down, point));
  parts.push(`${Math.abs(height)} cm ${height < 0 ? "below" : "above"} the floor`);
  const bars = fit.error_bars[joint];
  if (bars) parts.push(`± ${centimetres(bars[0])} cm in depth, ± ${centimetres(bars[1])} cm across`);
  return parts.join("\n");
}

/** @param {number} metres */
const centimetres = (metres) => Math.round(100 * metres);
