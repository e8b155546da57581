// viser's fields in the panels: Enter presses the button that is meant for it, and a file that is too large stays here.

import { emit, largestUpload } from "../connection.js";
import { TEXT_INPUT } from "../viser/bridge.js";
import { swallow } from "../keys.js";
import { commandOf } from "./buttons.js";

// --- text ---

const HELD_BACK = 100; // ms: viser holds what is typed back for 50, and it must not come after the press

/** The button for which Enter in this field stands: the one below it, unless another field is between.
 * @param {HTMLInputElement} field */
function buttonOf(field) {
  /** @param {Element} other */
  const follows = (other) => field.compareDocumentPosition(other) & Node.DOCUMENT_POSITION_FOLLOWING;
  const next = [...document.querySelectorAll(`${TEXT_INPUT}, button[data-enter]`)].find(follows);
  return next instanceof HTMLButtonElement && next.dataset.tcfit && !next.disabled ? next : null;
}

window.addEventListener("keydown", (event) => {
  const { key, target, isComposing } = event;
  if (key !== "Enter" || isComposing || !(target instanceof HTMLInputElement)) return;
  const button = target.matches(TEXT_INPUT) ? buttonOf(target) : null;
  if (!button) return;
  swallow(event);
  setTimeout(emit, HELD_BACK, commandOf(button));
}, true);

// --- files: viser would upload the whole file and show its progress forever ---

window.addEventListener("change", (event) => {
  const { target } = event;
  const file = target instanceof HTMLInputElement && target.type === "file" ? target.files?.[0] : null;
  if (!file || file.size <= largestUpload) return;
  event.stopImmediatePropagation();
  emit({ type: "too_large", name: [...file.name].slice(-64).join(""), size: file.size });
}, true);
