// Draws the strip below the canvas: ruler, curves, marks, the running fit, the chosen range, the cursor.

/** @import { ChosenRange, Curve } from "../wire" */
/** @typedef {CanvasRenderingContext2D} Context */

import { addPainter, known, states } from "../connection.js";
import { cleared, placeTooltip, shortenedName, strip, stripCanvas, stripTooltip } from "../elements.js";
import { stroke } from "../picture/shapes.js";
import { COLORS, FIT_COLORS, FIT_NAMES, FONT } from "../style.js";
import {
  GUTTER, MARGIN, axis, clockText, curvePath, edgeX, frameAt, frameNumber, frameX, niceStep, plotWidth, shownCount,
  valueScale, valueText,
} from "./axis.js";

export const RULER = 19;
const LEGEND = { top: 20, height: 16 }; // above the curves, whose peaks are what is looked for
const CURVES = { top: 37, bottom: 88 };
/** @type {{ name: "edited" | "bad" | "flagged" | "checked" | "apart", y: number }[]} */
const MARK_ROWS = [
  { name: "edited", y: 94 },
  { name: "bad", y: 104 },
  { name: "flagged", y: 114 },
  { name: "checked", y: 124 },
  { name: "apart", y: 134 },
];
const ROW = 7; // height of a mark
const FIT_ROW = 145;
const LEGEND_ENTRY = 170; // widest, where the plot is not four times as wide
export const FULL_HEIGHT = 156;

/** What the user does with the timeline. */
export const pointed = {
  collapsed: sessionStorage.getItem("tcfit-collapsed") === "yes",
  /** @type {number | null} */
  cursor: null, // the frame that is being pointed at
  /** @type {ChosenRange | null | undefined} */
  range: undefined, // what is being chosen, if something is
  /** @type {number | null} */
  x: null, // of the pointer over the strip
};

export const cursorFrame = () => pointed.cursor ?? states.cursor?.frame ?? null;
const chosenRange = () => (pointed.range === undefined ? states.range : pointed.range) ?? null;

function drawTimeline() {
  if (!states.timeline || strip.hidden) return;
  const context = cleared(stripCanvas);
  drawRuler(context);
  drawRange(context);
  if (!pointed.collapsed) {
    clipToPlot(context, () => drawMarks(context));
    drawLabels(context);
    drawCurves(context);
  }
  drawCursor(context);
  drawPointer(context);
}

/** Nothing is drawn over the labels. @param {Context} context @param {() => void} draw */
function clipToPlot(context, draw) {
  context.save();
  context.beginPath();
  context.rect(GUTTER, 0, plotWidth(), FULL_HEIGHT);
  context.clip();
  draw();
  context.restore();
}

/** @param {Context} context @param {string} text @param {number} x @param {number} y @param {string} color
 * @param {CanvasTextAlign} [align] @param {number} [size] */
function write(context, text, x, y, color, align = "left", size = 10.5) {
  context.font = `${size}px ${FONT}`;
  context.textAlign = align;
  context.textBaseline = "middle";
  context.fillStyle = color;
  context.fillText(text, x, y);
}

/** @param {Context} context @param {string} color @param {number} x @param {number} y @param {number} width
 * @param {number} height */
function fillBox(context, color, x, y, width, height) {
  context.fillStyle = color;
  context.fillRect(x, y, width, height);
}

/** @param {Context} context */
function drawRuler(context) {
  fillBox(context, "#1b1f26", 0, 0, strip.clientWidth, RULER);
  const step = Math.max(niceStep(shownCount(), plotWidth() / 110), 1);
  const offset = known("timeline").first_frame;
  const pill = cursorPill(context);
  const start = Math.ceil((axis.first + offset) / step) * step - offset;
  for (let frame = Math.max(start, 0); frame < axis.last; frame += step) {
    const x = frameX(frame);
    if (x > strip.clientWidth - 90) break; // for the buttons
    fillBox(context, COLORS.line, Math.round(x), 0, 1, pointed.collapsed ? RULER : CURVES.bottom);
    drawTick(context, frame, x + 4, pill);
  }
  write(context, "frame", GUTTER - 8, RULER / 2, COLORS.dim, "right");
}

