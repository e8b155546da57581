// The strip's own elements: its head with the fits' names and the selected frames, and the rows' titles.

/** @import { MenuItem } from "../menu.js" */

import { PATIENCE, emit, emitLast, invalidate, known, states, watch } from "../connection.js";
import { element, setStripHeight, strip } from "../elements.js";
import { onGround } from "../theme.js";
import { openMenuAt } from "../menu.js";
import { GUTTER, clipLength, frameNumber } from "./axis.js";
import { HEAD, rowBand, stripHeight } from "./layout.js";
import { chosenRange, pointed } from "./pointed.js";

const NUMBERS = 46; // CSS pixels beside a title for the numbers of the axis

const head = element("div", "tcfit-strip-head", strip);
head.style.height = `${HEAD}px`;
const titles = element("div", "", strip);
const chooser = button("Curves ▾", "Choose the curves", openChooser);
const legend = element("div", "tcfit-strip-fits", head);
const frames = element("div", "tcfit-strip-frames", head);
const chosen = element("span", "", frames);
button("×", "Clear frame selection", clearRange, frames);
export const more = button("⋯", "What to do with frames", null);
chooser.setAttribute("aria-haspopup", "menu");
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

// --- the curves ---

/** @param {string} name @param {boolean} shown */
const plot = (name, shown) => emit({ type: "plot", name, shown });

function openChooser() {
  openMenuAt("Curves", choices(), chooser);
}

/** @returns {(MenuItem | null)[]} */
function choices() {
  const shown = new Set((states.rows?.rows ?? []).map(({ name }) => name));
  return known("timeline").choices.flatMap(({ name, title, group }, i, all) => {
    const item = {
      label: title,
      checked: shown.has(name),
      run: () => plot(name, !(states.rows?.rows ?? []).some((row) => row.name === name)),
    };
    return i > 0 && all[i - 1].group !== group ? [null, item] : [item];
  });
}

function drawTitles() {
  const rows = states.rows?.rows ?? [];
  titles.replaceChildren();
  for (const { name, title, unit } of rows) {
    const box = element("div", "tcfit-strip-title", titles);
    element("span", "", box, unit ? `${title} (${unit})` : title).title = title;
    button("×", `Close ${title}`, () => plot(name, false), box);
  }
}

function placeTitles() {
  [...titles.children].forEach((box, index) => {
    const { top, bottom } = rowBand(index);
    const place = { top: `${top}px`, height: `${bottom - top}px`, width: `${GUTTER - NUMBERS}px` };
    if (box instanceof HTMLElement) Object.assign(box.style, place);
  });
}

function drawLegend() {
  legend.replaceChildren();
  for (const { label, title, color } of states.rows?.fits ?? []) {
    const fit = element("span", "", legend);
    fit.title = title;
    element("i", "", fit).style.background = onGround(color);
    element("b", "", fit, label);
    const cut = title.lastIndexOf(" · "); // the phase stays in sight
    element("span", "", fit, cut < 0 ? title : title.slice(0, cut));
    if (cut >= 0) element("em", "", fit, title.slice(cut));
  }
}

// --- the selected frames ---

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

// --- its height ---

function layOut() {
  setStripHeight(clipLength() || states.strip ? stripHeight() : 0, clipLength() > 0);
  placeTitles();
  invalidate("timeline");
}

window.addEventListener("resize", () => states.timeline && layOut());

watch("timeline", () => {
  head.hidden = !states.timeline;
  showChosen();
  layOut();
});
watch("strip", layOut);
watch("rows", () => {
  drawLegend();
  drawTitles();
  layOut();
});
