// Enter in a text field of viser's presses the button below it that is meant for that, unless another field is between.

const HELD_BACK = 100; // ms: viser holds what is typed back for 50, and it must not come after the press

/** The button for which Enter in this field stands. */
function buttonOf(field) {
  const follows = (other) => field.compareDocumentPosition(other) & Node.DOCUMENT_POSITION_FOLLOWING;
  const next = [...document.querySelectorAll("input.mantine-TextInput-input, button[data-enter]")].find(follows);
  return next?.matches("button:enabled") ? next : null;
}

window.addEventListener("keydown", (event) => {
  const { key, target, isComposing } = event;
  if (key !== "Enter" || isComposing || !(target instanceof HTMLInputElement)) return;
  if (!target.matches(".mantine-TextInput-input")) return;
  const command = commandOf({ target: buttonOf(target) });
  if (!command) return;
  swallow(event);
  setTimeout(emit, HELD_BACK, command);
}, capturing);
