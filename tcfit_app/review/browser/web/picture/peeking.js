// While a key or a button is held, the pictures show the video alone: what the fits are judged by.

import { invalidate, watch } from "../connection.js";
import { redrawScene } from "../viser/bridge.js";

export const peeking = { now: false };

/** @param {boolean} now */
export function peek(now) {
  if (peeking.now === now) return;
  peeking.now = now;
  invalidate("overlay");
  redrawScene();
}

/** @param {Event} event */
const overButton = ({ target }) => target instanceof Element && target.closest(".tcfit-held") !== null;

window.addEventListener("pointerdown", (event) => {
  if (event.button === 0 && overButton(event)) peek(true);
}, true);
for (const type of ["pointerup", "pointercancel"]) window.addEventListener(type, () => peek(false), true);
window.addEventListener("keydown", (event) => {
  if (["Enter", " "].includes(event.key) && overButton(event)) peek(true);
}, true);

// A page that has lost the focus does not receive the key's release.
window.addEventListener("blur", () => peek(false));
document.addEventListener("visibilitychange", () => peek(false));
watch("lost", () => peek(false));
