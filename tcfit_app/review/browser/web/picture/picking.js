// Which keypoint the pointer means: hovering, clicking, choosing several with a rectangle, and menus by right click.

/** @import { PosterMap } from "./projection.js" */

import { invalidate, known, states } from "../connection.js";
import { onRightClick, openMenu } from "../menu.js";
import { canvas } from "../viser/bridge.js";
import { drawn, inBox } from "./projection.js";
import { chosen, groupOf, isFilmed, isPicture, placedOn, select, skeletonReady } from "./skeleton.js";

export const REACH = 12; // CSS pixels
export const TOUCH_REACH = 24;
// CSS pixels: where they lie together the body's is meant rather than a hand's or the face's.
const RANK_HANDICAP = 1.5;

/** @typedef {{ x: number, y: number }} Place in CSS pixels of the canvas */
/** @typedef {{ joint: number, poster: number, body: number }} Found a keypoint, and in which of the posters it was met,
 * in the side view on which of the bodies */
/**
 * A press of the left button.
 * @typedef {Place & { x0: number, y0: number, pointer: number,
 *   kind: "press" | "drag" | "depth" | "marquee" | "framing" | "empty" | "toggled",
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
  const bodies = states.bodies?.bodies.length ?? 0;
  if (!place) return best;
  for (const [poster, map] of drawn.maps.entries()) {
    if (!inBox(map.seen, place)) continue;
    for (const { joint, x, y, body } of placedOn(map)) {
      const distance = Math.hypot(x - place.x, y - place.y);
      const other = isFilmed(map) ? 0 : bodies - 1 - body; // the body that is corrected is meant where they meet
      const score = distance + RANK_HANDICAP * (groupOf[joint] + other);
      if (distance <= reach && (!best || score < best.score)) best = { joint, poster, body, score };
    }
  }
  return best;
}

/** Whether what was met is in a picture, where keypoints are dragged. @param {Found | null} found */
export const inPicture = (found) => found !== null && isFilmed(drawn.maps[found.poster]);

/** Whether it is in another view's picture. @param {Found | null} found */
export const inView = (found) => found !== null && drawn.maps[found.poster].poster.kind === "view";

/** The picture's map at this place. @param {Place | null} place */
export const pictureAt = (place) => drawn.maps.find((map) => place && isPicture(map) && inBox(map.seen, place));

/** Keypoints within a gesture's rectangle, in any poster. @param {Gesture} gesture */
export function within({ x0, y0, x, y }) {
  /** @param {Place} place */
  const inside = (place) => (place.x - x0) * (place.x - x) <= 0 && (place.y - y0) * (place.y - y) <= 0;
  /** @param {PosterMap} map */
  const seen = (map) => placedOn(map).filter((place) => inside(place) && inBox(map.seen, place));
  return [...new Set(drawn.maps.flatMap(seen).map(({ joint }) => joint))];
}

/** Of an event, over the canvas. @param {MouseEvent} event @returns {Place} */
export function canvasPlace(event) {
  const { left, top } = canvas().getBoundingClientRect();
  return { x: event.clientX - left, y: event.clientY - top };
}

/** @param {Event} event */
export const overPoster = (event) => event.target === canvas() && states.layout?.mode === "poster";

/** Over a poster or over 3D. @param {Event} event */
export const overScene = (event) => event.target === canvas() && Boolean(states.layout);

/** @param {PointerEvent} event */
function hover(event) {
  const now = overScene(event) && event.pointerType !== "touch" && event.buttons === 0 ? canvasPlace(event) : null;
  if (!now && !pointer.place) return;
  pointer.place = now;
  invalidate("overlay");
}

window.addEventListener("pointermove", hover, true);
document.documentElement.addEventListener("pointerleave", hover);

/** On a keypoint, the menu is about all that are selected. @param {MouseEvent} event */
function rightClick(event) {
  if (!skeletonReady()) return;
  const found = pick(canvasPlace(event), REACH);
  const view = inView(found);
  if (found && (chosen.suggested || !chosen.joints.has(found.joint) || chosen.view !== view))
    select([found.joint], "replace", view);
  const groups = (found ? states.menus?.keypoints : states.menus?.picture) ?? [];
  const items = groups.flatMap((group, i) => (i ? [null, ...group] : [...group]));
  const name = found ? known("skeleton").names[found.joint] : "Picture";
  openMenu(name, items, event.clientX, event.clientY);
}

onRightClick(overScene, rightClick);