/** Frame number and time, each unless the cursor's number lies on it.
 * @param {Context} context @param {number} frame @param {number} x @param {ReturnType<typeof cursorPill>} pill */
function drawTick(context, frame, x, pill) {
  /** @param {number} left @param {number} right */
  const free = (left, right) => !pill || right < pill.left || left > pill.left + pill.width;
  const number = frameNumber(frame);
  context.font = `10.5px ${FONT}`;
  const after = x + context.measureText(number).width + 4;
  if (free(x, after - 4)) write(context, number, x, RULER / 2, COLORS.text);
  context.font = `9.5px ${FONT}`;
  const clock = clockText(frame);
  const end = after + context.measureText(clock).width;
  if (free(after, end)) write(context, clock, after, RULER / 2, "#667080", "left", 9.5);
}

/** @param {Context} context */
function drawRange(context) {
  const range = chosenRange();
  if (!range) return;
  clipToPlot(context, () => {
    const [left, right] = [edgeX(range.first), edgeX(range.last + 1)];
    fillBox(context, "rgba(40, 140, 220, 0.2)", left, 0, right - left, strip.clientHeight);
    for (const x of [left, right - 1]) fillBox(context, COLORS.accent, x, 0, 1.5, strip.clientHeight);
  });
}

/** @param {Context} context */
function drawMarks(context) {
  for (const { name, y } of MARK_ROWS) {
    fillBox(context, "#1b1f26", GUTTER, y, plotWidth(), ROW);
    for (const [first, last] of states.marks?.[name] ?? []) drawSpan(context, first, last, y, COLORS[name]);
  }
  fillBox(context, "#1b1f26", GUTTER, FIT_ROW, plotWidth(), ROW);
  for (const { first, last, state } of states.fit?.spans ?? [])
    drawSpan(context, first, last, FIT_ROW, FIT_COLORS[state]);
}

/** At least two pixels wide: a single marked frame of ten thousand must be seen.
 * @param {Context} context @param {number} first @param {number} last @param {number} y @param {string} color */
function drawSpan(context, first, last, y, color) {
  const [left, right] = [edgeX(first), edgeX(last + 1)];
  fillBox(context, color, left, y, Math.max(right - left - (right - left > 6 ? 1 : 0), 2), ROW);
}

/** @param {Context} context */
function drawLabels(context) {
  for (const { name, y } of MARK_ROWS) {
    const some = (states.marks?.[name] ?? []).length > 0;
    write(context, name, GUTTER - 8, y + ROW / 2 + 0.5, some ? COLORS[name] : "#667080", "right", 9.5);
  }
  write(context, "fit", GUTTER - 8, FIT_ROW + ROW / 2 + 0.5, "#667080", "right", 9.5);
}

/** @param {Context} context */
function drawCurves(context) {
  const { curves } = known("timeline");
  const scale = valueScale(curves);
  if (scale) {
    const y = valueY(scale);
    drawValueLabels(context, scale, y);
    clipToPlot(context, () => {
      context.lineJoin = "round";
      for (const { values, color } of curves) stroke(context, curvePath(values, y), color, 1.4);
    });
  } else write(context, known("timeline").empty, GUTTER + 12, (CURVES.top + CURVES.bottom) / 2, COLORS.dim, "left", 12);
  drawCurveLegend(context, curves);
}

/** @param {{ low: number, high: number }} scale @returns {(value: number) => number} */
const valueY = ({ low, high }) => (value) =>
  CURVES.bottom - ((value - low) / (high - low)) * (CURVES.bottom - CURVES.top);

/** @param {Context} context @param {{ low: number, high: number }} scale @param {(value: number) => number} y */
function drawValueLabels(context, scale, y) {
  const step = niceStep(scale.high - scale.low, 4);
  for (let value = Math.ceil(scale.low / step) * step; value <= scale.high; value += step) {
    if (y(value) < CURVES.top + 3) break;
    fillBox(context, "#222730", GUTTER, Math.round(y(value)), plotWidth(), 1);
    write(context, valueText(value, step), GUTTER - 8, y(value), COLORS.dim, "right", 10);
  }
}

