// The rows of curves, each with its own axis of values; and of levels, where each part of the body has a line, stronger
// for a higher level.

/** @import { Curve, Levels, Row } from "../wire" */
/** @import { Band } from "./layout.js" */
/** @import { Context } from "./paint.js" */

import { states } from "../connection.js";
import { NOT_SURE, stroke } from "../picture/shapes.js";
import { tones } from "../theme.js";
import { GUTTER, bandPath, curvePath, niceStep, plotWidth, valueScale, valueText } from "./axis.js";
import { fitBand, rowBand } from "./layout.js";
import { clipToPlot, fillBox, fillFrames, write } from "./paint.js";

const [ABOVE, BELOW] = [8, 7]; // within a band, for the numbers at both ends of the axis
const LABELS = 15; // least distance of two numbers
const STRENGTHS = [0.15, 0.4, 0.85]; // opacities, which differ without colour vision and in both themes

/** @param {Context} context */
export function drawRows(context) {
  if (states.rows && !states.rows.rows.length)
    write(context, "No curves are chosen.", GUTTER + 12, fitBand.bottom + 22, tones.dim);
  (states.rows?.rows ?? []).forEach((row, index) => drawRow(context, row, rowBand(index)));
}

/** @param {Context} context @param {Row} row @param {Band} band */
function drawRow(context, row, band) {
  fillBox(context, tones.line, 0, band.bottom - 1, GUTTER + plotWidth(), 1);
  if (row.levels) return drawLevels(context, row.levels, band);
  const scale = valueScale(row.curves);
  if (!scale) return write(context, row.empty, GUTTER + 12, (band.top + band.bottom) / 2, tones.dim);
  const { low, high, step } = scale;
  const [top, bottom] = [band.top + ABOVE, band.bottom - BELOW];
  /** @param {number} value */
  const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
  for (const value of labelled(scale, bottom - top)) {
    fillBox(context, tones.grid, GUTTER, Math.round(y(value)), plotWidth(), 1);
    write(context, valueText(value, step).replace("-", "−"), GUTTER - 7, y(value), tones.dim, "right");
  }
  clipToPlot(context, band, () => {
    context.lineJoin = "round";
    for (const { values, color, error_bars } of row.curves) {
      context.globalAlpha = 0.22;
      context.fillStyle = tones[color];
      if (error_bars.length) context.fill(bandPath(values, error_bars, y));
      context.globalAlpha = 1;
    }
    for (const curve of row.curves) drawCurve(context, curve, y);
  });
}

/** Dotted and faint where what it measures is not seen.
 * @param {Context} context @param {Curve} curve @param {(value: number) => number} y */
function drawCurve(context, { values, color, unseen }, y) {
  let sure = values;
  if (unseen.length) {
    stroke(context, curvePath(values, y), tones[color], 1.4, { alpha: NOT_SURE, dash: [2, 3] });
    sure = [...values];
    for (const [first, last] of unseen) sure.fill(null, first, last + 1);
  }
  stroke(context, curvePath(sure, y), tones[color], 1.4);
}

/** The numbers on the axis: both ends, zero, and those between for which there is room.
 * @param {{ low: number, high: number, step: number }} scale @param {number} height of the axis, in CSS pixels */
function labelled({ low, high, step }, height) {
  const each = niceStep(high - low, height / LABELS);
  const numbers = [low, high];
  if (numbers.every((end) => apart(0, end))) numbers.push(0);
  for (let value = Math.ceil(low / each) * each; value < high; value += Math.max(each, step))
    if (numbers.every((other) => apart(value, other))) numbers.push(value);
  return numbers;

  /** @param {number} one @param {number} other */
  function apart(one, other) {
    return (Math.abs(one - other) / (high - low)) * height >= LABELS - 1;
  }
}

/** @param {Context} context @param {Levels} levels @param {Band} band */
function drawLevels(context, { parts, spans }, band) {
  const each = (band.bottom - band.top - 4) / parts.length;
  parts.forEach((part, i) => {
    const top = band.top + 2 + i * each;
    write(context, part, GUTTER - 7, top + each / 2, tones.dim, "right");
    clipToPlot(context, band, () => {
      spans[i].forEach((some, level) => {
        context.globalAlpha = STRENGTHS[level];
        for (const [first, last] of some) fillFrames(context, tones.text, first, last, top, each - 1);
      });
      context.globalAlpha = 1;
    });
  });
}

/** What each part does in a frame, in words; nothing where it is unknown.
 * @param {Levels} levels @param {number} frame */
export const levelWords = ({ parts, words, spans }, frame) =>
  parts.flatMap((part, i) => {
    const level = spans[i].findIndex((some) => some.some(([first, last]) => first <= frame && frame <= last));
    return level < 0 ? [] : [`${part} ${words[level]}`];
  });
