// Draws the strip below the canvas: on one canvas what stays while the clip plays, on another the cursor, the selected
// frames and the pointer.

/** @import { Context } from "./paint.js" */

import { showFrame } from "../bars/bar.js";
import { addPainter, invalidate, known, states } from "../connection.js";
import { bar, cleared, placeTooltip, strip, stripCanvas, stripFront, stripTooltip } from "../elements.js";
import { FONT } from "../style.js";
import { tones } from "../theme.js";
import {
  GUTTER, axis, clockText, edgeX, frameAt, frameNumber, frameX, niceStep, plotWidth, shownCount,
} from "./axis.js";
import { drawKey, drawLaneNames, drawLanes, drawMarks, markAt, marksOf } from "./lanes.js";
import { LANES, fitBand, laneBand, overview, ruler } from "./layout.js";
import { drawOverview, markOverview } from "./overview.js";
import { NAMES, clipToPlot, fillBox, fillFrames, write } from "./paint.js";
import { chosenRange, cursorFrame, pointed } from "./pointed.js";
import { drawRows, levelWords } from "./rows.js";

const TICKS = 118; // CSS pixels between two numbers in the ruler
const RULER_MIDDLE = (ruler.top + ruler.bottom) / 2 + 0.5;
const CURSOR_FONT = `600 13px ${FONT}`;
const GRIP = 4; // width of the handle at an end of the selected frames
const RUNNING = {
  found: { opacity: 0.25, text: "keypoints found" },
  fitting: { opacity: 0.25, text: "running" },
  phase1: { opacity: 0.5, text: "first pass done" },
  phase2: { opacity: 0.75, text: "one shape done" },
  done: { opacity: 1, text: "finished" },
};
const whole = () => ({ top: ruler.top, bottom: strip.clientHeight });

function drawBack() {
  if (!states.timeline || strip.hidden) return;
  const context = cleared(stripCanvas);
  drawRuler(context);
  drawFit(context);
  drawRows(context);
  drawLanes(context);
  clipToPlot(context, whole(), () => drawMarks(context));
  drawLaneNames(context);
  drawOverview(context);
  invalidate("cursor");
}

function drawFront() {
  if (!states.timeline || strip.hidden) return;
  const context = cleared(stripFront);
  const [cursor, range] = [cursorLabel(context), chosenRange()];
  if (cursor) hideTicks(context, cursor.left - 4, cursor.left + cursor.width + 4);
  const ends = range ? [edgeX(range.first), edgeX(range.last + 1) - GRIP] : [];
  for (const x of ends) hideTicks(context, x - 2, x + GRIP + 2);
  drawRange(context);
  if (cursor) drawCursor(context, cursor);
  drawPointer(context);
  showFrame(); // last: what is drawn asks for sizes, and the page would have to be laid out for them
}

/** Number and time in the ruler: where they begin, where the number ends, and where the time does.
 * @type {{ number: string, x: number, middle: number, end: number }[]} */
let ticks = [];

/** @param {Context} context */
function drawRuler(context) {
  fillBox(context, tones.bed, 0, ruler.top, strip.clientWidth, ruler.bottom - ruler.top);
  const step = Math.max(niceStep(shownCount(), plotWidth() / TICKS), 1);
  const offset = known("timeline").first_frame;
  const start = Math.ceil((axis.first + offset) / step) * step - offset;
  const bottom = overview().top;
  const right = GUTTER + plotWidth();
  ticks = [];
  for (let frame = Math.max(start, 0); frame < axis.last; frame += step) {
    const x = frameX(frame);
    fillBox(context, tones.line, Math.round(x), ruler.top, 1, bottom - ruler.top);
    const number = frameNumber(frame);
    const middle = x + 4 + context.measureText(number).width;
    const end = middle + 6 + context.measureText(clockText(frame)).width;
    if (middle > right) continue; // half a number reads like another one
    write(context, number, x + 4, RULER_MIDDLE, tones.text);
    if (end <= right) write(context, clockText(frame), middle + 6, RULER_MIDDLE, tones.dim);
    ticks.push({ number, x: x + 4, middle, end: end <= right ? end : middle });
  }
  fillBox(context, tones.bed, right, ruler.top, strip.clientWidth, ruler.bottom - ruler.top);
  write(context, "Frame", NAMES, RULER_MIDDLE, tones.dim);
}

/** @param {Context} context */
function drawFit(context) {
  const { top, bottom } = fitBand;
  clipToPlot(context, fitBand, () => {
    for (const { first, last, state } of states.fit?.spans ?? []) {
      context.globalAlpha = RUNNING[state].opacity;
      fillFrames(context, tones.accent, first, last, top, bottom - top - 1);
    }
    context.globalAlpha = 1;
  });
}

// --- what moves ---

