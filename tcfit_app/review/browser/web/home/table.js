// The table of clips, of which only the rows in sight are there: a thousand would take a second.

import { element } from "../element.js";
import { COLUMNS } from "./cells.js";
import { ROW } from "./sheet.js";

/** @import { Row } from "./cells.js" */

const AROUND = 6; // rows beyond those in sight
const MOST_PICTURES = 400; // that are remembered

/**
 * @typedef {{ rows: Row[], selected: Set<string>, current: string | null, sort: { by: string, down: boolean } }} View
 */

export class Table {
  /** @param {HTMLElement} box that scrolls
   * @param {{ sort: (by: string) => void, look: (keys: string[]) => void }} calls */
  constructor(box, calls) {
    this.box = box;
    this.calls = calls;
    /** @type {View} */
    this.view = { rows: [], selected: new Set(), current: null, sort: { by: "name", down: false } };
    /** @type {Map<string, { line: HTMLTableRowElement, shows: string }>} */
    this.lines = new Map();
    /** By key; may be empty. @type {Map<string, string>} */
    this.pictures = new Map();
    this.asked = "";
    this.table = element("table", "", box);
    this.table.setAttribute("role", "grid");
    this.table.setAttribute("aria-label", "Clips");
    this.table.setAttribute("aria-multiselectable", "true");
    this.heads = this.makeHead();
    this.body = element("tbody", "", this.table);
    this.above = this.spacer();
    this.below = this.spacer();
    box.addEventListener("scroll", () => this.draw(), { passive: true });
    new ResizeObserver(() => this.draw()).observe(box);
  }

  makeHead() {
    const line = element("tr", "", element("thead", "", this.table));
    element("th", "check", line).append(hidden("Selected"));
    element("th", "picture", line).append(hidden("Picture"));
    return COLUMNS.map(({ title, name }) => {
      const head = element("th", name, line);
      const button = element("button", "", head, title);
      button.onclick = () => this.calls.sort(name);
      return head;
    });
  }

  spacer() {
    const line = element("tr", "", this.body);
    line.setAttribute("aria-hidden", "true");
    return line;
  }

  /** @param {View} view */
  show(view) {
    this.view = view;
    this.table.setAttribute("aria-rowcount", String(view.rows.length + 1));
    COLUMNS.forEach(({ name }, i) => {
      if (view.sort.by === name) this.heads[i].setAttribute("aria-sort", view.sort.down ? "descending" : "ascending");
      else this.heads[i].removeAttribute("aria-sort");
    });
    this.draw();
  }

  draw() {
    const { rows } = this.view;
    const first = Math.max(0, Math.floor(this.box.scrollTop / ROW) - AROUND);
    const last = Math.min(rows.length, Math.ceil((this.box.scrollTop + this.box.clientHeight) / ROW) + AROUND);
    const inSight = rows.slice(first, last);
    const keys = new Set(inSight.map((row) => row.key));
    const focused = this.body.contains(document.activeElement);
    for (const [key, { line }] of this.lines) if (!keys.has(key)) this.drop(key, line);
    let before = /** @type {Element} */ (this.above);
    inSight.forEach((row, i) => {
      const line = this.line(row, first + i);
      if (before.nextSibling !== line) before.after(line);
      before = line;
    });
    this.above.style.height = `${first * ROW}px`;
    this.below.style.height = `${(rows.length - last) * ROW}px`;
    if (focused && !this.body.contains(document.activeElement)) this.focus();
    this.look(inSight);
  }

  /** @param {string} key @param {HTMLElement} line */
  drop(key, line) {
    line.remove();
    this.lines.delete(key);
  }

  /** The row's line, made again if it shows something else. @param {Row} row @param {number} place */
  line(row, place) {
    const { selected, current, rows } = this.view;
    const isCurrent = row.key === (current ?? rows[0]?.key);
    const shows = JSON.stringify([row, place, selected.has(row.key), isCurrent, this.pictures.has(row.key)]);
    const known = this.lines.get(row.key);
    if (known?.shows === shows) return known.line;
    const line = element("tr", "clip");
    line.dataset.key = row.key;
    line.tabIndex = isCurrent ? 0 : -1;
    line.setAttribute("aria-rowindex", String(place + 2));
    line.setAttribute("aria-selected", String(selected.has(row.key)));
    const check = element("input", "", element("td", "check", line));
    check.type = "checkbox";
    check.checked = selected.has(row.key);
    check.tabIndex = -1;
    check.setAttribute("aria-label", `Select ${row.name}`);
    this.fillPicture(element("td", "picture", line), row.key);
    for (const { name, fill } of COLUMNS) {
      const cell = element("td", name, line);
      fill?.(cell, row);
      for (const inside of cell.querySelectorAll("a, button")) if (inside instanceof HTMLElement) inside.tabIndex = -1;
    }
    const hadFocus = known?.line.contains(document.activeElement);
    if (known) known.line.replaceWith(line);
    if (hadFocus) line.focus({ preventScroll: true });
    this.lines.set(row.key, { line, shows });
    return line;
  }

  /** @param {HTMLElement} cell @param {string} key */
  fillPicture(cell, key) {
    const data = this.pictures.get(key);
    if (!data) return void element("div", "blank", cell);
    const image = element("img", "", cell);
    image.alt = "";
    image.src = `data:image/jpeg;base64,${data}`;
  }

  /** A picture has come. @param {string} key @param {string} data */
  take(key, data) {
    this.pictures.delete(key);
    this.pictures.set(key, data);
    for (const oldest of this.pictures.keys()) {
      if (this.pictures.size <= MOST_PICTURES) break;
      this.pictures.delete(oldest);
    }
    this.draw();
  }

  /** The fit has drawn another one. @param {string} key */
  forget(key) {
    this.pictures.delete(key);
    this.asked = "";
  }

  /** Ask for the pictures in sight. @param {Row[]} inSight */
  look(inSight) {
    const keys = inSight.map((row) => row.key).filter((key) => !this.pictures.has(key));
    const asked = keys.join(" ");
    if (asked === this.asked) return;
    this.asked = asked;
    this.calls.look(keys);
  }

  /** Bring the current row into sight, with the focus. */
  focus() {
    const { rows, current } = this.view;
    const place = Math.max(0, rows.findIndex((row) => row.key === current));
    const head = 34;
    const [top, bottom] = [place * ROW, (place + 1) * ROW + head];
    if (top < this.box.scrollTop) this.box.scrollTop = top;
    else if (bottom > this.box.scrollTop + this.box.clientHeight) this.box.scrollTop = bottom - this.box.clientHeight;
    this.draw0();
    this.lines.get(rows[place]?.key)?.line.focus({ preventScroll: true });
  }

  /** Draw without looking after the focus. */
  draw0() {
    if (document.activeElement instanceof HTMLElement) document.activeElement.blur();
    this.draw();
  }
}

/** A word for screen readers alone. @param {string} text */
function hidden(text) {
  const made = element("span", "", null, text);
  made.style.cssText = "position: absolute; clip-path: inset(50%); width: 1px; height: 1px; overflow: hidden;";
  return made;
}
