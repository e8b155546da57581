// The row of the video: small pictures, each at its frame.

/** @import { Band } from "./layout.js" */
/** @import { Context } from "./paint.js" */

import { invalidate, watch } from "../connection.js";
import { tones } from "../theme.js";
import { GUTTER, frameX } from "./axis.js";
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

/** As many as have room beside each other, all of one size, or why there are none.
 * @param {Context} context @param {string} empty @param {Band} band */
export function drawThumbnails(context, empty, band) {
  const [top, height] = [band.top + 2, band.bottom - band.top - 5];
  if (!pictures.size) return write(context, empty, GUTTER + 12, top + height / 2, tones.dim);
  clipToPlot(context, band, () => {
    const all = [...pictures];
    const [[first, picture], [last]] = [all[0], all[all.length - 1]];
    const width = (height * picture.width) / picture.height;
    const room = (frameX(last) - frameX(first)) / (all.length - 1); // of each, so that gaps are of one size
    const each = room > 0 ? Math.ceil((width + 2) / room) : 1;
    context.imageSmoothingEnabled = true;
    for (let i = Math.floor(each / 2); i < all.length; i += each)
      context.drawImage(all[i][1], frameX(all[i][0]) - width / 2, top, width, height);
  });
}