/** @param {Context} context */
function drawRange(context) {
  markOverview(context);
  const range = chosenRange();
  if (!range) return;
  const band = { top: ruler.top, bottom: overview().top };
  clipToPlot(context, band, () => {
    const [left, right] = [edgeX(range.first), edgeX(range.last + 1)];
    context.globalAlpha = 0.14;
    fillBox(context, tones.selected, left, band.top, right - left, band.bottom - band.top);
    context.globalAlpha = 1;
    for (const x of [left, right - 1]) fillBox(context, tones.selected, x, band.top, 1.5, band.bottom - band.top);
    for (const x of [left, right - GRIP]) fillBox(context, tones.selected, x, band.top, GRIP, ruler.bottom - ruler.top);
  });
}

/** The frame's number in the ruler; null where the frame is not on show. @param {Context} context */
function cursorLabel(context) {
  const frame = cursorFrame();
  if (frame === null || frame + 1 <= axis.first || frame >= axis.last) return null;
  const [x, number] = [frameX(frame), frameNumber(frame)];
  context.font = CURSOR_FONT;
  const width = context.measureText(number).width + 12;
  return { x, number, width, left: Math.min(Math.max(x - width / 2, 2), strip.clientWidth - width - 2) };
}

/** @param {Context} context @param {NonNullable<ReturnType<typeof cursorLabel>>} label */
function drawCursor(context, { x, number, width, left }) {
  const bottom = overview().top;
  fillBox(context, tones.strong, x - 0.75, ruler.top, 1.5, bottom - ruler.top);
  context.beginPath();
  context.roundRect(left, ruler.top + 1.5, width, ruler.bottom - ruler.top - 3, 4);
  context.fillStyle = tones.strong;
  context.fill();
  context.font = CURSOR_FONT;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillStyle = tones.surface;
  context.fillText(number, left + width / 2, RULER_MIDDLE);
}

/** No number below the cursor's, or below an end of the selected frames, is half seen.
 * @param {Context} context @param {number} left @param {number} right */
function hideTicks(context, left, right) {
  for (const { number, x, middle, end } of ticks) {
    if (end < left || x > right) continue;
    fillBox(context, tones.bed, x - 1, ruler.top, end - x + 2, ruler.bottom - ruler.top);
    if (middle < left || x > right) write(context, number, x, RULER_MIDDLE, tones.text);
  }
}

/** A thin line and a list of what there is at the pointer. @param {Context} context */
function drawPointer(context) {
  stripTooltip.hidden = true;
  const { x, y } = pointed;
  if (x === null || x < GUTTER || x > GUTTER + plotWidth() || y < ruler.top || y >= overview().top) return;
  const found = pointed.key !== null ? null : markAt(x, y);
  const frame = found ? found.frame : frameAt(x);
  if (pointed.key !== null) {
    const { top, bottom } = laneBand(LANES.indexOf("Keyframes"));
    drawKey(context, frameX(pointed.key), top, bottom, tones.selected);
  }
  fillBox(context, tones.hair, frameX(frame) - 0.5, ruler.top, 1, overview().top - ruler.top);
  if (pointed.clicked) return;
  stripTooltip.textContent = (found ? [frameTitle(frame), found.mark.text] : frameLines(frame)).join("\n");
  placeTooltip(stripTooltip, frameX(frame), -bar.offsetHeight, true);
}

/** @param {number} frame */
const frameTitle = (frame) => `Frame ${frameNumber(frame)}  ${clockText(frame)}`;

/** @param {number} frame */
function frameLines(frame) {
  const lines = [frameTitle(frame)];
  for (const { title, unit, curves, levels } of states.rows?.rows ?? []) {
    const words = levels ? levelWords(levels, frame) : [];
    if (words.length) lines.push(`${title}  ${words.join("   ")}`);
    const there = curves.filter(({ values }) => (values[frame] ?? null) !== null);
    const said = there.map(({ label, values, error_bars, unseen }) => {
      const error = error_bars[frame] ?? null;
      const value = Number(Number(values[frame]).toPrecision(3));
      const off = error === null ? "" : ` ± ${Number(error.toPrecision(2))}`;
      const number = `${value}`.replace("-", "−") + off;
      const seen = !unseen.some(([first, last]) => first <= frame && frame <= last);
      return [label, number, unit, seen ? "" : "(not seen)"].filter(Boolean).join(" ");
    });
    if (said.length) lines.push(`${title}  ${said.join("   ")}`);
  }
  for (const { label, texts, which } of states.provenance?.fits ?? [])
    if (which[frame] !== undefined) lines.push(`${label}  ${texts[which[frame]]}`);
  const marks = marksOf(frame).map(({ text }) => text.split("\n")[0]); // not what a click on one does
  if (marks.length) lines.push(marks.join(", "));
  const fitted = (states.fit?.spans ?? []).find(({ first, last }) => first <= frame && frame <= last);
  if (fitted) lines.push(`fit: ${RUNNING[fitted.state].text}`);
  return lines;
}

addPainter("timeline", drawBack);
addPainter("cursor", drawFront);
