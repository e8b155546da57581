// A menu at the pointer or below a button: what can be done with what is there.

import { emit } from "./connection.js";
import { element } from "./elements.js";

/**
 * A line of a menu: what it says, the keys that do the same, and what it does: one of the app's actions, or `run`;
 * `obstacle` says why that cannot be done now. One that has `checked` switches something, and leaves the menu open. One
 * that has `more` opens the menu of these in its place.
 * @typedef {{ label: string, keys?: string, obstacle?: string, checked?: boolean, action?: string,
 *   more?: (MenuItem | null)[], run?: () => void }} MenuItem
 */

const GREY = "Point at a grey line to see why.";
const EDGE = 4; // least distance from the window's edges, in CSS pixels

/** @type {{ menu: HTMLElement, opener: Element | null } | null} */
let open = null;

/** Shows a menu with its upper left corner there, or as near as the window has room. It takes the focus; Escape, Tab
 * and a press elsewhere close it, and the focus goes back to where it was.
 * @param {string} name for those who do not see it @param {(MenuItem | null)[]} items null is a line between groups
 * @param {number} x of the window, in CSS pixels @param {number} y */
export function openMenu(name, items, x, y) {
  closeMenu();
  const menu = element("div", "tcfit-menu", document.body);
  menu.setAttribute("role", "menu");
  menu.setAttribute("aria-label", name);
  for (const item of items) menu.append(item ? lineOf(item) : separator());
  if (items.some((item) => item?.obstacle)) sayWhy(menu);
  open = { menu, opener: document.activeElement };
  menu.addEventListener("keydown", keyDown);
  menu.addEventListener("contextmenu", (event) => event.preventDefault());
  menu.style.left = `${fitting(x, menu.offsetWidth, window.innerWidth)}px`;
  menu.style.top = `${fitting(y, menu.offsetHeight, window.innerHeight)}px`;
  const first = lines(menu).find((line) => !line.ariaDisabled) ?? lines(menu)[0];
  if (!first) return;
  first.tabIndex = 0; // a menu that scrolls must have something that Tab reaches
  first.focus({ preventScroll: true });
}

/** @param {number} place @param {number} size @param {number} room */
const fitting = (place, size, room) => Math.max(EDGE, Math.min(place, room - size - EDGE));

/** The same below an element, or above it where that has more room.
 * @param {string} name @param {(MenuItem | null)[]} items @param {Element} button */
export function openMenuAt(name, items, button) {
  const { left, top, bottom } = button.getBoundingClientRect();
  openMenu(name, items, left, bottom + 2);
  if (!open) return;
  const height = open.menu.offsetHeight;
  if (bottom + 2 + height > window.innerHeight) open.menu.style.top = `${Math.max(EDGE, top - height - 2)}px`;
}

/** Closes the menu, if one is open. */
function closeMenu() {
  if (!open) return;
  const { menu, opener } = open;
  open = null;
  const focused = menu.contains(document.activeElement);
  menu.remove();
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
  const { label, keys = "", obstacle, checked, more } = item;
  const line = element("button", "");
  line.type = "button";
  line.tabIndex = -1;
  line.setAttribute("role", checked === undefined ? "menuitem" : "menuitemcheckbox");
  if (checked !== undefined) line.setAttribute("aria-checked", String(checked));
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

/** Below the lines: why the one that has the focus cannot be done. @param {HTMLElement} menu */
function sayWhy(menu) {
  const why = element("p", "", menu, GREY);
  why.setAttribute("aria-hidden", "true"); // it is the lines' description
  menu.addEventListener("focusin", ({ target }) => {
    why.textContent = (target instanceof HTMLElement && target.title) || GREY;
  });
}

function separator() {
  const line = element("div", "tcfit-separator");
  line.setAttribute("role", "separator");
  return line;
}

/** @param {HTMLElement} line @param {MenuItem} item */
function choose(line, { label, obstacle, checked, action, more, run }) {
  if (obstacle) return;
  if (more?.length && open) {
    const { left, top } = open.menu.getBoundingClientRect();
    openMenu(label, more, left, top);
    return;
  }
  if (checked === undefined) closeMenu();
  else line.setAttribute("aria-checked", String(line.getAttribute("aria-checked") !== "true"));
  if (action) emit({ type: "key", action, repeat: false });
  run?.();
}

/** @param {HTMLElement} menu @returns {HTMLElement[]} */
const lines = (menu) => [...menu.querySelectorAll("button")];

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
  if (key === "Escape" || key === "Tab") closeMenu();
  else if (STEPS[key]) {
    const all = lines(open.menu);
    all[STEPS[key](all.indexOf(event.target), all.length)]?.focus();
  } else return;
  event.preventDefault();
}

/** @param {Event} event */
function leave({ target }) {
  if (open && !(target instanceof Node && open.menu.contains(target))) closeMenu();
}

for (const type of ["pointerdown", "wheel"]) window.addEventListener(type, leave, { capture: true, passive: true });
window.addEventListener("blur", closeMenu);
window.addEventListener("resize", closeMenu);
