// The buttons in the panels' own HTML. Each element with data-tcfit is one: a command, with data-value.

import { emit } from "../connection.js";
import { DROPDOWN_INPUT, WINDOW_SURROUNDINGS } from "../viser/bridge.js";

/** @import { Press } from "../wire" */

/** @type {Press | null} */
let pressedFirst = null; // what the pointer went down on: the panel may be redrawn before it goes up

/** What a button says when it is pressed. @param {HTMLElement} button @returns {Press} */
export function commandOf({ dataset }) {
  return { type: "press", command: dataset.tcfit ?? "", value: dataset.value ?? "" };
}

/** The command under an event, if there is one. @param {Event} event */
function commandUnder({ target }) {
  const found = target instanceof Element ? target.closest("[data-tcfit]") : null;
  return found instanceof HTMLElement && !found.matches(":disabled") ? commandOf(found) : null;
}

window.addEventListener("pointerdown", (event) => {
  pressedFirst = event.button === 0 ? commandUnder(event) : null;
}, true);

window.addEventListener("pointerup", (event) => {
  const command = commandUnder(event);
  const same = command?.command === pressedFirst?.command && command?.value === pressedFirst?.value;
  if (command && same) emit(command);
  pressedFirst = null;
}, true);

window.addEventListener("click", (event) => {
  const command = event.detail === 0 ? commandUnder(event) : null; // by keyboard, or by assistive software
  if (command) emit(command);
}, true);

/** Presses the button that closes the window on top; whether there is one. */
export function closeWindow() {
  const button = [...document.querySelectorAll("[role=dialog] .tcfit-close")].pop();
  if (button instanceof HTMLElement) emit(commandOf(button));
  return Boolean(button);
}

window.addEventListener("pointerdown", ({ target }) => {
  if (target instanceof Element && target.matches(WINDOW_SURROUNDINGS)) closeWindow();
}, true);

// viser's dropdowns open as soon as they have the focus. Not after Tab, because the list would cover the
// next field: an arrow or a letter opens it.
let byTab = false;
window.addEventListener("keydown", ({ key }) => {
  byTab = key === "Tab";
}, true);
window.addEventListener("pointerdown", () => {
  byTab = false;
}, true);
window.addEventListener("focusin", (event) => {
  if (byTab && event.target instanceof Element && event.target.matches(DROPDOWN_INPUT)) event.stopPropagation();
}, true);

// Of a dropdown's text, so that what is typed is looked for and not added to it.
window.addEventListener("click", ({ target }) => {
  const field = target instanceof HTMLInputElement && target.matches(DROPDOWN_INPUT) ? target : null;
  if (field && field.selectionStart === field.selectionEnd) field.select();
}, true);
