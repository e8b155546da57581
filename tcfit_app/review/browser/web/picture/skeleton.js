// Which keypoints there are, where they are drawn, which of them are on show, and which are chosen.

/** @import { PosterMap } from "./projection.js" */
/** @import { Keypoints, Meaning } from "../wire" */

import { emit, invalidate, known, states, watch } from "../connection.js";
import { COLORS } from "../theme.js";
import { fitPlaces } from "./fits.js";
import { toScreen } from "./projection.js";

/**
 * Keypoints that are drawn where the pointer has put them.
 * @typedef {object} Held
 * @property {Set<number>} joints
 * @property {{ [joint: number]: number[] }} from where they were, in image pixels
 * @property {number} dx since then, in image pixels
 * @property {number} dy
 * @property {number} frame
 * @property {boolean} view whether they are another view's
 * @property {boolean} left whether they were let go, and wait for the server to show them there
 */

/**
 * A keypoint of a fit that is dragged in depth.
 * @typedef {object} InDepth
 * @property {number} joint
 * @property {number[]} from where the pointer took it, in CSS pixels
 * @property {number[]} way where it goes from there for each metre away from the camera
 * @property {number} metres so far
 * @property {number} frame
 */

/** What the pointer does with keypoints. */
export const chosen = {
  /** @type {Set<number>} */
  joints: new Set(), // selected
  suggested: false, // not the user has selected them
  view: false, // in another view's picture, whose keypoints are corrected then
  /** @type {Held | null} */
  held: null,
  /** @type {InDepth | null} */
  inDepth: null,
};

/** @type {number[]} */
export let groupOf = []; // by keypoint: its group's place in skeleton.groups, which is also its rank for picking

/** @param {number} group */
export const groupColor = (group) => COLORS[/** @type {Meaning} */ (known("skeleton").groups[group].name)];

/** The keypoints of a picture. @param {PosterMap} map */
export const pointsOf = (map) => (isView(map) && states.view_keypoints) || known("keypoints");

/** Whether a keypoint of the frame on show has an attribute.
 * @param {"bad" | "edited" | "pinned" | "locked" | "deep" | "ignored"} attribute @param {number} joint */
export const marked = (attribute, joint, points = known("keypoints")) => points[attribute].includes(joint);

watch("skeleton", (skeleton) => {
  const groups = skeleton?.groups ?? [];
  groupOf = (skeleton?.names ?? []).map((_, joint) => groups.findIndex((g) => g.start <= joint && joint < g.stop));
  invalidate("overlay");
});
watch("selection", (selection) => {
  chosen.joints = new Set(selection?.joints);
  chosen.suggested = Boolean(selection?.suggested);
  chosen.view = Boolean(selection?.view);
  invalidate("overlay");
});
for (const name of /** @type {const} */ (["keypoints", "view_keypoints"]))
  watch(name, (points) => {
    const { held } = chosen;
    const here = held?.left && held.view === (name === "view_keypoints");
    if (here && (states.keypoints?.frame !== held.frame || !points || arrived(held, points))) chosen.held = null;
    invalidate("overlay");
  });
for (const name of /** @type {const} */ (["style", "layout", "side", "view", "space", "bodies"]))
  watch(name, () => invalidate("overlay"));

/** Whether the server shows the held keypoints where they were left; it rounds to a hundredth of a pixel.
 * @param {Held} held @param {Keypoints} keypoints */
function arrived(held, keypoints) {
  /** @param {number} a @param {number} b */
  const near = (a, b) => Math.abs(a - b) < 0.02;
  return [...held.joints].every((joint) => {
    const [x, y] = keypoints.xy[joint];
    const [fromX, fromY] = held.from[joint];
    return near(x, fromX + held.dx) && near(y, fromY + held.dy);
  });
}

/** Selects keypoints, at once and in the server.
 * @param {number[]} joints @param {"replace" | "add" | "toggle"} how @param {boolean} view in another view's picture */
