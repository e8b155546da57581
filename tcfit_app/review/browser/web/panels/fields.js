// viser's fields in the panels: a number that was erased comes back, Enter presses the button that is meant for it, and
// a file that is too large stays here.

import { emit, largestUpload } from "../connection.js";
import { NUMBER_INPUT, TEXT_INPUT } from "../viser/bridge.js";
import { swallow } from "../keys.js";
import { commandOf } from "./buttons.js";

// --- numbers: viser sends nothing when a field has been emptied. Left empty, it would hide the value in effect. ---

/** @type {{ field: HTMLInputElement, value: string } | null} */
let erased = null; // the field that was erased last, and the value that was
let erasing = false; // whether the last input took something away

window.addEventListener("beforeinput", ({ target, inputType }) => {
  if (!(target instanceof HTMLInputElement && target.matches(NUMBER_INPUT))) return;
  const marked = target.selectionStart !== target.selectionEnd;
  const goesOn = erasing && erased?.field === target && !marked;
  const erases = marked || inputType.startsWith("delete");
  if (erases && !goesOn && /\d/.test(target.value)) erased = { field: target, value: target.value };
  erasing = erases;
}, true);

// After viser's own handler, which strips everything that is not a number.
window.addEventListener("focusout", ({ target }) => {
  if (erased && erased.field === target) setTimeout(bringBack, 0, erased);
}, true);

/** Gives an empty field the value that it had, as if it was typed: viser then sends it.
 * @param {{ field: HTMLInputElement, value: string }} erased */
function bringBack({ field, value }) {
  if (field.value !== "" || !field.isConnected || document.activeElement === field) return;
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value")?.set?.call(field, value);
  field.dispatchEvent(new Event("input", { bubbles: true }));
}

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
