// The buttons in the panels' own HTML. Each element with data-tcfit is one: a command, with data-value; or, with
// data-menu, a button that opens a menu, each line of which is the same command with a value of its own.

import { emit } from "../connection.js";
import { openMenuAt } from "../menu.js";
import { DROPDOWN_INPUT, WINDOW_SURROUNDINGS } from "../viser/bridge.js";

/** @import { MenuItem } from "../menu.js" */
/** @import { Press } from "../wire" */
/** @typedef {MenuItem & { value: string, more?: (Line | null)[] }} Line of a menu as the server sends it */

/** @type {Press | null} */
let pressedFirst = null; // what the pointer went down on: the panel may be redrawn before it goes up

/** What a button says when it is pressed. @param {HTMLElement} button @returns {Press} */
export function commandOf({ dataset }) {
  return { type: "press", command: dataset.tcfit ?? "", value: dataset.value ?? "" };
}

/** The button under an event, if there is one. @param {Event} event @returns {HTMLElement | null} */
function buttonUnder({ target }) {
  const found = target instanceof Element ? target.closest("[data-tcfit]") : null;
  return found instanceof HTMLElement && !found.matches(":disabled") ? found : null;
}

/** @param {HTMLElement} button */
function press(button) {
  const { menu, tcfit = "" } = button.dataset;
  if (menu === undefined) emit(commandOf(button));
  else openMenuAt(button.ariaLabel ?? button.innerText, JSON.parse(menu).map(lineOf(tcfit)), button);
}

/** @param {string} command @returns {(line: Line | null) => MenuItem | null} */
const lineOf = (command) => (line) => line && {
  ...line,
  more: line.more?.map(lineOf(command)),
  run: () => emit({ type: "press", command, value: line.value }),
};

window.addEventListener("pointerdown", (event) => {
  const button = event.button === 0 ? buttonUnder(event) : null;
  pressedFirst = button && commandOf(button);
}, true);

window.addEventListener("pointerup", (event) => {
  const button = buttonUnder(event);
  const command = button && commandOf(button);
  const same = command?.command === pressedFirst?.command && command?.value === pressedFirst?.value;
  if (button && same) press(button);
  pressedFirst = null;
}, true);

window.addEventListener("click", (event) => {
  const button = event.detail === 0 ? buttonUnder(event) : null; // by keyboard, or by assistive software
  if (button) press(button);
}, true);

// viser replaces all HTML of a board when it changes, and with it the button that has the focus.
/** @type {HTMLElement | null} */
let focused = null; // by keyboard
window.addEventListener("focusin", ({ target }) => {
  focused = target instanceof HTMLElement && target.matches(".tcfit-panel [data-tcfit]:focus-visible") ? target : null;
}, true);
window.addEventListener("focusout", () => {
  setTimeout(() => focused?.isConnected && document.activeElement !== focused && (focused = null));
}, true);
new MutationObserver(() => {
  if (!focused || focused.isConnected || document.activeElement !== document.body) return;
  const { command, value } = commandOf(focused);
  const same = document.querySelector(`[data-tcfit="${command}"][data-value="${CSS.escape(value)}"]`);
  focused = null;
  if (same instanceof HTMLElement) same.focus({ preventScroll: true });
}).observe(document.documentElement, { childList: true, subtree: true });

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
