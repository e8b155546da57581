// The page with the list of clips: filtered, sorted and searched here; the server sends changes.

import { element } from "../element.js";
import { ORDER } from "../remembered.js";
import { PANEL_SHEET } from "../style.js";
import { THEME_SHEET } from "../theme.js";
import { COLUMNS, STATES, findingOf, stateOf } from "./cells.js";
import { ExportWindow } from "./export_window.js";
import { LIST_SHEET } from "./sheet.js";
import { Table } from "./table.js";

/** @import { Row, State } from "./cells.js" */

const KEPT = "tcfit-list"; // in the browser's storage: how this tab shows the list
const AGAIN = 2000; // milliseconds after which a lost connection is tried again

element("style", "", document.head, THEME_SHEET + PANEL_SHEET + LIST_SHEET);

/** @type {Map<string, Row>} */
const rows = new Map();
/** @type {Set<string>} */
const selected = new Set();
/** @type {{ state: State | "", text: string, by: string, down: boolean, current: string | null, top: number }} */
const kept = { state: "", text: "", by: "name", down: false, current: null, top: 0 };
try {
  Object.assign(kept, JSON.parse(sessionStorage.getItem(KEPT) ?? "{}"));
} catch {
  sessionStorage.removeItem(KEPT);
}
/** @type {Row[]} */
let shown = [];
/** @type {WebSocket | null} */
let socket = null;
let arrived = false;

// --- the page ---

const header = element("header", "tcfit-panel", document.body);
header.append(/** @type {HTMLElement} */ (document.getElementById("title")));
const filters = element("div", "tcfit-joined", header);
filters.setAttribute("role", "group");
filters.setAttribute("aria-label", "Show clips that are");
const search = element("input", "", header);
search.type = "search";
search.placeholder = "Search (/)";
search.setAttribute("aria-label", "Search names, folders, reviewers, notes and findings");
search.value = kept.text;
/** @param {string} label @param {string} key @param {string} hint @param {() => void} run @param {string} [kind] */
function action(label, key, hint, run, kind = "") {
  const button = element("button", kind, header, label);
  button.title = hint;
  element("kbd", "", button, key);
  button.onclick = run;
  return button;
}
const buttons = {
  open: action("Open", "Enter", "Review the clip", () => openCurrent(), "tcfit-main"),
  fit: action("Fit", "F", "Detect missing keypoints, and fit, one clip after the other", () => fit()),
  export: action("Export", "E", "Choose formats, and write the fits beside the projects, one clip after the other",
    () => askExport()),
  approve: action("Approve", "A", "Approve the clip, or withdraw the approval", () => approve()),
  cancel: action("Cancel", "C", "Cancel these jobs; clear messages of finished ones", () => cancel()),
};
const main = element("main", "", document.body);
const footer = element("footer", "", document.body);
const keyHints = element("span", "keys", footer);
const notice = element("span", "notice", footer);
notice.setAttribute("role", "status");
const KEYS_TOLD = [
  ["↑ ↓", "go"], ["Space", "select"], ["Ctrl+A", "select all"], ["G", "select the people of a clip"],
  ["Esc", "select none"], ["N", "note"],
  ["PageDown PageUp", "next and previous clip, in a clip"],
];
for (const [keys, what] of KEYS_TOLD) {
  const hint = element("span", "", keyHints);
  element("kbd", "", hint, keys);
  hint.append(` ${what}`);
}
const alert = element("div", "alert tcfit-panel", document.body);
alert.setAttribute("role", "alert");
const alertText = element("div", "", alert);
const alertEnd = element("button", "", alert, "Close");
alertEnd.onclick = () => void (alert.hidden = true);
alert.hidden = true;

/** @param {string} text */
function tell(text) {
  if (noteWindow.open) return void (noteAlert.textContent = text); // the alert would be behind it
  alertText.textContent = text;
  alert.hidden = false;
}

const table = new Table(main, {
  sort(by) {
    const number = COLUMNS.find((column) => column.name === by)?.number ?? false;
    kept.down = kept.by === by ? !kept.down : number;
    kept.by = by;
    draw();
  },
  look: (keys) => send({ type: "look", keys: keys.slice(0, 100) }),
});
const nothing = element("p", "nothing", main);

// --- what is shown ---

/** @param {Row} row */
const searched = (row) =>
  [row.name, row.place, row.reviewer, row.note, row.busy, findingOf(row)].join("\n").toLowerCase();

// A collator that is made once compares ten times as fast as localeCompare.
const collated = new Intl.Collator("en", { numeric: true }).compare;

