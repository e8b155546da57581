// Rows that are heat maps: a line for each part of the body, whose colour says how high a value is.

/** @import { Heat } from "../wire" */
/** @import { Band } from "./layout.js" */
/** @import { Context } from "./paint.js" */

import { tones } from "../theme.js";
import { GUTTER, axis, clipLength, plotWidth, shownCount } from "./axis.js";
import { write } from "./paint.js";

const LABEL = 13; // CSS pixels that a part's name needs
/** From what is as it should be to what is to be looked at: ever lighter, so also without colour vision. */
const RAMP = [[27, 31, 38], [66, 32, 92], [150, 40, 92], [222, 84, 62], [250, 167, 66], [255, 240, 170]];
const NONE = [20, 23, 28]; // the strip's own colour

/** @param {Context} context @param {Heat} heat @param {Band} band */
export function drawHeat(context, heat, { top, bottom }) {
  const [width, height] = [Math.floor(plotWidth()), heat.parts.length];
  const image = context.createImageData(width, height);
  heat.values.forEach((values, part) => {
    for (let x = 0; x < width; x++) {
      const color = colorOf(heat, worstAt(heat, values, x, width));
      image.data.set([...color, 255], 4 * (part * width + x));
    }
  });
  const canvas = new OffscreenCanvas(width, height);
  /** @type {OffscreenCanvasRenderingContext2D} */ (canvas.getContext("2d")).putImageData(image, 0, 0);
  context.imageSmoothingEnabled = false;
  context.drawImage(canvas, GUTTER, top + 2, plotWidth(), bottom - top - 4);
  drawParts(context, heat, { top, bottom });
}

/** @param {Heat} heat @param {number | null} value */
function colorOf({ top, worse }, value) {
  if (value === null) return NONE;
  const share = Math.min(Math.max(value / top, 0), 1);
  const place = (worse === "low" ? 1 - share : share) * (RAMP.length - 1);
  const from = Math.min(Math.floor(place), RAMP.length - 2);
  return RAMP[from].map((channel, i) => channel + (place - from) * (RAMP[from + 1][i] - channel));
}

/** Of all frames that share a pixel, so that no single bad one is passed over.
 * @param {Heat} heat @param {Heat["values"][number]} values @param {number} x @param {number} width */
function worstAt({ worse }, values, x, width) {
  const first = Math.floor(axis.first + (x / width) * shownCount());
  const end = Math.max(Math.floor(axis.first + ((x + 1) / width) * shownCount()), first + 1);
  /** @type {number | null} */
  let worst = null;
  for (let frame = Math.max(first, 0); frame < Math.min(end, clipLength()); frame++) {
    const value = values[frame] ?? null;
    if (value !== null && (worst === null || (worse === "high" ? value > worst : value < worst))) worst = value;
  }
  return worst;
}

/** Their names, where there is room for them, and what the lightest colour stands for.
 * @param {Context} context @param {Heat} heat @param {Band} band */
function drawParts(context, { parts, top, worse }, { top: y, bottom }) {
  const each = (bottom - y - 4) / parts.length;
  if (each >= LABEL)
    return parts.forEach((part, i) => write(context, part, GUTTER - 7, y + 2 + (i + 0.5) * each, tones.dim, "right"));
  const [low, high] = worse === "high" ? ["0", `${Number(top.toPrecision(2))}+`] : [String(top), "0"];
  [high, low].forEach((text, i) => {
    const middle = i === 0 ? y + 9 : bottom - 9;
    write(context, text, GUTTER - 22, middle, tones.dim, "right");
    context.fillStyle = i === 0 ? `rgb(${RAMP[RAMP.length - 1]})` : `rgb(${RAMP[0]})`;
    context.fillRect(GUTTER - 17, middle - 5, 10, 10);
    context.strokeStyle = tones.dim;
    context.lineWidth = 0.75;
    context.strokeRect(GUTTER - 17, middle - 5, 10, 10);
  });
}

/** The part at a height of the strip, and what it has in a frame; null where nothing is known.
 * @param {Heat} heat @param {Band} band @param {number} y @param {number} frame */
export function partAt({ parts, values }, { top, bottom }, y, frame) {
  const part = Math.floor(((y - top - 2) / (bottom - top - 4)) * parts.length);
  const value = values[part]?.[frame] ?? null;
  return value === null ? null : { part: parts[part], value };
}

/** The part that is worst in a frame; null where nothing is known. @param {Heat} heat @param {number} frame */
export function worstPart({ parts, values, worse }, frame) {
  /** @type {{ part: string, value: number } | null} */
  let worst = null;
  parts.forEach((part, i) => {
    const value = values[i][frame] ?? null;
    if (value === null) return;
    if (!worst || (worse === "high" ? value > worst.value : value < worst.value)) worst = { part, value };
  });
  return /** @type {{ part: string, value: number } | null} */ (worst);
}
