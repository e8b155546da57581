// The row of the video: small pictures, each at its frame.

/** @import { Band } from "./layout.js" */
/** @import { Context } from "./paint.js" */

import { invalidate, watch } from "../connection.js";
import { tones } from "../theme.js";
import { GUTTER, frameX, plotWidth } from "./axis.js";
import { clipToPlot, write } from "./paint.js";

/** @type {Map<number, ImageBitmap>} */
const pictures = new Map(); // by frame, in its order

watch("thumbnails", async (thumbnails) => {
  if (!thumbnails) return pictures.clear();
  const { frames, images } = thumbnails;
  const made = await Promise.all(images.map((image, i) => pictures.get(frames[i]) ?? decoded(image)));
  pictures.clear();
  frames.forEach((frame, i) => pictures.set(frame, made[i]));
  invalidate("timeline");
});

/** @param {string} image a JPEG in base64 */
const decoded = (image) =>
  createImageBitmap(new Blob([Uint8Array.from(atob(image), (letter) => letter.charCodeAt(0))], { type: "image/jpeg" }));

/** As many as have room beside each other, or why there are none.
 * @param {Context} context @param {string} empty @param {Band} band */
export function drawThumbnails(context, empty, band) {
  const [top, height] = [band.top + 2, band.bottom - band.top - 5];
  if (!pictures.size) write(context, empty, GUTTER + 12, top + height / 2, tones.dim);
  clipToPlot(context, band, () => {
    let free = -Infinity; // where the last one ends
    for (const [frame, picture] of pictures) {
      const width = (height * picture.width) / picture.height;
      const left = frameX(frame) - width / 2;
      if (left < free || left > GUTTER + plotWidth() || left + width < GUTTER) continue;
      context.imageSmoothingEnabled = true;
      context.drawImage(picture, left, top, width, height);
      free = left + width + 2;
    }
  });
}
