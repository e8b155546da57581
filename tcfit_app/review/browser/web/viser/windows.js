// Posters in windows of their own on viser's one canvas: each is moved into its window right before the scene is drawn,
// and nothing of it is drawn outside.

/** @import { Box } from "./meshes.js" */

import { nodeOf } from "./bridge.js";
import { hookOf } from "./meshes.js";

/** Draws a node in a window. @param {string} name @param {[x: number, y: number]} place its own, in viser's world
 * @param {Box} window */
export function drawInWindow(name, [x, y], window) {
  const node = nodeOf(name);
  if (!node) return;
  node.position.set(x, y, 0);
  node.updateMatrixWorld(true);
  node.traverse((child) => {
    if (child.isMesh) hookOf(child).window = window;
  });
}

const NOWHERE = { left: 0, top: 0, right: 0, bottom: 0 };

/** Draws nothing of a node. @param {string} name */
export function leaveOut(name) {
  nodeOf(name)?.traverse((child) => {
    if (child.isMesh) hookOf(child).window = NOWHERE;
  });
}