/** @param {Row} a @param {Row} b */
function compared(a, b) {
  const order = COLUMNS.find((column) => column.name === kept.by)?.order ?? ((row) => row.place);
  const [one, other] = [order(a), order(b)];
  const natural = collated(a.place, b.place);
  const missing = Number(one === undefined) - Number(other === undefined);
  if (one === undefined || other === undefined) return missing || natural;
  const difference =
    typeof one === "number" && typeof other === "number" ? one - other : collated(String(one), String(other));
  return (kept.down ? -difference : difference) || natural;
}

let version = 0; // of the rows
let arranged = ""; // what `shown` was last made for

/** Filters and sorts again if that can have changed: with 10,000 clips it takes longer than a key may. */
function arrange() {
  const wanted = JSON.stringify([version, kept.state, kept.text, kept.by, kept.down]);
  if (wanted === arranged) return;
  arranged = wanted;
  const text = kept.text.trim().toLowerCase();
  const found = [...rows.values()].filter((row) => !text || searched(row).includes(text));
  shown = found.filter((row) => !kept.state || stateOf(row) === kept.state).sort(compared);
  for (const key of selected) if (!rows.has(key)) selected.delete(key);
  drawFilters(found);
  keepOrder();
}

let drawing = 0;
function draw() {
  drawing ||= requestAnimationFrame(() => {
    drawing = 0;
    drawNow();
  });
}

function drawNow() {
  arrange();
  if (!shown.some((row) => row.key === kept.current)) kept.current = shown[0]?.key ?? null;
  drawButtons();
  table.show({ rows: shown, selected, current: kept.current, sort: kept });
  nothing.hidden = shown.length > 0 || !arrived;
  nothing.textContent = rows.size
    ? "No clip matches. Clear the search, or choose another state."
    : "There is no clip in this folder yet. " +
      "Copy a video, a folder of frames or a project into it, and it appears here.";
  keep();
}

/** @param {Row[]} found */
function drawFilters(found) {
  const choices = /** @type {const} */ (["", ...STATES]);
  const parts = choices.map((state) => {
    const label = state ? state[0].toUpperCase() + state.slice(1) : "All";
    const count = found.filter((row) => !state || stateOf(row) === state).length;
    return { state, label, count };
  });
  if (filters.childElementCount !== parts.length)
    filters.replaceChildren(...parts.map(({ state, label }) => {
      const button = element("button", "", null, label);
      element("b", "", button);
      button.onclick = () => {
        kept.state = state;
        draw();
      };
      return button;
    }));
  parts.forEach(({ state, count }, i) => {
    const button = filters.children[i];
    button.setAttribute("aria-pressed", String(kept.state === state));
    const number = button.querySelector("b");
    if (number) number.textContent = count.toLocaleString("en");
  });
}

/** The clips that a button or key acts on: the visible ones of those selected, or the current one if none is. */
function chosen() {
  if (selected.size) return shown.filter((row) => selected.has(row.key));
  const current = rows.get(kept.current ?? "");
  return current ? [current] : [];
}

/** The same for a key, which no disabled button explains. */
function chosenByKey() {
  const about = chosen();
  if (!about.length && selected.size)
    tell("The selected clips are hidden by the filter or the search. Esc clears the selection.");
  return about;
}

function drawButtons() {
  const about = chosen();
  const going = [...rows.values()].filter((row) => row.work && !row.work.ended).length;
  buttons.open.disabled = buttons.fit.disabled = !about.length;
  buttons.export.disabled = !exportable().length;
  buttons.approve.disabled = !about.some((row) => row.kind === "project" && stateOf(row) !== "new");
  buttons.cancel.disabled = !about.some((row) => row.work);
  const off = about.length > 0 && about.every((row) => stateOf(row) === "approved");
  const label = buttons.approve.firstChild;
  if (label) label.textContent = off ? "Withdraw approval" : "Approve";
  const hidden = selected.size - shown.filter((row) => selected.has(row.key)).length;
  const chosenNow = `${selected.size} selected${hidden ? `, ${hidden} of them hidden` : ""}`;
  const parts = [selected.size ? chosenNow : "", going ? `${going} in the queue` : ""];
  notice.textContent = parts.filter(Boolean).join(" · ");
}

/** For the way back to this page. */
const keep = () => sessionStorage.setItem(KEPT, JSON.stringify(kept));

/** For the pages of clips, which go to the next one. */
function keepOrder() {
  const order = shown.filter((row) => row.kind === "project").map((row) => row.key).join(" ");
  sessionStorage.setItem(ORDER, order);
  localStorage.setItem(ORDER, order);
}

