// What the user does with the timeline, before the server knows of it.

/** @import { ChosenRange } from "../wire" */

import { states } from "../connection.js";

export const pointed = {
  /** @type {number | null} */
  cursor: null, // the frame that is being pointed at
  /** @type {ChosenRange | null | undefined} */
  range: undefined, // what is being chosen, if something is
  /** @type {number | null} */
  key: null, // where the keyframe under the pointer is dragged to
  /** @type {number | null} */
  x: null, // of the pointer over the strip
  y: 0,
  /** @type {{ x: number, y: number } | null} */
  clicked: null, // where, as long as the pointer stays there: what it points at is known, and need not be shown
};

export const cursorFrame = () => pointed.cursor ?? states.cursor?.frame ?? null;
export const chosenRange = () => (pointed.range === undefined ? states.range : pointed.range) ?? null;
