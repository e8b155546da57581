// The menus of the picture, by right click: on a keypoint what is chosen is done with all that are selected.

import { known, states } from "../connection.js";
import { openMenu } from "../menu.js";
import { REACH, canvasPlace, overScene, pick } from "./picking.js";
import { chosen, select, skeletonReady } from "./skeleton.js";

/** Where the right button went down: a drag with it moves the picture. @type {{ x: number, y: number } | null} */
let pressed = null;
const STILL = 4; // CSS pixels

/** @param {PointerEvent} event */
function press(event) {
  if (event.button === 2) pressed = { x: event.clientX, y: event.clientY };
}

/** @param {MouseEvent} event */
function rightClick(event) {
  const still = pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) <= STILL;
  if (!still || !overScene(event) || !skeletonReady()) return;
  const found = pick(canvasPlace(event), REACH);
  event.preventDefault();
  if (found && (chosen.suggested || !chosen.joints.has(found.joint))) select([found.joint], "replace");
  const menus = states.picture_menus;
  const groups = (found ? menus?.keypoints : menus?.elsewhere) ?? [];
  const items = groups.flatMap((group, i) => (i ? [null, ...group] : [...group]));
  const name = found ? known("skeleton").names[found.joint] : "Picture";
  openMenu(name, items, event.clientX, event.clientY);
}

window.addEventListener("pointerdown", press, true);
window.addEventListener("contextmenu", rightClick, true);
