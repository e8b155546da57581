// The menus of the picture, by right click: on a keypoint what is chosen is done with all that are selected.

import { known, states } from "../connection.js";
import { onRightClick, openMenu } from "../menu.js";
import { REACH, canvasPlace, overScene, pick } from "./picking.js";
import { chosen, select, skeletonReady } from "./skeleton.js";

/** @param {MouseEvent} event */
function rightClick(event) {
  if (!skeletonReady()) return;
  const found = pick(canvasPlace(event), REACH);
  if (found && (chosen.suggested || !chosen.joints.has(found.joint))) select([found.joint], "replace");
  const menus = states.picture_menus;
  const groups = (found ? menus?.keypoints : menus?.elsewhere) ?? [];
  const items = groups.flatMap((group, i) => (i ? [null, ...group] : [...group]));
  const name = found ? known("skeleton").names[found.joint] : "Picture";
  openMenu(name, items, event.clientX, event.clientY);
}

onRightClick(overScene, rightClick);
