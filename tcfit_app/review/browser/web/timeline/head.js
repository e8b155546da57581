// The strip's own elements: its head with the fits' names and the selected frames, the rows' titles, and the border
// that sets its height.

/** @import { MenuItem } from "../menu.js" */

import { PATIENCE, emit, emitLast, invalidate, known, states, watch } from "../connection.js";
import { element, setStripHeight, strip } from "../elements.js";
import { onGround } from "../theme.js";
import { openMenuAt } from "../menu.js";
import { GUTTER, clipLength, frameNumber } from "./axis.js";
import { HEAD, heightLimits, rowBand, stripHeight, wantHeight } from "./layout.js";
import { bar } from "./overview.js";
import { chosenRange, pointed, setCollapsed } from "./pointed.js";

const NUMBERS = 46; // CSS pixels beside a title for the numbers of the axis
const STEP = 20; // CSS pixels by which a key moves the border

const head = element("div", "tcfit-strip-head", strip);
head.style.height = `${HEAD}px`;
const border = element("div", "tcfit-strip-border", strip);
const titles = element("div", "", strip);
const chooser = button("Curves ▾", "Choose the curves", openChooser);
const legend = element("div", "tcfit-strip-fits", head);
const frames = element("div", "tcfit-strip-frames", head);
element("span", "", frames, "Frames");
const first = frameField("First selected frame", "[");
element("span", "", frames, "to");
const last = frameField("Last selected frame", "]");
const clear = button("×", "Clear frame selection", clearRange, frames);
export const more = button("⋯", "What to do with frames", null);
const toggle = button("▾", "Hide curves and marks", toggleCollapsed);
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
  titles.hidden = pointed.collapsed;
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

/** @param {string} title @param {string} key that takes the frame on show */
function frameField(title, key) {
  const field = element("input", "", frames);
  field.inputMode = "numeric";
  field.title = `${title} (${key} takes the frame on show)`;
  field.setAttribute("aria-label", title);
  field.addEventListener("change", takeFrames);
  field.addEventListener("blur", showChosen);
  field.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" && event.key !== "Enter") return;
    if (event.key === "Escape") field.value = field.defaultValue; // so that nothing is taken
    field.blur();
  });
  return field;
}

/** Selects what both fields say; an empty one says the same as the other. What is no number goes. */
function takeFrames() {
  const texts = [first, last].map(({ value }) => value.trim());
  const given = texts.filter(Boolean);
  if (!given.length) return clearRange();
  if (!given.every((text) => /^\d{1,9}$/.test(text))) return;
  const [from, to] = [texts[0] || texts[1], texts[1] || texts[0]].map(Number);
  const offset = known("timeline").first_frame;
  const ends = [from, to].map((number) => Math.min(Math.max(number - offset, 0), clipLength() - 1));
  selectFrames(Math.min(...ends), Math.max(...ends));
}

/** @param {number} from @param {number} to */
function selectFrames(from, to) {
  pointed.range = { first: from, last: to };
  emitLast({ type: "range", ...pointed.range });
  letGo();
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

/** Shows the selected frames in the fields, but not in one that is being typed in. */
export function showChosen() {
  const range = states.timeline ? chosenRange() : null; // it may come before the clip's own numbers
  for (const [field, frame] of /** @type {const} */ ([[first, range?.first], [last, range?.last]])) {
    field.defaultValue = frame === undefined ? "" : frameNumber(frame);
    if (document.activeElement !== field) field.value = field.defaultValue;
  }
  clear.disabled = !range;
  invalidate("cursor");
  frames.classList.toggle("tcfit-some", Boolean(range));
}

// --- its height ---

function toggleCollapsed() {
  setCollapsed(!pointed.collapsed);
  layOut();
}

function layOut() {
  const { collapsed } = pointed;
  const height = clipLength() || states.strip ? stripHeight() : 0;
  setStripHeight(height, clipLength() > 0);
  toggle.textContent = collapsed ? "▴" : "▾";
  toggle.title = collapsed ? "Show curves and marks" : "Hide curves and marks";
  toggle.setAttribute("aria-label", toggle.title);
  toggle.setAttribute("aria-expanded", String(!collapsed));
  border.hidden = collapsed;
  titles.hidden = bar.hidden = collapsed;
  const { least, most } = heightLimits();
  for (const [name, value] of Object.entries({ valuemin: least, valuemax: most, valuenow: height }))
    border.setAttribute(`aria-${name}`, String(Math.round(value)));
  placeTitles();
  invalidate("timeline");
}

border.tabIndex = 0;
border.title = "Drag to make the timeline higher or lower; double click for its usual height";
border.setAttribute("role", "separator");
border.setAttribute("aria-orientation", "horizontal");
border.setAttribute("aria-label", "Height of the timeline");

/** @param {number} height */
function setHeight(height) {
  wantHeight(height);
  layOut();
}

/** @type {{ pointer: number, y: number, height: number } | null} */
let pulled = null;

border.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  border.setPointerCapture(event.pointerId);
  pulled = { pointer: event.pointerId, y: event.clientY, height: strip.clientHeight };
});
border.addEventListener("pointermove", ({ pointerId, clientY }) => {
  if (pointerId === pulled?.pointer) setHeight(pulled.height + pulled.y - clientY);
});
for (const type of /** @type {const} */ (["pointerup", "pointercancel", "lostpointercapture"]))
  border.addEventListener(type, () => (pulled = null));
border.addEventListener("dblclick", () => setHeight(0));
border.addEventListener("keydown", ({ key }) => {
  const { least, most } = heightLimits();
  const heights = /** @type {{ [key: string]: number }} */ (
    { ArrowUp: strip.clientHeight + STEP, ArrowDown: strip.clientHeight - STEP, Home: least, End: most }
  );
  if (heights[key] !== undefined) setHeight(heights[key]);
});
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
