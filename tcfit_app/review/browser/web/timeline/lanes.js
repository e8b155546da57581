// The lanes below the rows: marks on frames, by what they are about.

/** @import { Context } from "./paint.js" */

import { invalidate, known, states, watch } from "../connection.js";
import { tones } from "../theme.js";
import { GUTTER, edgeX, frameAt, frameX, plotWidth } from "./axis.js";
import { LANES, laneBand, within } from "./layout.js";
import { NAMES, fillBox, fillFrames, write } from "./paint.js";

/**
 * Frames that something is to be said of. `frame` is the one that a click goes to, if that is always the same; `key`
 * says that it is a keyframe; `suspicion` which entry of the review queue it is, of that `opacity`.
 * @typedef {{ first: number, last: number, frame?: number, color: string, text: string, key?: boolean,
 *   suspicion?: string, opacity?: number }} Mark
 */

const NEAR = 5; // CSS pixels beside a mark that still count as it
const INSET = 2.5; // of a mark in its lane
const SEVERITIES = [[3, 1], [1.8, 0.7], [0, 0.45]]; // from which score on, and the mark's opacity

/** @param {[number, number][] | undefined} spans @param {string} color @param {string} text @returns {Mark[]} */
const marked = (spans, color, text) => (spans ?? []).map(([first, last]) => ({ first, last, color, text }));

/** @type {{ [lane in typeof LANES[number]]: () => Mark[] }} */
const READ = {
  Edits: () => [
    ...marked(states.marks?.edited, tones.strong, "corrected"),
    ...marked(states.marks?.bad, tones.bad, "marked bad"),
  ],
  Keyframes: () =>
    (states.keyframes?.frames ?? []).map((frame) => ({
      first: frame,
      last: frame,
      color: tones.strong,
      text: `keyframe of ${known("keyframes").subject}\nDrag it to another frame`,
      key: true,
    })),
  Suspicious: () =>
    [...(states.suspicions?.found ?? [])]
      .sort((one, other) => one.score - other.score) // the worst on top
      .map(({ score, reason, key, ...frames }) => ({
        ...frames,
        color: tones.suspicious,
        opacity: SEVERITIES.find(([from]) => score >= from)?.[1],
        text: key ? `${reason}\nClick: go there and select it` : reason,
        suspicion: key,
      })),
  Flags: () => [
    ...marked(states.marks?.checked, tones.checked, "looks fine"),
    ...marked(states.marks?.flagged, tones.suspicious, "flagged"),
  ],
  Notes: () =>
    (states.marks?.notes ?? []).map(({ first, last, text }) => ({ first, last, color: tones.strong, text: `note: ${text}` })),
};

/** @type {Mark[][]} */
let lanes = LANES.map(() => []);

for (const name of /** @type {const} */ (["marks", "keyframes", "suspicions"]))
  watch(name, () => {
    lanes = LANES.map((lane) => READ[lane]());
    invalidate("timeline");
  });

/** @param {Context} context */
export function drawLanes(context) {
  lanes.forEach((_, index) => {
    const { top, bottom } = laneBand(index);
    fillBox(context, tones.bed, GUTTER, top + 1, plotWidth(), bottom - top - 2);
  });
  const { top, bottom } = laneBand(LANES.indexOf("Suspicious"));
  if (states.suspicions?.looking && !states.suspicions.found.length)
    write(context, "Looking for suspicious frames …", GUTTER + 12, (top + bottom) / 2, tones.dim);
}

/** @param {Context} context */
export function drawMarks(context) {
  lanes.forEach((marks, index) => {
    const { top, bottom } = laneBand(index);
    const [y, height] = [top + INSET, bottom - top - 2 * INSET];
    for (const { first, last, frame, color, key, opacity = 1 } of marks) {
      if (key) {
        drawKey(context, frameX(first), top, bottom, color);
        continue;
      }
      context.globalAlpha = opacity * (frame === undefined ? 1 : 0.45); // the worst frame stands out of its span
      fillFrames(context, color, first, last, y, height);
      context.globalAlpha = opacity;
      if (frame !== undefined) fillFrames(context, color, frame, frame, y, height);
      context.globalAlpha = 1;
    }
  });
}

/** A keyframe, as a diamond.
 * @param {Context} context @param {number} x @param {number} top @param {number} bottom @param {string} color */
export function drawKey(context, x, top, bottom, color) {
  const [y, half] = [(top + bottom) / 2, (bottom - top) / 2 - 2];
  context.fillStyle = color;
  context.beginPath();
  context.moveTo(x - half, y);
  context.lineTo(x, y - half);
  context.lineTo(x + half, y);
  context.lineTo(x, y + half);
  context.fill();
}

/** @param {Context} context */
export function drawLaneNames(context) {
  lanes.forEach((marks, index) => {
    const { top, bottom } = laneBand(index);
    const color = marks.length ? tones.text : tones.dim;
    write(context, LANES[index], NAMES, (top + bottom) / 2 + 0.5, color);
  });
}

/** What is said of a frame, in all lanes. @param {number} frame */
export const marksOf = (frame) =>
  lanes.flatMap((marks) => marks.filter(({ first, last }) => first <= frame && frame <= last));

/** The mark at a place of the strip, and the frame to which it leads; null without one.
 * @param {number} x @param {number} y @returns {{ mark: Mark, frame: number } | null} */
export function markAt(x, y) {
  const lane = LANES.findIndex((_, index) => within(laneBand(index), y));
  /** @param {Mark} mark */
  const distance = ({ first, last }) => Math.max(edgeX(first) - x, x - edgeX(last + 1), 0);
  let [found, least] = [/** @type {Mark | null} */ (null), NEAR + 1e-9];
  for (const mark of lanes[lane] ?? []) if (distance(mark) <= least) [found, least] = [mark, distance(mark)];
  if (!found) return null;
  const frame = found.frame ?? Math.min(Math.max(frameAt(x), found.first), found.last);
  return { mark: found, frame };
}