// --- what is done ---

/** @param {string} [key] */
function openCurrent(key) {
  const row = rows.get(key ?? chosen()[0]?.key ?? "");
  if (!row) return;
  kept.current = row.key;
  drawNow();
  notice.textContent = `Opening ${row.name} …`;
  send({ type: "open", key: row.key });
}

function fit() {
  const keys = chosenByKey().map((row) => row.key);
  if (keys.length) send({ type: "fit", keys });
}

/** The chosen clips that may have a fit. */
const exportable = () => chosen().filter((row) => ["project", "result"].includes(row.kind));
/** Clips of the export window, independent of later selections. @type {Row[]} */
let exported = [];

function askExport() {
  chosenByKey();
  exported = exportable();
  if (!exported.length) return;
  notice.textContent = "Loading the formats …";
  send({ type: "formats" });
}

const exportWindow = new ExportWindow({
  begin: (wishes) => send({ type: "export", keys: exported.map((row) => row.key), ...wishes }),
  closed: () => table.focus(),
});

function approve() {
  const about = chosenByKey().filter((row) => row.kind === "project");
  const approved = !about.every((row) => stateOf(row) === "approved");
  if (about.length) send({ type: "approve", keys: about.map((row) => row.key), approved });
}

function cancel() {
  const keys = chosenByKey().filter((row) => row.work).map((row) => row.key);
  if (keys.length) send({ type: "cancel", keys });
}

const noteWindow = element("dialog", "", document.body);
const noteAlert = element("p", "wrong");
noteAlert.setAttribute("role", "alert");
/** The note that has been sent, until its row shows it. @type {{ key: string, note: string } | null} */
let sentNote = null;

/** @param {Row} row */
function askNote(row) {
  const form = element("form", "");
  const label = element("label", "", form, `Note on ${row.name}`);
  const input = element("input", "", form);
  label.htmlFor = input.id = "note";
  input.maxLength = 500;
  input.value = row.note ?? "";
  noteAlert.textContent = "";
  form.append(noteAlert);
  const ends = element("div", "buttons tcfit-panel", form);
  const no = element("button", "", ends, "Cancel");
  no.onclick = () => noteWindow.close();
  element("button", "tcfit-main", ends, "Save").type = "submit";
  form.onsubmit = (event) => {
    event.preventDefault(); // the window closes when the note is stored
    sentNote = { key: row.key, note: input.value.trim().split(/\s+/).join(" ") };
    noteAlert.textContent = "";
    send({ type: "note", key: row.key, text: input.value });
    noteIsStored();
  };
  noteWindow.setAttribute("aria-label", `Note on ${row.name}`);
  noteWindow.replaceChildren(form);
  noteWindow.showModal();
  input.select();
}
noteWindow.addEventListener("close", () => {
  sentNote = null;
  table.focus();
});

function noteIsStored() {
  if (sentNote && (rows.get(sentNote.key)?.note ?? "") === sentNote.note) noteWindow.close();
}

/** @param {number} step @param {boolean} extend */
function go(step, extend) {
  const place = shown.findIndex((row) => row.key === kept.current);
  const next = shown[Math.min(Math.max(place + step, 0), shown.length - 1)];
  if (!next) return;
  if (extend && kept.current) selected.add(kept.current).add(next.key);
  kept.current = next.key;
  drawNow();
  table.focus();
}

/** @param {string} key */
function toggle(key) {
  if (!selected.delete(key)) selected.add(key);
  drawNow();
}

// --- pointer and keys ---

main.addEventListener("click", (event) => {
  const target = /** @type {Element} */ (event.target);
  const key = /** @type {HTMLElement | null} */ (target.closest("tr.clip"))?.dataset.key;
  const row = rows.get(key ?? "");
  if (!row) return;
  if (target.closest("a")) {
    if (event.ctrlKey || event.metaKey || event.shiftKey) return; // in a tab of its own
    event.preventDefault();
    return openCurrent(row.key);
  }
  const from = kept.current;
  kept.current = row.key;
  if (target.closest("[data-act=note]")) askNote(row);
  else if (event.shiftKey && from) {
    const ends = [from, row.key].map((one) => shown.findIndex((other) => other.key === one)).sort((a, b) => a - b);
    for (const one of shown.slice(ends[0], ends[1] + 1)) selected.add(one.key);
  } else if (target.closest("input") || event.ctrlKey || event.metaKey) return toggle(row.key);
  drawNow();
});
main.addEventListener("dblclick", (event) => {
  const line = /** @type {HTMLElement | null} */ (/** @type {Element} */ (event.target).closest("tr.clip"));
  if (line && !(/** @type {Element} */ (event.target).closest("input, button, a"))) openCurrent(line.dataset.key);
});

