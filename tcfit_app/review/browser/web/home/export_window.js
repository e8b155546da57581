// The window in which the formats of an export are chosen; this browser remembers them.

import { element } from "../element.js";

/** @import { Row } from "./cells.js" */

/**
 * @typedef {{ value: string, title: string, hint?: string, missing?: boolean }} Choice
 * @typedef {{ groups: { [title: string]: Choice[] }, axes: Choice[], views: Choice[], chosen: string[] }} Formats
 * @typedef {{ formats: string[], axes: string, view: string }} Wishes
 */

const KEPT = "tcfit-exports"; // in the browser's storage: the wishes of last time

export class ExportWindow {
  /** @param {{ begin: (wishes: Wishes) => void, closed: () => void }} calls */
  constructor(calls) {
    this.calls = calls;
    this.box = element("dialog", "wide", document.body);
    this.box.setAttribute("aria-label", "Export");
    this.box.addEventListener("close", () => calls.closed());
  }

  /** @param {Formats} formats @param {Row[]} rows */
  open(formats, rows) {
    if (this.box.open) return;
    const wishes = remembered() ?? { formats: formats.chosen, axes: "", view: "" };
    const form = element("form", "");
    form.method = "dialog";
    element("h2", "", form, rows.length === 1 ? `Export ${rows[0].name}` : `Export ${rows.length} clips`);
    const checks = Object.entries(formats.groups).flatMap(([title, choices]) => {
      const group = groupOf(form, title);
      return choices.map((choice) => check(group, choice, wishes.formats.includes(choice.value)));
    });
    const options = groupOf(form, "Options");
    const axes = select(options, "Axes", formats.axes, wishes.axes);
    const view = select(options, "View", formats.views, wishes.view);
    element("p", "dim", form, "Into NAME.exports beside each project. Files of the same names are replaced.");
    const ends = element("div", "buttons tcfit-panel", form);
    const no = element("button", "", ends, "Cancel");
    no.onclick = () => this.box.close();
    const yes = element("button", "tcfit-main", ends, "Export");
    yes.type = "submit";
    const chosen = () => checks.filter((one) => one.checked).map((one) => one.value);
    form.onchange = () => void (yes.disabled = !chosen().length);
    yes.disabled = !chosen().length;
    form.onsubmit = () => {
      const made = { formats: chosen(), axes: axes.value, view: view.value };
      localStorage.setItem(KEPT, JSON.stringify(made));
      this.calls.begin(made);
    };
    this.box.replaceChildren(form);
    this.box.showModal();
    yes.focus();
  }
}

/** @returns {Wishes | null} */
function remembered() {
  try {
    const { formats, axes, view } = JSON.parse(localStorage.getItem(KEPT) ?? "null");
    return Array.isArray(formats) ? { formats, axes: String(axes), view: String(view) } : null;
  } catch {
    return null;
  }
}

/** @param {HTMLElement} form @param {string} title */
function groupOf(form, title) {
  const line = element("div", "group", form);
  line.setAttribute("role", "group");
  line.setAttribute("aria-label", title);
  element("div", "dim", line, title);
  return element("div", "choices", line);
}

/** @param {HTMLElement} group @param {Choice} choice @param {boolean} on */
function check(group, choice, on) {
  const label = element("label", choice.missing ? "dim" : "", group);
  label.title = choice.hint ?? "";
  const box = element("input", "", label);
  box.type = "checkbox";
  box.value = choice.value;
  box.disabled = Boolean(choice.missing);
  box.checked = on && !choice.missing;
  label.append(choice.title);
  return box;
}

/** @param {HTMLElement} group @param {string} title @param {Choice[]} choices @param {string} value */
function select(group, title, choices, value) {
  const label = element("label", "", group, `${title} `);
  label.title = choices.find((choice) => choice.hint)?.hint ?? "";
  const box = element("select", "", label);
  for (const choice of choices) element("option", "", box, choice.title).value = choice.value;
  box.value = choices.some((choice) => choice.value === value) ? value : "";
  return box;
}
