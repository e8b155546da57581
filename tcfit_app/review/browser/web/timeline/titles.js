// The rows' titles, of which the first is the button that opens the menu of curves, and the strip's height.

/** @import { MenuItem } from "../menu.js" */

import { emit, invalidate, known, states, watch } from "../connection.js";
import { bar, element, setStripHeight, strip } from "../elements.js";
import { openMenuAt } from "../menu.js";
import { GUTTER, clipLength } from "./axis.js";
import { rowBand, stripHeight } from "./layout.js";

const [NUMBERS, PARTS] = [46, 72]; // CSS pixels beside a title for the numbers of the axis, or the parts of the body

const titles = element("div", "", strip);
const chooser = element("button", "");
chooser.title = "Choose the curves";
chooser.setAttribute("aria-haspopup", "menu");
chooser.addEventListener("click", () => openMenuAt("Curves", choices(), chooser));

const rows = () => states.rows?.rows ?? [];

/** @param {string} name @param {boolean} shown */
const plot = (name, shown) => emit({ type: "plot", name, shown });

/** @returns {(MenuItem | string)[]} */
function choices() {
  const shown = new Set(rows().map(({ name }) => name));
  return known("timeline").choices.flatMap(({ name, title, group }, i, all) => {
    const item = {
      label: title,
      checked: shown.has(name),
      run: () => plot(name, !rows().some((row) => row.name === name)),
    };
    return i > 0 && all[i - 1].group === group ? [item] : [group, item];
  });
}

let drawn = "";

/** Draws them again only if they change: one of their buttons may have the focus. */
function drawTitles() {
  const said = rows().map(({ name, title, unit, curves }) => [name, title, unit, curves.map(({ label }) => label)]);
  const wanted = JSON.stringify(said);
  if (drawn === wanted) return;
  drawn = wanted;
  titles.replaceChildren();
  if (!rows().length) element("div", "tcfit-strip-title", titles).append(chooser);
  rows().forEach(({ name, title, unit, curves }, index) => {
    const box = element("div", "tcfit-strip-title", titles);
    const text = unit ? `${title} (${unit})` : title;
    if (index) element("span", "", box, text).title = title;
    else box.append(chooser);
    const close = element("button", "", box, "×");
    close.title = close.ariaLabel = `Close ${title}`;
    close.addEventListener("click", () => plot(name, false));
    if (!index) chooser.textContent = `${text} ▾`;
    const legend = element("p", "", curves.length > 1 ? box : null);
    for (const { label, color } of curves) {
      const line = element("span", "", legend);
      element("i", "", line).style.background = `var(--tcfit-${color})`;
      line.append(label);
    }
  });
  if (!rows().length) chooser.textContent = "Curves ▾";
}

/** Gives the strip its height, and the titles their places beside their rows. */
function layOut() {
  setStripHeight(clipLength() || states.strip ? stripHeight() : 0, clipLength() > 0);
  [...titles.children].forEach((box, index) => {
    const { top, bottom } = rowBand(index);
    const width = GUTTER - (rows()[index]?.levels ? PARTS : NUMBERS);
    const place = { top: `${top}px`, height: `${bottom - top}px`, width: `${width}px` };
    if (box instanceof HTMLElement) Object.assign(box.style, place);
  });
  invalidate("timeline");
}

window.addEventListener("resize", () => states.timeline && layOut());
new ResizeObserver(() => states.timeline && layOut()).observe(bar); // it wraps where there is little room

watch("timeline", layOut);
watch("strip", layOut);
watch("rows", () => {
  drawTitles();
  layOut();
});
