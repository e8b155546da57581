// A menu at the pointer or below a button: what can be done with what is there.

import { emit } from "./connection.js";
import { element } from "./elements.js";

/**
 * A line of a menu: what it says, the keys that do the same, and what it does: one of the app's actions, or `run`;
 * `obstacle` says why that cannot be done now. One that has `checked` switches something, and leaves the menu open. Of
 * those that have `chosen` one holds. One that has `more` opens the menu of these in its place.
 * @typedef {{ label: string, keys?: string, obstacle?: string, checked?: boolean, chosen?: boolean, action?: string,
 *   more?: (MenuItem | null)[], run?: () => void }} MenuItem
 */

const GREY = "Point at a grey line to see why.";
const EDGE = 4; // least distance from the window's edges, in CSS pixels
const MANY = 15; // lines from which on a menu can be searched

/** @type {{ box: HTMLElement, opener: Element | null } | null} */
let open = null; // the box of the lines, and of what stands above and below them

/** Shows a menu with its upper left corner there, or as near as the window has room. It takes the focus; Escape, Tab
 * and a press elsewhere close it, and the focus goes back to where it was.
 * @param {string} name for those who do not see it @param {(MenuItem | string | null)[]} items a text is a heading, and
 * null a line, between groups
 * @param {number} x of the window, in CSS pixels @param {number} y */
export function openMenu(name, items, x, y) {
  closeMenu();
  const box = element("div", "tcfit-menu", document.body);
  open = { box, opener: document.activeElement };
  const search = items.length > MANY ? searchField(box, name) : null;
  const menu = element("div", "", box);
  menu.setAttribute("role", "menu");
  menu.setAttribute("aria-label", name);
  for (const item of items) menu.append(item && typeof item === "object" ? lineOf(item) : separator(item ?? ""));
  if (items.some((item) => typeof item === "object" && item?.obstacle)) sayWhy(box);
  box.addEventListener("keydown", keyDown);
  box.addEventListener("contextmenu", (event) => event.preventDefault());
  box.style.left = `${fitting(x, box.offsetWidth, window.innerWidth)}px`;
  box.style.top = `${fitting(y, box.offsetHeight, window.innerHeight)}px`;
  box.style.width = `${box.offsetWidth}px`; // also while fewer lines are found
  const first = lines().find((line) => !line.ariaDisabled) ?? lines()[0];
  if (!first) return;
  first.tabIndex = 0; // a menu that scrolls must have something that Tab reaches
  (search ?? first).focus({ preventScroll: true });
}

/** Shows the lines that have all of its words. @param {HTMLElement} box @param {string} name */
function searchField(box, name) {
  const field = element("input", "", box);
  field.type = "search";
  field.placeholder = "Search";
  field.setAttribute("aria-label", `Search: ${name}`);
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/);
    for (const part of box.querySelectorAll("[role=menu] > *")) {
      const text = part.textContent?.toLowerCase() ?? "";
      const found = part.matches("button") ? words.every((word) => text.includes(word)) : !field.value;
      part.toggleAttribute("hidden", !found);
    }
  });
  return field;
}

/** @param {number} place @param {number} size @param {number} room */
const fitting = (place, size, room) => Math.max(EDGE, Math.min(place, room - size - EDGE));

/** The same below an element, or above it where that has more room.
 * @param {string} name @param {(MenuItem | string | null)[]} items @param {Element} button */
export function openMenuAt(name, items, button) {
  const { left, top, bottom } = button.getBoundingClientRect();
  openMenu(name, items, left, bottom + 2);
  const below = window.innerHeight - bottom - 2 - EDGE;
  if (!open || open.box.offsetHeight <= below) return;
  const above = top - 2 - EDGE;
  const place = above > below ? { top: "auto", bottom: `${window.innerHeight - top + 2}px` } : { top: `${bottom + 2}px` };
  Object.assign(open.box.style, { ...place, maxHeight: `${Math.max(above, below)}px` });
}

/** Closes the menu, if one is open. */
function closeMenu() {
  if (!open) return;
  const { box, opener } = open;
  open = null;
  const focused = box.contains(document.activeElement);
  box.remove();
  if (focused && opener instanceof HTMLElement && opener !== document.body) opener.focus({ preventScroll: true });
}

const STILL = 4; // CSS pixels that the pointer may move in a click

