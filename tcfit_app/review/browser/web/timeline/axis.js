// The timeline's axis, its curves thinned to the pixels there are, and the scale of their values.

/** @import { Curve } from "../wire" */

import { known, states } from "../connection.js";
import { strip } from "../elements.js";

export const GUTTER = 178; // left of frame 0, for labels
export const MARGIN = 14; // right of the last frame
const FEWEST = 12; // frames that are shown at the closest

export let axis = { first: 0, last: 1 }; // edges of frames: frame f covers f to f + 1

export const clipLength = () => states.timeline?.length ?? 0;
export const plotWidth = () => Math.max(strip.clientWidth - GUTTER - MARGIN, 1);
/** @param {number} edge */
export const edgeX = (edge) => GUTTER + ((edge - axis.first) / (axis.last - axis.first)) * plotWidth();
/** @param {number} frame */
export const frameX = (frame) => edgeX(frame + 0.5);
/** @param {number} x */
const edgeAt = (x) => axis.first + ((x - GUTTER) / plotWidth()) * (axis.last - axis.first);
/** @param {number} frame */
const clampFrame = (frame) => Math.min(Math.max(frame, 0), clipLength() - 1);
/** @param {number} x */
export const frameAt = (x) => clampFrame(Math.floor(edgeAt(x)));

/** @type {(() => void)[]} */
const watchers = [];
/** Calls back whenever other frames are shown. @param {() => void} change */
export const onAxisChange = (change) => void watchers.push(change);

/** @param {number} first @param {number} last */
function setAxis(first, last) {
  axis = { first, last };
  for (const change of watchers) change();
}

/** Shows that many frames from there on, as far as the clip has them. @param {number} first @param {number} count */
export function showFrames(first, count) {
  const shown = Math.min(Math.max(count, Math.min(FEWEST, clipLength())), clipLength());
  const start = Math.min(Math.max(first, 0), clipLength() - shown);
  setAxis(start, start + shown);
}

export const shownCount = () => axis.last - axis.first;

/** @param {number} factor @param {number} x what stays where it is, in CSS pixels */
export function zoomAxis(factor, x) {
  const edge = edgeAt(x);
  const count = Math.min(Math.max(shownCount() * factor, Math.min(FEWEST, clipLength())), clipLength());
  showFrames(edge - ((edge - axis.first) * count) / shownCount(), count);
}

/** Shows the whole clip. */
export function showAll() {
  setAxis(0, Math.max(clipLength(), 1));
}

/** Turns the page where the cursor has left it. @param {number} frame */
export function followCursor(frame) {
  if (frame >= axis.first && frame + 1 <= axis.last) return;
  showFrames(frame - 0.1 * shownCount(), shownCount());
}

/** 1, 2 or 5 times a power of ten, so that about `count` of them fill the extent.
 * @param {number} extent @param {number} count */
export function niceStep(extent, count) {
  const raw = extent / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  return power * ([1, 2, 5].find((factor) => factor * power >= raw * 0.999) ?? 10);
}

const firstShown = () => Math.max(Math.floor(axis.first), 0);
const lastShown = () => Math.min(Math.ceil(axis.last), clipLength()) - 1;

/** The axis of values: from zero to a round number above what is on show, and below zero where values can be.
 * Null without values. @param {Curve[]} curves */
export function valueScale(curves) {
  let [low, high] = [Infinity, -Infinity];
  for (const { values, error_bars } of curves)
    for (let frame = firstShown(); frame <= lastShown(); frame++) {
      const value = values[frame];
      if (value === null || value === undefined) continue;
      const bar = error_bars[frame] ?? 0;
      if (value - bar < low) low = value - bar;
      if (value + bar > high) high = value + bar;
    }
  if (low > high) return null;
  const extent = Math.max(high, 0) - Math.min(low, 0) || 1;
  const step = niceStep(extent, 4);
  const top = Math.ceil(high / step - 1e-9) * step;
  const bottom = Math.floor(low / step + 1e-9) * step;
  return { low: Math.min(bottom, 0), high: Math.max(top, step), step };
}

/** A curve as a path. Where several frames share a pixel, from their lowest to their highest value.
 * @param {Curve["values"]} values @param {(value: number) => number} y */
export function curvePath(values, y) {
  const path = new Path2D();
  let pen = false;
  /** @param {number} x @param {number} value */
  const to = (x, value) => {
    if (pen) path.lineTo(x, y(value));
    else path.moveTo(x, y(value));
    pen = true;
  };
  for (const column of columns(values))
    if (!column) pen = false;
    else {
      to(column.x, column.low);
      if (column.high !== column.low) to(column.x, column.high);
    }
  return path;
}

/** The band of a curve's error bars, as a path to be filled: one shape for each run of values.
 * @param {Curve["values"]} values @param {Curve["error_bars"]} bars @param {(value: number) => number} y */
export function bandPath(values, bars, y) {
  const path = new Path2D();
  /** @param {1 | -1} side */
  const edge = (side) => [...columns(values.map((value, i) => shifted(value, bars[i], side)))];
  const [above, below] = [edge(1), edge(-1)];
  for (let start = 0; start < above.length; start++) {
    const upper = upTo(above, start);
    const lower = upTo(below, start).reverse();
    if (!upper.length) continue;
    path.moveTo(upper[0].x, y(upper[0].high));
    for (const { x, high } of upper) path.lineTo(x, y(high));
    for (const { x, low } of lower) path.lineTo(x, y(low));
    start += upper.length;
  }
  return path;
}

/** Those from one on, up to the first null. @param {(Column | null)[]} found @param {number} start */
function upTo(found, start) {
  const run = [];
  for (let i = start, column = found[i]; column; column = found[++i]) run.push(column);
  return run;
}

/** @param {number | null} value @param {number | null} bar @param {1 | -1} side */
const shifted = (value, bar, side) => (value === null || bar === null ? null : value + side * bar);

/** @typedef {{ x: number, low: number, high: number }} Column */

/** For each pixel (or frame, where these are wider) its extreme values, null without values.
 * @param {Curve["values"]} values @returns {Generator<Column | null>} */
function* columns(values) {
  const perColumn = Math.max(Math.floor(shownCount() / plotWidth()), 1);
  const begin = Math.max(Math.floor(firstShown() / perColumn) * perColumn - perColumn, 0);
  for (let first = begin; first <= lastShown() + perColumn && first < clipLength(); first += perColumn) {
    let [low, high] = [Infinity, -Infinity];
    const end = Math.min(first + perColumn, clipLength());
    for (let frame = first; frame < end; frame++) {
      const value = values[frame] ?? null;
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
    yield low > high ? null : { x: edgeX((first + end) / 2), low, high };
  }
}

/** A value with as many digits as tell its neighbours on the scale apart. @param {number} value @param {number} step */
export function valueText(value, step) {
  if (Math.abs(value) >= 1e5 || step < 1e-4) return value.toExponential(1);
  const digits = Math.max(0, Math.min(4, -Math.floor(Math.log10(step || 1) + 1e-9)));
  return value.toFixed(digits);
}

/** @param {number} frame */
export const frameNumber = (frame) => String(frame + known("timeline").first_frame);

/** Minutes, seconds and hundredths: "0:04.20". @param {number} frame */
export function clockText(frame) {
  const hundredths = Math.round((frame / known("timeline").frame_rate) * 100);
  const seconds = Math.floor(hundredths / 100);
  /** @param {number} number */
  const two = (number) => String(number).padStart(2, "0");
  return `${Math.floor(seconds / 60)}:${two(seconds % 60)}.${two(hundredths % 100)}`;
}
