// Which keypoint the pointer means: hovering, clicking, and choosing several with a rectangle.

import { invalidate, states } from "../connection.js";
import { canvas } from "../viser/bridge.js";
import { drawn, toScreen } from "./projection.js";
import { groupOf, position, shownJoints } from "./skeleton.js";

export const REACH = 12; // CSS pixels
export const TOUCH_REACH = 24;
// CSS pixels: where they lie together the body's is meant rather than a hand's or the face's.
const RANK_HANDICAP = 1.5;

/** @typedef {{ x: number, y: number }} Place in CSS pixels of the canvas */
/** @typedef {{ joint: number, poster: number }} Found a keypoint, and in which of the posters it was met */
/**
 * A press of the left button.
 * @typedef {Place & { x0: number, y0: number, pointer: number,
 *   kind: "press" | "drag" | "marquee" | "empty" | "toggled",
 *   found: Found | null, anchor: [u: number, v: number] | null }} Gesture
 */

export const pointer = {
  /** @type {Place | null} */
  place: null, // over the canvas
  /** @type {Gesture | null} */
  gesture: null,
  /** @type {Found | null} */
  hovered: null,
};

/** The nearest keypoint on show, of all posters. @param {Place | null} place @param {number} reach */
export function pick(place, reach) {
  /** @type {(Found & { score: number }) | null} */
  let best = null;
  if (!place) return best;
  for (const joint of shownJoints())
    for (const [poster, map] of drawn.maps.entries()) {
      const [x, y] = toScreen(map, position(joint));
      const distance = Math.hypot(x - place.x, y - place.y);
      const score = distance + RANK_HANDICAP * groupOf[joint];
      if (distance <= reach && (!best || score < best.score)) best = { joint, poster, score };
    }
  return best;
}

/** Keypoints within a gesture's rectangle, in any poster. @param {Gesture} gesture */
export function within({ x0, y0, x, y }) {
  /** @param {number[]} point */
  const inside = ([px, py]) => (px - x0) * (px - x) <= 0 && (py - y0) * (py - y) <= 0;
  return shownJoints().filter((joint) => drawn.maps.some((map) => inside(toScreen(map, position(joint)))));
}

/** Of an event, over the canvas. @param {MouseEvent} event @returns {Place} */
export function canvasPlace(event) {
  const { left, top } = canvas().getBoundingClientRect();
  return { x: event.clientX - left, y: event.clientY - top };
}

/** @param {Event} event */
export const overPoster = (event) => event.target === canvas() && states.layout?.mode === "poster";

/** @param {PointerEvent} event */
function hover(event) {
  const now = overPoster(event) && event.pointerType !== "touch" && event.buttons === 0 ? canvasPlace(event) : null;
  if (!now && !pointer.place) return;
  pointer.place = now;
  invalidate("overlay");
}

window.addEventListener("pointermove", hover, true);
document.documentElement.addEventListener("pointerleave", hover);
