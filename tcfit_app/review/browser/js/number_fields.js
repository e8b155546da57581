// viser sends nothing when a number field has been emptied: left so, it would hide the value that counts.

let erased = null; // the field that was erased last, and the value that was: { field, value }
let erasing = false; // whether the last input took something away

const isNumberField = (target) => target instanceof HTMLInputElement && target.matches(".mantine-NumberInput-input");

window.addEventListener("beforeinput", ({ target, inputType }) => {
  if (!isNumberField(target)) return;
  const marked = target.selectionStart !== target.selectionEnd;
  const goesOn = erasing && erased?.field === target && !marked;
  const erases = marked || inputType.startsWith("delete");
  if (erases && !goesOn && /\d/.test(target.value)) erased = { field: target, value: target.value };
  erasing = erases;
}, capturing);

// Later than viser's own: that takes away what is no number.
window.addEventListener("focusout", ({ target }) => {
  if (erased?.field === target) setTimeout(bringBack, 0, erased);
}, capturing);

/** Gives an empty field the value that it had, as if it was typed: viser then sends it. */
function bringBack({ field, value }) {
  if (field.value !== "" || !field.isConnected || document.activeElement === field) return;
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(field, value);
  field.dispatchEvent(new Event("input", { bubbles: true }));
}
