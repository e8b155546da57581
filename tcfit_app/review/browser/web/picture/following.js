// Where points of camera space lie beside the picture: on the side view's plate, or in another view's picture; and what
// of that is seen while the picture is zoomed: what a close-up follows, or else that part of the body which is in the
// picture's window.

/** @import { Box } from "./projection.js" */
/** @import { Poster, SidePlate, View } from "../wire" */
/** @typedef {{ x: number, y: number }} Place from a poster's middle, in image heights */

import { known, states } from "../connection.js";

/** In pixels. @param {Poster} poster */
export const imageHeight = ({ kind }) => (kind === "view" && states.view ? states.view : known("layout")).image[1];

/** @param {readonly number[]} a @param {readonly number[]} b */
export const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);

/** How points of each body, in metres, come onto what is beside the picture, in its pixels.
 * @param {Poster["kind"]} kind @returns {((point: readonly number[]) => [u: number, v: number])[]} */
export function waysBeside(kind) {
  const { bodies, side, view } = states;
  if (kind === "side") return side ? side.shifts.map((_, body) => (point) => onPlate(side, body, point)) : [];
  return view ? (bodies?.bodies ?? []).map(() => (point) => inView(view, point)) : [];
}

/** @param {SidePlate} side @param {number} body @param {readonly number[]} point @returns {[u: number, v: number]} */
function onPlate({ plate, shifts }, body, point) {
  const [across, down] = plate;
  return [dot(across, point) + shifts[body][0], dot(down, point) + shifts[body][1]];
}

/** @param {View} view @param {readonly number[]} point @returns {[u: number, v: number]} */
function inView({ turn, place, camera: [fx, fy, cx, cy] }, point) {
  const [x, y, z] = turn.map((row, axis) => dot(row, point) + place[axis]);
  return [(fx * x) / z + cx, (fy * y) / z + cy];
}

const BLUR = 0.15; // of the window's height: how far from its middle a keypoint counts
/** @type {{ key: string, middle: Place } | null} */
let last = null;

/** The place beside the picture that is in the middle of its window. It stays while the same is looked at: else
 * the plate would move under a pointer that drags something on it.
 * @param {Poster} poster @param {Box} window @param {Place & { scale: number }} seenFrom the picture's middle place */
export function sideMiddle(poster, window, seenFrom) {
  const there = Boolean(waysBeside(poster.kind).length && states.bodies?.bodies.length);
  const followed = Boolean(states.bodies?.bodies.some((body) => body.followed));
  const key = JSON.stringify([poster, window, seenFrom, states.keypoints?.frame, there, followed]);
  if (last?.key !== key) last = { key, middle: found(poster, window, seenFrom) };
  return last.middle;
}

/** @param {Poster} poster @param {Box} window @param {Place & { scale: number }} seenFrom @returns {Place} */
function found(poster, window, seenFrom) {
  const [width, height] = [window.right - window.left, window.bottom - window.top].map((size) => size / seenFrom.scale);
  const middle = followedPlace(poster) ?? meanPlace(poster, seenFrom, BLUR * height) ?? { x: 0, y: seenFrom.y };
  /** As far off the plate's middle as leaves no room beside the plate. @param {number} at @param {number} free */
  const kept = (at, free) => Math.min(Math.max(at, -Math.max(free, 0)), Math.max(free, 0));
  return { x: kept(middle.x, (poster.width - width) / 2), y: kept(middle.y, (1 - height) / 2) };
}

/** Of what a close-up follows, in the middle between the fits. @param {Poster} poster */
function followedPlace(poster) {
  const places = waysBeside(poster.kind).flatMap((way, body) => {
    const point = states.bodies?.bodies[body]?.followed;
    return point ? [placeOnPlate(poster, way(point))] : [];
  });
  /** @param {(place: Place) => number} of */
  const mean = (of) => places.reduce((sum, place) => sum + of(place), 0) / places.length;
  return places.length ? { x: mean(({ x }) => x), y: mean(({ y }) => y) } : null;
}

/** @param {Poster} poster @param {number[]} pixel @returns {Place} */
function placeOnPlate(poster, [u, v]) {
  const height = imageHeight(poster);
  return { x: u / height - poster.width / 2, y: v / height - 0.5 };
}

/** Of the keypoints around the picture's middle, as the fits have them on the plate.
 * @param {Poster} poster @param {Place} seenFrom @param {number} blur in image heights */
function meanPlace(poster, seenFrom, blur) {
  const { bodies, keypoints, layout } = states;
  if (!bodies || !keypoints || !layout) return null;
  const [width, height] = layout.image;
  let [x, y, weights] = [0, 0, 0];
  for (const [body, way] of waysBeside(poster.kind).entries())
    for (const [joint, point] of (bodies.bodies[body]?.points ?? []).entries()) {
      if (!point || !(keypoints.confidence[joint] > 0)) continue;
      const place = placeOnPlate(poster, way(point));
      const [u, v] = keypoints.xy[joint];
      const far = Math.hypot((u - width / 2) / height - seenFrom.x, (v - height / 2) / height - seenFrom.y);
      const weight = Math.exp(-0.5 * (far / blur) ** 2) + 1e-9; // far from all of them: their middle
      x += weight * place.x;
      y += weight * place.y;
      weights += weight;
    }
  return weights ? { x: x / weights, y: y / weights } : null;
}
