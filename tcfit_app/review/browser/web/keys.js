// The app's keys, seen before viser sees them.

import { emit, states } from "./connection.js";
import { leaveField } from "./elements.js";
import { closeWindow } from "./panels/buttons.js";
import { cancelGesture } from "./picture/dragging.js";

const TEXT_FIELDS = "textarea, select, [contenteditable]:not([contenteditable=false]), [role=dialog] *, " +
  "[role=menu] *, input:not([type=checkbox], [type=radio], [type=range], [type=button], [type=submit])";
// Controls that only Enter and Space operate: not tabs or radio buttons, which use the arrow keys.
const BUTTONS = ":is(button, [role=button], input[type=checkbox], input[type=button], input[type=submit])" +
  ":not([role=tab], [role=radio], [role=slider])";
const PRESSING_KEYS = ["Enter", " "];
// They would move viser's camera: in 3D S and D did that and not what their buttons say. The mouse moves it.
const CAMERA_KEYS = ["KeyW", "KeyA", "KeyS", "KeyD", "KeyQ", "KeyE"].concat(
  ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"],
);

// Checked on focus: by the next key press, :focus-visible would match a clicked button too.
/** @type {EventTarget | null} */
let reachedByKeyboard = null;
window.addEventListener("focusin", ({ target }) => {
  reachedByKeyboard = target instanceof Element && target.matches(":focus-visible") ? target : null;
}, true);

/** Whether what has the focus needs this key: a field, or a button or slider that was reached by keyboard. A menu that
 * was closed by Escape gives the focus back to its button, as if that had been reached so.
 * @param {KeyboardEvent} event */
function keyIsTaken(event) {
  const target = event.target instanceof Element ? event.target : document.body;
  if (target.closest(TEXT_FIELDS)) return true;
  return target === reachedByKeyboard && (!target.matches(BUTTONS) || PRESSING_KEYS.includes(event.key));
}

/** The letter or sign on the key; where the keyboard writes no Latin letters, what an American one has there.
 * @param {KeyboardEvent} event */
function characterOf({ key, code }) {
  const latin = key.length !== 1 || /[ -~]/.test(key);
  return (latin ? key : code.replace(/^Key/, "")).toLowerCase();
}

/** @param {KeyboardEvent} event */
function bindingFor(event) {
  const character = characterOf(event);
  // Keyboards have signs with Shift, with AltGr or, on a Mac, with Alt.
  const isSign = /^[^a-z0-9 ]$/.test(character);
  const alt = event.altKey || event.getModifierState("AltGraph");
  return states.keys?.bindings.find(
    ({ key, shift, ctrl }) =>
      ctrl === (event.ctrlKey || event.metaKey) &&
      ((isSign && key === character) ||
        (!alt && shift === event.shiftKey && (key === event.code || key === character))),
  );
}

/** @param {KeyboardEvent} event */
function keyDown(event) {
  if (event.isComposing) return;
  if (event.key === "Escape" && (closeWindow() || cancelGesture())) return swallow(event);
  if (keyIsTaken(event)) return;
  const plain = !event.ctrlKey && !event.metaKey && !event.altKey;
  const binding = bindingFor(event);
  if (binding) emit({ type: "key", action: binding.action, repeat: event.repeat });
  if (!binding && !(plain && CAMERA_KEYS.includes(event.code))) return;
  if (event.target === reachedByKeyboard) keepFromOthers(event); // keyboard users keep their focus
  else swallow(event);
}

/** Keeps a key from viser and from the browser. @param {KeyboardEvent} event */
function keepFromOthers(event) {
  event.preventDefault();
  event.stopPropagation();
}

/** The same, and takes the focus from what has it. @param {KeyboardEvent} event */
export function swallow(event) {
  keepFromOthers(event);
  // A button clicked with the mouse keeps the focus, and would take the space bar's release for a click.
  leaveField();
}

window.addEventListener("keydown", keyDown, true);
