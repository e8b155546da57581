// Where points of camera space lie on the side view's plate; and what of it is seen while the picture is zoomed: what a
// close-up follows, or else that part of the body which is in the picture's window.

/** @import { Box } from "./projection.js" */
/** @import { Poster, SidePlate } from "../wire" */
/** @typedef {{ x: number, y: number }} Place from a poster's middle, in image heights */

import { states } from "../connection.js";

/** @param {readonly number[]} a @param {readonly number[]} b */
export const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);

/** In its pixels. @param {SidePlate} side @param {number} body @param {readonly number[]} point in metres
 * @returns {[u: number, v: number]} */
export function onPlate({ plate, shifts }, body, point) {
  const [across, down] = plate;
  return [dot(across, point) + shifts[body][0], dot(down, point) + shifts[body][1]];
}

const BLUR = 0.15; // of the window's height: how far from its middle a keypoint counts
/** @type {{ key: string, middle: Place } | null} */
let last = null;

/** The place on the side view's plate that is in the middle of its window. It stays while the same is looked at: else
 * the plate would move under a pointer that drags something on it.
 * @param {Poster} poster @param {Box} window @param {Place & { scale: number }} seenFrom the picture's middle place */
export function sideMiddle(poster, window, seenFrom) {
  const there = Boolean(states.side?.shifts.length && states.bodies?.bodies.length);
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
  const { bodies, side, layout } = states;
  if (!side || !layout) return null;
  const places = side.shifts.flatMap((_, body) => {
    const point = bodies?.bodies[body]?.followed;
    return point ? [placeOnPlate(poster, onPlate(side, body, point), layout.image[1])] : [];
  });
  /** @param {(place: Place) => number} of */
  const mean = (of) => places.reduce((sum, place) => sum + of(place), 0) / places.length;
  return places.length ? { x: mean(({ x }) => x), y: mean(({ y }) => y) } : null;
}

/** @param {Poster} poster @param {number[]} pixel @param {number} height of the image @returns {Place} */
const placeOnPlate = (poster, [u, v], height) => ({ x: u / height - poster.width / 2, y: v / height - 0.5 });

/** Of the keypoints around the picture's middle, as the fits have them on the plate.
 * @param {Poster} poster @param {Place} seenFrom @param {number} blur in image heights */
function meanPlace(poster, seenFrom, blur) {
  const { bodies, keypoints, side, layout } = states;
  if (!bodies || !keypoints || !side || !layout) return null;
  const [width, height] = layout.image;
  let [x, y, weights] = [0, 0, 0];
  for (const [body] of side.shifts.entries())
    for (const [joint, point] of (bodies.bodies[body]?.points ?? []).entries()) {
      if (!point || !(keypoints.confidence[joint] > 0)) continue;
      const place = placeOnPlate(poster, onPlate(side, body, point), height);
      const [u, v] = keypoints.xy[joint];
      const far = Math.hypot((u - width / 2) / height - seenFrom.x, (v - height / 2) / height - seenFrom.y);
      const weight = Math.exp(-0.5 * (far / blur) ** 2) + 1e-9; // far from all of them: their middle
      x += weight * place.x;
      y += weight * place.y;
      weights += weight;
    }
  return weights ? { x: x / weights, y: y / weights } : null;
}