/** Calls back for right clicks, in place of the browser's menu. At the release: browsers ask for a menu at the press,
 * on Linux and Macs, and a drag with that button moves what is under it.
 * @param {(event: MouseEvent) => boolean} over whether an event is where that is so
 * @param {(event: PointerEvent) => void} show */
export function onRightClick(over, show) {
  /** @type {{ x: number, y: number } | null} */
  let pressed = null;
  window.addEventListener("contextmenu", (event) => over(event) && event.preventDefault(), true);
  window.addEventListener("pointerdown", (event) => {
    pressed = event.button === 2 && over(event) ? { x: event.clientX, y: event.clientY } : null;
  }, true);
  window.addEventListener("pointermove", (event) => {
    if (pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) > STILL) pressed = null;
  }, true);
  window.addEventListener("pointerup", (event) => {
    if (pressed) show(event);
    pressed = null;
  }, true);
}

/** @param {MenuItem} item */
function lineOf(item) {
  const { label, keys = "", obstacle, checked, chosen, more } = item;
  const line = element("button", "");
  line.tabIndex = -1;
  const on = checked ?? chosen;
  const kind = checked !== undefined ? "checkbox" : "radio";
  line.setAttribute("role", on === undefined ? "menuitem" : `menuitem${kind}`);
  if (on !== undefined) line.setAttribute("aria-checked", String(on));
  // Not `disabled`: one that cannot be done now is read to those who do not see it all the same.
  if (obstacle) line.setAttribute("aria-disabled", "true");
  line.title = obstacle ?? "";
  element("span", "", line, label);
  if (keys) element("kbd", "", line, keys);
  if (more?.length) {
    line.setAttribute("aria-haspopup", "menu");
    element("kbd", "", line, "▸").setAttribute("aria-hidden", "true");
  }
  line.addEventListener("click", () => choose(line, item));
  line.addEventListener("pointermove", () => line.focus({ preventScroll: true }));
  return line;
}

/** Below the lines: why the one that has the focus cannot be done. @param {HTMLElement} box */
function sayWhy(box) {
  const why = element("p", "", box, GREY);
  why.setAttribute("aria-hidden", "true"); // it is the lines' description
  box.addEventListener("focusin", ({ target }) => {
    why.textContent = (target instanceof HTMLElement && target.title) || GREY;
  });
}

/** @param {string} heading */
function separator(heading) {
  const line = element("div", heading ? "tcfit-heading" : "tcfit-separator", null, heading);
  line.setAttribute("role", "separator");
  return line;
}

/** @param {HTMLElement} line @param {MenuItem} item */
function choose(line, { label, obstacle, checked, action, more, run }) {
  if (obstacle) return;
  if (more?.length && open) {
    const { left, top } = open.box.getBoundingClientRect();
    openMenu(label, more, left, top);
    return;
  }
  if (checked === undefined) closeMenu();
  else line.setAttribute("aria-checked", String(line.getAttribute("aria-checked") !== "true"));
  if (action) emit({ type: "key", action, repeat: false });
  run?.();
}

const lines = () =>
  /** @type {HTMLElement[]} */ ([...(open?.box.querySelectorAll("button:not([hidden])") ?? [])]);

/** @type {{ [key: string]: (at: number, count: number) => number }} */
const STEPS = {
  ArrowDown: (at, count) => (at + 1) % count,
  ArrowUp: (at, count) => (at + count - 1) % count,
  Home: () => 0,
  End: (_, count) => count - 1,
};

/** @param {KeyboardEvent} event */
function keyDown(event) {
  const { key } = event;
  if (!open || !(event.target instanceof HTMLElement)) return;
  event.stopPropagation(); // viser's own keys
  const search = open.box.querySelector("input");
  const typing = event.target === search;
  if (key === "Escape" || key === "Tab") closeMenu();
  else if (STEPS[key] && !(typing && (key === "Home" || key === "End"))) {
    const all = lines();
    all[STEPS[key](all.indexOf(event.target), all.length)]?.focus();
  } else if (typing && key === "Enter") lines()[0]?.click();
  else {
    if (/^(\S|Backspace)$/.test(key)) search?.focus();
    return;
  }
  event.preventDefault();
}

/** @param {Event} event */
function leave({ target }) {
  if (open && !(target instanceof Node && open.box.contains(target))) closeMenu();
}

for (const type of ["pointerdown", "wheel"]) window.addEventListener(type, leave, { capture: true, passive: true });
window.addEventListener("blur", closeMenu);
window.addEventListener("resize", closeMenu);