export function select(joints, how, view) {
  chosen.suggested = false;
  chosen.view = view;
  if (how === "replace") chosen.joints = new Set();
  for (const joint of joints)
    if (how === "toggle" && chosen.joints.has(joint)) chosen.joints.delete(joint);
    else chosen.joints.add(joint);
  emit({ type: "select", joints, how, view });
  invalidate("overlay");
}

/** In image pixels. @param {number} joint */
export function position(joint, points = known("keypoints")) {
  const { held } = chosen;
  if (!held?.joints.has(joint) || held.view !== (points === states.view_keypoints)) return points.xy[joint];
  const [x, y] = held.from[joint];
  return [x + held.dx, y + held.dy];
}

/** @param {number} joint */
export const groupShown = (joint) => known("style").groups.includes(known("skeleton").groups[groupOf[joint]].name);

/** Whether it is anywhere: undetected ones lie in the image's corner, and so do copies of them.
 * @param {number} joint */
export function located(joint, points = known("keypoints")) {
  const { confidence, xy } = points;
  return confidence[joint] > 0 || (marked("edited", joint, points) && xy[joint].some((pixels) => pixels !== 0));
}

/** Whether it is drawn, and can be picked. An undetected one is while it alone is selected: it can then be dragged from
 * the corner to its place. @param {number} joint */
export function shown(joint, points = known("keypoints")) {
  if (!groupShown(joint)) return false;
  if (chosen.joints.has(joint)) return chosen.joints.size === 1 || located(joint, points);
  return known("style").points && points.confidence[joint] > 0;
}

/** Whether there is all there is to draw. */
export const skeletonReady = () => Boolean(states.layout && states.skeleton && states.style && states.keypoints);

/** @param {PosterMap} map */
export const shownJoints = (map) => groupOf.map((_, joint) => joint).filter((joint) => shown(joint, pointsOf(map)));

// --- on the screen ---

/**
 * A keypoint on one of the posters, in CSS pixels.
 * @typedef {{ joint: number, x: number, y: number, body: number }} Placed and outside pictures, on which of the bodies
 */

/** @param {PosterMap} map */
export const isSide = (map) => map.poster.kind === "side";

/** @param {PosterMap} map */
const isView = (map) => map.poster.kind === "view";

/** Whether keypoints are corrected there: in the clip's pictures and in another view's.
 * @param {PosterMap} map */
export const isFilmed = (map) => isPicture(map) || isView(map);

/** @param {PosterMap} map */
export const isPicture = (map) => map.poster.kind === "picture";

/** @param {PosterMap} map */
export const isSpace = (map) => map.poster.kind === "space";

/** Where keypoints are on a poster: in a picture once, in the side view and in 3D on each of the fits on show.
 * @param {PosterMap} map @param {number[]} joints @returns {Placed[]} */
export function placesOf(map, joints) {
  if (map.poster.kind === "video") return [];
  if (!isFilmed(map)) return fitPlaces(map, joints);
  return joints.map((joint) => {
    const [x, y] = toScreen(map, position(joint, pointsOf(map)));
    return { joint, x, y, body: 0 };
  });
}

/** The keypoints on show on a poster. @param {PosterMap} map @returns {Placed[]} */
export function placedOn(map) {
  if (!skeletonReady()) return [];
  if (isFilmed(map)) return placesOf(map, shownJoints(map));
  const { points } = known("style");
  /** @param {number} joint */
  const seen = (joint) => groupShown(joint) && (points || chosen.joints.has(joint));
  return placesOf(map, groupOf.map((_, joint) => joint).filter(seen));
}

const USUAL_HEIGHT = 700; // CSS pixels of a poster that fills a window

/** Points keep their size on the screen, but for a little growth when zoomed in. @param {PosterMap} map */
export const zoomFactor = (map) => Math.min(Math.max(0.5 + (0.5 * map.height) / USUAL_HEIGHT, 0.6), 1.9);

/** @param {number} joint @param {PosterMap} map */
export const jointRadius = (joint, map) => known("skeleton").groups[groupOf[joint]].radius * zoomFactor(map);
