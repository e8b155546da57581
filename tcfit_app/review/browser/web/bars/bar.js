// The bar under the picture. The server makes its buttons; what changes while the clip plays or the pointer moves is
// drawn here: the frame's number and time, and the selected frames.

import { PATIENCE, emitLast, invalidate, states, watch } from "../connection.js";
import { bar, element } from "../elements.js";
import { clipLength, clockText, frameNumber } from "../timeline/axis.js";
import { chosenRange, cursorFrame, pointed } from "../timeline/pointed.js";
import { place } from "./markup.js";

// --- the frame on show ---

const field = element("input", "");
field.setAttribute("aria-label", "Frame");
field.title = "Frame on show: type a number to go to it";
field.inputMode = "numeric";
const length = element("span", "tcfit-dim");
const time = element("span", "tcfit-dim tcfit-time");
const clock = new Text();
time.append(clock);

/** Number and time of the frame on show. A number that is being typed stays. */
export function showFrame() {
  const frame = cursorFrame();
  if (frame === null || !states.timeline) return;
  if (document.activeElement !== field) field.value = frameNumber(frame);
  clock.data = `· ${clockText(frame)}`; // of the same node: a new one would have the page's fields looked through
}

/** Goes to the frame whose number was typed, or to the nearest one. */
function goToTyped() {
  const typed = field.value.trim();
  const frame = Number(typed) - (states.timeline?.first_frame ?? 0);
  if (typed !== "" && Number.isFinite(frame) && frame !== states.cursor?.frame)
    emitLast({ type: "seek", frame: Math.min(Math.max(Math.round(frame), 0), clipLength() - 1) });
}

field.addEventListener("focus", () => field.select());
field.addEventListener("blur", showFrame);
field.addEventListener("keydown", (event) => {
  if (event.key === "Enter") goToTyped();
  if (event.key === "Enter" || event.key === "Escape") field.blur();
  event.stopPropagation(); // viser's own keys
});

// --- the selected frames ---

/** Opens the menu of frames. */
export const chip = element("button", "");
chip.setAttribute("aria-haspopup", "menu");
const [word, chosen] = [element("span", "tcfit-word", chip), element("span", "", chip)];
const cross = element("button", "", null, "×");
cross.title = "Clear frame selection";
cross.setAttribute("aria-label", cross.title);
cross.addEventListener("click", clearRange);
const hint = element("span", "tcfit-dim tcfit-hint", null, "Drag in the ruler to select frames");

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

/** Names the selected frames. */
export function showChosen() {
  const range = states.timeline ? chosenRange() : null; // it may come before the clip's own numbers
  cross.hidden = !range;
  hint.hidden = Boolean(range);
  const [first, last] = range ? [range.first, range.last].map(frameNumber) : ["", ""];
  word.textContent = first === last && range ? "Frame" : "Frames";
  chosen.textContent = range ? `${first === last ? first : `${first}–${last}`} ▾` : "▾";
  word.classList.toggle("tcfit-kept", !range);
  chip.title = range ? `What to do with frames ${first}–${last}` : "What to do with frames";
  invalidate("cursor");
}

watch("bar", (state) => {
  if (!state) return;
  place(bar, state.html);
  const [now, frames] = [".tcfit-now", ".tcfit-frames"].map((name) => bar.querySelector(name));
  if (now && !now.children.length) now.append(field, length, time);
  if (frames && !frames.children.length) frames.append(chip, cross, hint);
});
watch("timeline", (timeline) => {
  if (!timeline) return;
  const last = frameNumber(timeline.length - 1);
  length.textContent = `/ ${last}`;
  field.style.width = `${last.length + 2}ch`;
  time.style.width = `${clockText(timeline.length - 1).length + 2}ch`;
  showFrame();
  showChosen();
});
