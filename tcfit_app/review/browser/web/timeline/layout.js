// Where things are in the strip, from top to bottom: the ruler, the rows, the lanes, the overview.

import { BAR_HEIGHT } from "../bars/sheet.js";
import { states } from "../connection.js";
import { barsHeight, strip } from "../elements.js";

const RULER = 19;
const FIT = 5; // the running fit, below the ruler
const LANE = 15;
const OVERVIEW = 13;
const GAP = 3;
const LEAST_ROW = 34;
const LEAST_PICTURE = 110; // what stays above the strip
const USUAL = { share: 0.3, least: 217, most: 340 }; // of the window's height, in CSS pixels; with the bar

/** @typedef {{ top: number, bottom: number }} Band in CSS pixels of the strip */

export const LANES = /** @type {const} */ (["Edits", "Keyframes", "Suspicious", "Flags", "Notes"]);

export const ruler = { top: 0, bottom: RULER };
export const fitBand = { top: ruler.bottom, bottom: ruler.bottom + FIT };

const FIRST_ROWS = 2; // of a new tab: the strip is as high before its rows have come
const rowCount = () => Math.max(states.rows ? states.rows.rows.length : FIRST_ROWS, 1);
const belowRows = () => GAP + LANES.length * LANE + OVERVIEW;

/** @returns {Band} */
export const overview = () =>
  ({ top: strip.clientHeight - OVERVIEW, bottom: strip.clientHeight });

/** @param {number} index @returns {Band} */
export function laneBand(index) {
  const top = strip.clientHeight - OVERVIEW - (LANES.length - index) * LANE;
  return { top, bottom: top + LANE };
}

/** They share the room. @param {number} index @returns {Band} */
export function rowBand(index) {
  const room = strip.clientHeight - fitBand.bottom - belowRows();
  const height = room / rowCount();
  const [top, bottom] = [index, index + 1].map((rows) => Math.round(fitBand.bottom + rows * height));
  return { top, bottom };
}

/** @param {Band} band @param {number} y */
export const within = ({ top, bottom }, y) => y >= top && y < bottom;

// --- its height ---

/** The height that it should have: as suits the window, with every row legible, and a picture above it. */
export function stripHeight() {
  const room = (strip.parentElement?.parentElement?.clientHeight ?? window.innerHeight) - LEAST_PICTURE - barsHeight();
  const usual = Math.min(Math.max(USUAL.share * window.innerHeight, USUAL.least), USUAL.most) - BAR_HEIGHT;
  const least = fitBand.bottom + belowRows() + rowCount() * LEAST_ROW;
  return Math.round(Math.min(Math.max(usual, least), Math.max(room, ruler.bottom)));
}
