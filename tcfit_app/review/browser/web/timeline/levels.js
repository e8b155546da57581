// Rows that show what parts of the body do in each frame: a line for each part, stronger for a higher level.

/** @import { Levels } from "../wire" */
/** @import { Band } from "./layout.js" */
/** @import { Context } from "./paint.js" */

import { tones } from "../theme.js";
import { GUTTER } from "./axis.js";
import { clipToPlot, fillFrames, write } from "./paint.js";

const STRENGTHS = [0.15, 0.4, 0.85]; // opacities, which differ without colour vision and in both themes

/** @param {Context} context @param {Levels} levels @param {Band} band */
export function drawLevels(context, { parts, spans }, band) {
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
