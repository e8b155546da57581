// Names for those of viser's fields that have none for who does not see them: that of the label beside them.

import { CLOSE_BUTTON, FIELD_LABEL, NUMBER_INPUT, TEXT_INPUT } from "./bridge.js";

const FIELDS = `${NUMBER_INPUT}, ${TEXT_INPUT}, [role=slider]`;
const NEAR = 9; // levels up to which a field shares a row with its label
const ICONS = { "list-search": "Commands" };
const SETTLING = 200; // ms: panels come in many pieces

/** @param {Element} field */
const isNamed = (field) =>
  Boolean(field.getAttribute("aria-label")) || (field instanceof HTMLInputElement && Boolean(field.labels?.length));

/** What holds a field and the label beside it. @param {Element} field */
function rowOf(field) {
  let [row, level] = [field.parentElement, 0];
  while (row && level < NEAR && ![...row.children].some((child) => child.matches(FIELD_LABEL)))
    [row, level] = [row.parentElement, level + 1];
  return level < NEAR ? row : null;
}

function nameFields() {
  settling = false;
  nameButtons();
  for (const field of document.querySelectorAll(FIELDS)) {
    if (isNamed(field)) continue;
    const row = rowOf(field);
    const name = row?.querySelector(FIELD_LABEL)?.textContent;
    if (!row || !name) continue;
    const alike = [...row.querySelectorAll(FIELDS)];
    field.setAttribute("aria-label", alike.length > 1 ? `${name}, ${alike.indexOf(field) + 1}` : name);
  }
}

/** viser's own buttons that show an icon alone. */
function nameButtons() {
  for (const [icon, name] of Object.entries(ICONS))
    for (const image of document.querySelectorAll(`button:not([aria-label]) svg[class*="tabler-icon-${icon}"]`))
      image.closest("button")?.setAttribute("aria-label", name);
  for (const button of document.querySelectorAll(CLOSE_BUTTON)) button.setAttribute("aria-label", "Close");
}

let settling = false;
new MutationObserver(() => {
  if (!settling) setTimeout(nameFields, SETTLING);
  settling = true;
}).observe(document.body, { childList: true, subtree: true });
