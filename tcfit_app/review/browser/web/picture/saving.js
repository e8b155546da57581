// The picture as a file: what the canvas shows, the video's frame, bodies and keypoints, as a PNG.

/** @import { SavePicture } from "../wire" */

import { overlayCanvas } from "../elements.js";
import { drawnCanvas } from "../viser/bridge.js";

/** Saves what is on show. @param {SavePicture} request */
export function savePicture({ name }) {
  const scene = drawnCanvas();
  const whole = document.createElement("canvas");
  [whole.width, whole.height] = [scene.width, scene.height];
  const context = /** @type {CanvasRenderingContext2D} */ (whole.getContext("2d"));
  context.fillStyle = getComputedStyle(document.body).backgroundColor;
  context.fillRect(0, 0, whole.width, whole.height);
  context.drawImage(scene, 0, 0);
  context.drawImage(overlayCanvas, 0, 0, whole.width, whole.height);
  whole.toBlob((blob) => blob && download(blob, name), "image/png");
}

/** @param {Blob} blob @param {string} name */
function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