/** @param {Context} context @param {Curve[]} curves */
function drawCurveLegend(context, curves) {
  const { title, unit } = known("timeline");
  context.font = `11px ${FONT}`;
  const widest = Math.max(LEGEND_ENTRY, plotWidth() / 4);
  const entries = curves.map(({ label, color }) => ({ text: shortenedName(context, label, widest), color }));
  const heading = unit && title ? `${title} [${unit}]` : title || unit;
  if (heading) entries.unshift({ text: heading, color: "" });
  const widths = entries.map(({ text, color }) => context.measureText(text).width + (color ? 30 : 14));
  const whole = widths.reduce((sum, width) => sum + width, 0);
  let x = strip.clientWidth - MARGIN - whole;
  fillBox(context, "rgba(20, 23, 28, 0.82)", x - 6, LEGEND.top, whole + 6, LEGEND.height);
  entries.forEach(({ text, color }, i) => {
    if (color) fillBox(context, color, x, LEGEND.top + 6.5, 11, 3);
    write(context, text, x + (color ? 16 : 0), LEGEND.top + 8.5, color ? COLORS.text : COLORS.dim, "left", 11);
    x += widths[i];
  });
}

const CURSOR_FONT = `600 11px ${FONT}`;

/** The cursor's number in the ruler, and where; null while the cursor is not on show. @param {Context} context */
function cursorPill(context) {
  const frame = cursorFrame();
  if (frame === null || frame + 1 <= axis.first || frame >= axis.last) return null;
  context.font = CURSOR_FONT;
  const width = context.measureText(frameNumber(frame)).width + 12;
  const left = Math.min(Math.max(frameX(frame) - width / 2, 2), strip.clientWidth - width - 2);
  return { text: frameNumber(frame), x: frameX(frame), left, width };
}

/** @param {Context} context */
function drawCursor(context) {
  const pill = cursorPill(context);
  if (!pill) return;
  fillBox(context, COLORS.cursor, pill.x - 0.75, 0, 1.5, strip.clientHeight);
  context.beginPath();
  context.roundRect(pill.left, 1.5, pill.width, RULER - 3, 4);
  context.fill();
  context.font = CURSOR_FONT;
  context.textAlign = "center";
  context.fillStyle = "#10131a";
  context.fillText(pill.text, pill.left + pill.width / 2, RULER / 2 + 0.5);
}

/** A thin line and a list of what there is at the pointer. @param {Context} context */
function drawPointer(context) {
  stripTooltip.hidden = true;
  if (pointed.x === null || pointed.x < GUTTER || pointed.x > GUTTER + plotWidth()) return;
  const frame = frameAt(pointed.x);
  fillBox(context, "rgba(255, 255, 255, 0.35)", frameX(frame) - 0.5, 0, 1, strip.clientHeight);
  stripTooltip.textContent = frameLines(frame).join("\n");
  placeTooltip(stripTooltip, frameX(frame), 0, true);
}

/** @param {number} frame */
function frameLines(frame) {
  const { curves, unit } = known("timeline");
  const lines = [`Frame ${frameNumber(frame)}  ${clockText(frame)}`];
  for (const { label, values } of curves) {
    const value = values[frame] ?? null;
    if (value !== null) lines.push(`${label}  ${Number(value.toPrecision(3))} ${unit}`);
  }
  for (const { label, texts, which } of states.provenance?.fits ?? [])
    if (which[frame] !== undefined) lines.push(`${label}  ${texts[which[frame]]}`);
  const marked = MARK_ROWS.map(({ name }) => name).filter((name) =>
    (states.marks?.[name] ?? []).some(([first, last]) => first <= frame && frame <= last),
  );
  if (marked.length) lines.push(marked.join(", "));
  const fitted = (states.fit?.spans ?? []).find(({ first, last }) => first <= frame && frame <= last);
  if (fitted) lines.push(`fit: ${FIT_NAMES[fitted.state]}`);
  return lines;
}

addPainter("timeline", drawTimeline);