/** @type {{ [key: string]: (event: KeyboardEvent) => void }} */
const KEYS = {
  ArrowDown: (event) => go(1, event.shiftKey),
  ArrowUp: (event) => go(-1, event.shiftKey),
  PageDown: () => go(8, false),
  PageUp: () => go(-8, false),
  Home: () => go(-shown.length, false),
  End: () => go(shown.length, false),
  Enter: () => openCurrent(kept.current ?? undefined),
  " ": () => kept.current && toggle(kept.current),
  Escape: () => {
    selected.clear();
    alert.hidden = true;
    drawNow();
  },
  "/": () => search.focus(),
  e: () => askExport(),
  f: () => fit(),
  a: (event) => {
    if (!event.ctrlKey && !event.metaKey) return approve();
    for (const row of shown) selected.add(row.key);
    drawNow();
  },
  c: () => cancel(),
  g: () => {
    const group = rows.get(kept.current ?? "")?.group;
    for (const row of shown) if (group && row.group === group) selected.add(row.key);
    drawNow();
  },
  n: () => {
    const row = rows.get(kept.current ?? "");
    if (row?.kind === "project") askNote(row);
  },
};

window.addEventListener("keydown", (event) => {
  const target = /** @type {Element} */ (event.target);
  if (event.isComposing || event.altKey || document.querySelector("dialog[open]")) return;
  if (target === search) {
    if (event.key === "Escape") search.value = kept.text = "";
    if (["Escape", "Enter", "ArrowDown"].includes(event.key)) {
      event.preventDefault();
      drawNow();
      table.focus();
    }
    return;
  }
  if (["Enter", " "].includes(event.key) && target.closest("button, a")) return;
  const letter = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if ((event.ctrlKey || event.metaKey) && letter !== "a") return;
  if (!KEYS[letter]) return;
  event.preventDefault();
  KEYS[letter](event);
});
search.addEventListener("input", () => {
  kept.text = search.value;
  main.scrollTop = 0;
  draw();
});
main.addEventListener("scroll", () => void (kept.top = main.scrollTop), { passive: true });
window.addEventListener("pagehide", () => {
  keep();
  keepOrder(); // another tab may have another order
});

// --- the server ---

const UNREACHABLE =
  "tcfit has ended or cannot be reached. If it has ended, start it again and open the link that it prints.";

/** @param {object} message */
function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  else tell(UNREACHABLE);
}

/** @param {any} message */
function take(message) {
  if (message.type === "rows") takeRows(message);
  else if (message.type === "picture") table.take(message.key, message.data);
  else if (message.type === "refusal") tell(message.text);
  else if (message.type === "formats") exportWindow.open(message, exported);
  else if (message.type === "opened") {
    kept.current = message.key;
    keep();
    location.assign(`/clip/${message.key}`);
  }
  if (["refusal", "formats"].includes(message.type)) drawButtons();
}

/** @param {{ rows: Row[], gone?: string[], whole?: boolean }} message */
function takeRows(message) {
  version += 1;
  if (message.whole) rows.clear();
  for (const key of message.gone ?? []) rows.delete(key);
  for (const row of message.rows) {
    if (rows.get(row.key)?.work && !row.work) table.forget(row.key);
    rows.set(row.key, row);
  }
  noteIsStored();
  const first = !arrived;
  arrived = true;
  if (first) arrive();
  drawNow();
  if (first) {
    main.scrollTop = kept.top;
    table.focus();
  }
}

/** Back from a clip, which the address names. */
function arrive() {
  const from = location.hash.slice(1);
  if (!from) return;
  history.replaceState(null, "", location.pathname);
  const row = rows.get(from);
  if (!row) return;
  kept.current = from;
  if (row.problem) tell(`${row.name}: ${row.problem}`);
}

function connect() {
  const made = new WebSocket(`${location.origin.replace(/^http/, "ws")}/list`);
  made.onopen = () => {
    socket = made;
    table.asked = "";
  };
  made.onmessage = ({ data }) => take(JSON.parse(data));
  made.onclose = () => {
    if (socket === made) notice.textContent = "Not connected: trying again …";
    if (sentNote) tell(`${UNREACHABLE} The note may not be stored: save it again.`);
    socket = null;
    setTimeout(connect, AGAIN);
  };
}

drawNow();
connect();
