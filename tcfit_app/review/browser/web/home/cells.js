// What a clip's row shows.

import { element } from "../element.js";

/**
 * @typedef {{ step: string, share?: number, ended?: "failed" | "done" }} Work
 * @typedef {{ key: string, name: string, place: string, group?: string,
 *   kind: "project" | "result" | "video" | "images", state?: State, frames?: number, seconds?: number,
 *   score?: number, left?: number, words?: string, frame?: number, off?: Object<string, number>,
 *   reviewer?: string, altered?: boolean, note?: string, notes?: number, busy?: string,
 *   work?: Work, problem?: string }} Row
 * @typedef {"new" | "fitted" | "in review" | "approved"} State
 * @typedef {{ title: string, name: string, number?: boolean, order?: (row: Row) => string | number | undefined,
 *   fill?: (cell: HTMLElement, row: Row) => void }} Column
 */

export const STATES = /** @type {State[]} */ (["new", "fitted", "in review", "approved"]);
const WORST = 3; // a score from which on it is red; places are suspicious from 1 on

/** @param {number} count @param {string} what */
const some = (count, what) => `${count.toLocaleString("en")} ${what}${count === 1 ? "" : "s"}`;

/** @param {number} seconds */
function spell(seconds) {
  if (seconds < 60) return `${seconds.toFixed(seconds < 10 ? 1 : 0)} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** @param {Row} row */
export const stateOf = (row) => row.state ?? "new";

/** @param {HTMLElement} cell @param {Row} row */
function name(cell, row) {
  const box = element("div", "", cell);
  element("a", "", element("div", "one", box), row.name).href = `/clip/${row.key}`;
  element("div", "one dim", box, row.kind === "project" ? row.place : `${row.kind} · ${row.place}`);
  cell.title = row.place;
}

/** @param {HTMLElement} cell @param {Row} row */
function length(cell, row) {
  if (!row.frames) return;
  element("div", "", cell, spell(row.seconds ?? 0));
  element("div", "dim", cell, some(row.frames, "frame"));
}

/** @param {HTMLElement} cell @param {Row} row */
function state(cell, row) {
  const { work } = row;
  const box = element("div", "", cell);
  if (work && !work.ended) {
    element("div", "one", box, work.step);
    if (work.share === undefined) return;
    const track = element("div", "track", box);
    track.setAttribute("role", "progressbar");
    track.setAttribute("aria-label", work.step);
    track.setAttribute("aria-valuenow", String(Math.round(100 * work.share)));
    element("div", "", track).style.width = `${100 * work.share}%`;
    return;
  }
  const word = stateOf(row);
  element("div", `one badge ${word === "in review" ? "review" : word}`, box, word[0].toUpperCase() + word.slice(1));
  if (work) element("div", work.ended === "failed" ? "two wrong dim" : "two dim", box, work.step);
  else if (row.altered) element("div", "one dim", box, "approved before");
  else if (row.notes) element("div", "one dim", box, some(row.notes, "note") + " on frames");
  if (work) cell.title = work.step;
}

/** What was found in a clip's fit, also to be searched. @param {Row} row */
export function findingOf(row) {
  if (row.problem || row.score === undefined) return row.problem ?? "";
  return row.left ? `Frame ${row.frame}: ${row.words}` : "Nothing suspicious";
}

/** @param {HTMLElement} cell @param {Row} row */
function worst(cell, row) {
  const box = element("div", "", cell);
  if (row.problem) {
    element("div", "two wrong", box, row.problem);
    cell.title = row.problem;
  } else if (row.score === undefined) {
    if (row.kind === "project" && stateOf(row) !== "new") element("div", "dim", box, "not looked for yet");
  } else if (!row.left) {
    element("div", "score good", box, findingOf(row));
  } else {
    const first = element("div", "one", box);
    element("span", `score ${row.score >= WORST ? "worst" : "doubtful"}`, first, row.score.toFixed(1));
    element("span", "dim", first, ` · ${some(row.left, "place")}`);
    element("div", "two dim", box, findingOf(row));
    cell.title = findingOf(row);
  }
}

/** @param {HTMLElement} cell @param {Row} row */
function reviewer(cell, row) {
  const box = element("div", "", cell);
  if (row.busy) element("div", "one busy", box, `● ${row.busy}`).title = `Open now: ${row.busy}`;
  if (row.reviewer && row.busy !== row.reviewer) element("div", "one", box, row.reviewer);
}

/** @param {HTMLElement} cell @param {Row} row */
function note(cell, row) {
  if (row.kind !== "project") return;
  const button = element("button", `plain two${row.note ? "" : " empty"}`, element("div", "", cell), row.note || "Add a note");
  button.dataset.act = "note";
  button.setAttribute("aria-label", row.note ? `Note on ${row.name}: ${row.note}` : `Add a note on ${row.name}`);
}

/** How far body, hands and face are off. @param {HTMLElement} cell @param {Row} row */
function off(cell, row) {
  for (const [part, px] of Object.entries(row.off ?? {})) element("div", "dim", cell, `${part} ${px.toFixed(0)} px`);
}

/** @type {Column[]} */
export const COLUMNS = [
  { title: "Clip", name: "name", order: (row) => row.place, fill: name },
  { title: "Length", name: "length", number: true, order: (row) => row.seconds || undefined, fill: length },
  { title: "State", name: "state", order: (row) => STATES.indexOf(stateOf(row)), fill: state },
  { title: "Worst place", name: "worst", number: true, order: (row) => row.score, fill: worst },
  {
    title: "Off (95 %)",
    name: "off",
    number: true,
    order: (row) => Object.values(row.off ?? {}).sort((a, b) => b - a)[0],
    fill: off,
  },
  { title: "Reviewer", name: "reviewer", order: (row) => row.reviewer || undefined, fill: reviewer },
  { title: "Note", name: "note", order: (row) => row.note || undefined, fill: note },
];
