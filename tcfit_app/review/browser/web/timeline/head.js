// The strip's head: the selected frames.

import { PATIENCE, emitLast, invalidate, states, watch } from "../connection.js";
import { element, strip } from "../elements.js";
import { frameNumber } from "./axis.js";
import { HEAD } from "./layout.js";
import { chosenRange, pointed } from "./pointed.js";

const head = element("div", "tcfit-strip-head", strip);
head.style.height = `${HEAD}px`;
const frames = element("div", "tcfit-strip-frames", head);
const chosen = element("span", "", frames);
button("×", "Clear frame selection", clearRange, frames);
export const more = button("⋯", "What to do with frames", null);
more.setAttribute("aria-haspopup", "menu");

/** @param {string} text @param {string} title @param {(() => void) | null} press @param {HTMLElement} parent */
function button(text, title, press, parent = head) {
  const made = element("button", "", parent, text);
  made.type = "button";
  made.title = title;
  if (text.length === 1) made.setAttribute("aria-label", title);
  if (press) made.addEventListener("click", press);
  return made;
}

export function clearRange() {
  pointed.range = null;
  emitLast({ type: "range", first: null, last: null });
  letGo();
}

/** What was pointed at stays as it is until the server says the same, or has had its time. */
export function letGo() {
  const { cursor, range } = pointed;
  setTimeout(() => {
    if (pointed.cursor === cursor) pointed.cursor = null;
    if (pointed.range === range) pointed.range = undefined;
    showChosen();
  }, PATIENCE);
  showChosen();
}

/** Names the selected frames in the head. */
export function showChosen() {
  const range = states.timeline ? chosenRange() : null; // it may come before the clip's own numbers
  frames.hidden = !range;
  if (range) {
    const [first, last] = [range.first, range.last].map(frameNumber);
    chosen.textContent = first === last ? `Frame ${first}` : `Frames ${first}–${last}`;
  }
  invalidate("cursor");
}

watch("timeline", () => {
  head.hidden = !states.timeline;
  showChosen();
});
