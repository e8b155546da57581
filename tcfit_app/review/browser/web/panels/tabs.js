// The panel on show stays on show over a reload and a new connection, for which viser makes all of them again.

/** @import { ShowPanel } from "../wire" */

import { watch } from "../connection.js";
import { TEXT_INPUT } from "../viser/bridge.js";

const PANEL = "tcfit-panel"; // in the session's storage
const LOOKING = 100; // ms between two looks for it
const LOOKS = 150;
const STILL = 10; // looks for which it must have stayed

/** @returns {HTMLElement[]} */
const allTabs = () => [...document.querySelectorAll("[role=tab]")].filter((tab) => tab instanceof HTMLElement);

/** viser's tabs can be dragged: what chooses one is the pointer's press and release. @param {Element} tab */
function pressTab(tab) {
  const { x, y } = tab.getBoundingClientRect();
  const pointer = { bubbles: true, cancelable: true, button: 0, pointerId: 1, clientX: x + 1, clientY: y + 1 };
  for (const type of ["pointerdown", "pointerup"]) tab.dispatchEvent(new PointerEvent(type, pointer));
}

/** Panels come some time after the picture, one by one, and viser shows the first of them until all are there.
 * @param {number} looks that are left @param {number} still looks for which it has stayed */
function restorePanel(looks, still) {
  const wanted = sessionStorage.getItem(PANEL);
  if (!wanted || !looks || still === STILL) return;
  const tab = allTabs().find(({ title }) => title === wanted);
  const shown = tab?.getAttribute("aria-selected") === "true";
  if (tab && !shown) pressTab(tab);
  setTimeout(restorePanel, LOOKING, looks - 1, shown ? still + 1 : 0);
}

window.addEventListener("click", ({ target }) => {
  const tab = allTabs().find((each) => target instanceof Node && each.contains(target));
  if (tab) sessionStorage.setItem(PANEL, tab.title);
}, true);

/** Shows a panel and lets the user type into one of its fields, if one is named, once they are there.
 * @param {ShowPanel} request @param {number} looks that are left */
export function showPanel({ panel, field: name }, looks = LOOKS) {
  const tab = allTabs().find(({ title }) => title === panel);
  if (tab && tab.getAttribute("aria-selected") !== "true") {
    pressTab(tab);
    sessionStorage.setItem(PANEL, panel);
  }
  if (tab && !name) return;
  const fields = [...document.querySelectorAll(TEXT_INPUT)].filter((field) => field instanceof HTMLInputElement);
  const field = fields.find((each) => isShown(each) && nameOf(each) === name);
  if (field) field.focus();
  else if (looks) setTimeout(showPanel, LOOKING, { panel, field: name }, looks - 1);
}

/** @param {HTMLInputElement} field */
const isShown = (field) => field.getClientRects().length > 0;
/** @param {HTMLInputElement} field */
const nameOf = (field) => field.getAttribute("aria-label") ?? field.labels?.[0]?.textContent ?? "";

watch("skeleton", (skeleton) => {
  if (skeleton) setTimeout(restorePanel, LOOKING, LOOKS, 0);
});
