// The divider of two pictures that share a window: left of it the first is seen, right of it the other.

/** @import { PosterMap } from "./projection.js" */

import { invalidate } from "../connection.js";
import { element, layer } from "../elements.js";
import { redrawScene } from "../viser/bridge.js";
import { divider, drawn } from "./projection.js";

const [LEAST, MOST] = [0.02, 0.98]; // of the window's width: it stays in sight
const STEP = 0.02; // of an arrow key

const handle = element("div", "tcfit-divider", layer);
handle.hidden = true;
handle.tabIndex = 0;
for (const [name, value] of Object.entries({
  role: "slider", "aria-label": "Divider between A and B", "aria-valuemin": "0", "aria-valuemax": "100",
}))
  handle.setAttribute(name, value);

/** Puts it where the pictures meet, if they share a window. @param {PosterMap[]} maps @param {boolean} shared */
export function placeDivider(maps, shared) {
  handle.hidden = !shared || !maps.length;
  if (handle.hidden) return;
  const { seen } = maps[0];
  handle.style.transform = `translate(${Math.round(seen.right)}px, ${Math.round(seen.top)}px)`;
  handle.style.height = `${Math.round(seen.bottom - seen.top)}px`;
  const percent = Math.round(100 * divider.share);
  handle.setAttribute("aria-valuenow", String(percent));
  handle.setAttribute("aria-valuetext", `A ${percent} %, B ${100 - percent} %`);
}

/** @param {number} share */
function moveTo(share) {
  divider.share = Math.min(Math.max(share, LEAST), MOST);
  invalidate("overlay");
  redrawScene();
}

/** @param {PointerEvent} event */
function follow(event) {
  if (!handle.hasPointerCapture(event.pointerId) || !drawn.maps.length) return;
  const { left, right } = drawn.maps[0].window;
  moveTo((event.clientX - layer.getBoundingClientRect().left - left) / (right - left));
}

handle.addEventListener("pointerdown", (event) => {
  if (event.button === 0) handle.setPointerCapture(event.pointerId);
});
handle.addEventListener("pointermove", follow);
handle.addEventListener("dblclick", () => moveTo(0.5));
handle.addEventListener("keydown", ({ key }) => {
  if (key === "ArrowLeft" || key === "ArrowRight") moveTo(divider.share + (key === "ArrowLeft" ? -STEP : STEP));
});
