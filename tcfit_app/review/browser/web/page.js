// All of the script's parts, and what the server can call of them.

/** @import { PageRequest } from "./wire" */

import "./bars/bar.js";
import { connect, receive, states, watch } from "./connection.js";
import "./keys.js";
import { copyLink, leave } from "./links.js";
import "./notice.js";
import "./panels/buttons.js";
import "./panels/fields.js";
import { showPanel } from "./panels/tabs.js";
import "./picture/dragging.js";
import { fitPlaces } from "./picture/fits.js";
import "./picture/overlay.js";
import { posterMaps, toScreen } from "./picture/projection.js";
import { switchTheme } from "./theme.js";
import "./timeline/drawing.js";
import "./timeline/gestures.js";
import "./timeline/menus.js";
import "./timeline/titles.js";
import "./viser/arrival.js";
import { STEPS, remember } from "./remembered.js";
import { canvas } from "./viser/bridge.js";
import { dress, setColorTable } from "./viser/meshes.js";
import "./viser/names.js";

/** @type {{ [type in PageRequest["type"]]: (request: any) => void }} */
const REQUESTS = {
  show_panel: showPanel,
  copy_link: copyLink,
  leave,
  steps_read: () => remember(STEPS, "read"),
  switch_theme: switchTheme,
};

export const calls = {
  connect,
  receive,
  /** @param {PageRequest} request */
  perform: (request) => REQUESTS[request.type](request),
  dress,
  setColorTable,
  /** What the server sent last under a name. @param {keyof typeof states} name */
  state: (name) => states[name] ?? null,
  /** Where a pixel of a poster's image is in the window, in CSS pixels; null without such a poster.
   * @param {number} x @param {number} y @param {number} [poster] */
  place(x, y, poster = 0) {
    const map = posterMaps()[poster];
    if (!map) return null;
    const { left, top } = canvas().getBoundingClientRect();
    const [right, down] = toScreen(map, [x, y]);
    return [left + right, top + down];
  },
  /** Where a fit's keypoint is in the window, on the side view's poster or in 3D; null if it is not there.
   * @param {number} joint @param {number} [poster] */
  placeOfFit(joint, poster = 0) {
    const map = posterMaps()[poster];
    const found = map && fitPlaces(map, [joint]).at(-1);
    if (!found) return null;
    const { left, top } = canvas().getBoundingClientRect();
    return [left + found.x, top + found.y];
  },
};

// The curtain that the server lays over viser's page is lifted from the canvas when the first picture is there, and
// from the panels when they are.

const LOOKING = 50; // milliseconds between two looks for the panels

function liftFromPanels() {
  if (document.querySelector("[role=tab]")) document.documentElement.classList.add("tcfit-ready");
  else setTimeout(liftFromPanels, LOOKING);
}

let drawn = false;
watch("layout", (layout) => {
  if (!layout || drawn) return;
  drawn = true;
  document.documentElement.classList.add("tcfit-drawn");
  liftFromPanels();
});
