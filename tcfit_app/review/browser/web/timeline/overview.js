// The bar of the whole clip below the lanes.

/** @import { Context } from "./paint.js" */

import { invalidate, states } from "../connection.js";
import { tones } from "../theme.js";
import { GUTTER, axis, clipLength, onAxisChange, plotWidth, showFrames, shownCount } from "./axis.js";
import { overview } from "./layout.js";
import { fillBox } from "./paint.js";
import { chosenRange, cursorFrame } from "./pointed.js";

/** An edge of a frame, in the overview. @param {number} edge */
const overviewX = (edge) => GUTTER + (edge / clipLength()) * plotWidth();

/** Brings the window to a place beside it. @param {number} x */
export function bringWindowTo(x) {
  const edge = ((x - GUTTER) / plotWidth()) * clipLength();
  if (edge < axis.first || edge > axis.last) showFrames(edge - shownCount() / 2, shownCount());
}

/** @param {Context} context */
export function drawOverview(context) {
  const { top, bottom } = overview();
  fillBox(context, tones.bed, GUTTER, top + 2, plotWidth(), bottom - top - 4);
  const [left, right] = [overviewX(axis.first), overviewX(axis.last)];
  context.fillStyle = shownCount() < clipLength() ? tones.thumb : tones["whole-thumb"];
  context.beginPath();
  context.roundRect(left, top + 2, Math.max(right - left, 3), bottom - top - 4, 3);
  context.fill();
  for (const { frame } of states.suspicions?.found ?? [])
    fillBox(context, tones.suspicious, overviewX(frame), top + 4, 1.5, bottom - top - 8);
}

/** The selected frames and the cursor. @param {Context} context */
export function markOverview(context) {
  const { top, bottom } = overview();
  const range = chosenRange();
  if (range) {
    const [left, right] = [overviewX(range.first), overviewX(range.last + 1)];
    context.globalAlpha = 0.5;
    fillBox(context, tones.selected, left, top + 2, Math.max(right - left, 2), bottom - top - 4);
    context.globalAlpha = 1;
  }
  const frame = cursorFrame();
  if (frame !== null) fillBox(context, tones.strong, overviewX(frame + 0.5) - 0.75, top + 1, 1.5, bottom - top - 2);
}

onAxisChange(() => states.timeline && invalidate("timeline"));
