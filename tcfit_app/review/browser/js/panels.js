// The panels' own HTML: its looks, and its buttons. Whatever carries data-tcfit is one: a command, with data-value.

const PANEL_SHEET = `
.tcfit-panel { padding: 0 10px 7px; font: 12px/1.4 ${FONT}; color: ${COLORS.text}; font-variant-numeric: tabular-nums; }
.tcfit-panel h3 { display: flex; justify-content: space-between; gap: 8px; margin: 4px 0 5px; padding-top: 6px;
  border-top: 1px solid #33383f; font: 600 11px/1.4 ${FONT}; color: ${COLORS.dim}; }
.tcfit-panel h3.tcfit-first { margin-top: 0; padding-top: 0; border-top: 0; }
.tcfit-panel h3 span { font-weight: 400; }
.tcfit-panel p { margin: 3px 0; white-space: pre-line; overflow-wrap: anywhere; }
.tcfit-row { display: flex; align-items: center; gap: 4px; margin: 0 0 5px; }
.tcfit-row:last-child { margin-bottom: 0; }
.tcfit-wrap { flex-wrap: wrap; }
.tcfit-cells { display: grid; grid-template-columns: 1fr 1fr; gap: 4px; flex: 1 1 0; min-width: 0; }
.tcfit-row:has(> .tcfit-cells) { align-items: flex-start; margin-bottom: 9px; }
.tcfit-row:has(> .tcfit-cells) > label { line-height: 25px; }
.tcfit-row > label { flex: none; width: 74px; color: ${COLORS.dim}; }
.tcfit-panel button { display: inline-flex; align-items: center; justify-content: center; flex: 1 1 auto; min-width: 0;
  height: 25px; padding: 0 7px; border: 1px solid #3d434c;
  border-radius: 4px; background: #2c3037; color: ${COLORS.text}; font: 12px/1 ${FONT}; white-space: nowrap; cursor: pointer; touch-action: manipulation; user-select: none;
  -webkit-user-select: none; }
.tcfit-panel button > span { overflow: hidden; text-overflow: ellipsis; padding: 3px 0; }
.tcfit-panel button:hover:not(:disabled) { background: #3a404a; border-color: #59616d; color: #fff; }
.tcfit-panel button > span:has(.tcfit-phase) { display: flex; align-items: center; }
.tcfit-panel button > span:has(.tcfit-phase) > * { flex: none; white-space: pre; }
.tcfit-panel button > span:has(.tcfit-phase) > .tcfit-name { flex: 0 1 auto; overflow: hidden; text-overflow: ellipsis; }
.tcfit-panel button:active:not(:disabled) { background: #23272d; }
.tcfit-panel button:focus-visible { outline: 2px solid ${COLORS.accent}; outline-offset: 1px; }
.tcfit-panel button:disabled { opacity: 0.42; cursor: default; }
.tcfit-panel button[aria-pressed=true] { background: #1f5482; border-color: #3b8ad0; color: #fff; }
.tcfit-panel button[aria-pressed=true]:hover:not(:disabled) { background: #27649a; border-color: #5aa3e0; }
.tcfit-panel button.tcfit-main { background: #1c6fb5; border-color: #3b8ad0; color: #fff; font-weight: 600; }
.tcfit-panel button.tcfit-main:hover:not(:disabled) { background: #2680ca; }
.tcfit-panel button.tcfit-left { justify-content: space-between; }
.tcfit-panel button.tcfit-mini { flex: none; height: 20px; padding: 0 7px; font-size: 11px; }
.tcfit-panel kbd { flex: none; margin-left: 6px; font: 10.5px/1 ${FONT}; color: #8793a3; }
.tcfit-panel button[aria-pressed=true] kbd, .tcfit-panel button.tcfit-main kbd { color: #b5d6f2; }
.tcfit-panel i { display: inline-block; width: 8px; height: 8px; margin-right: 5px; border-radius: 50%; }
.tcfit-panel button.tcfit-close { width: 100%; margin-top: 10px; }
.mantine-Modal-content:has(.tcfit-keys) { flex: 0 1 860px !important; max-height: 94vh !important; }
.mantine-Modal-header:has(+ .mantine-Modal-body .tcfit-keys) { padding-bottom: 0 !important; min-height: 0 !important; }
.tcfit-keys { columns: 2; column-gap: 28px; }
.tcfit-keys section { break-inside: avoid; padding-bottom: 12px; }
.tcfit-keys td:first-child { width: 118px; }
.tcfit-joined { display: flex; flex: 1 1 auto; min-width: 0; }
.tcfit-joined button { border-radius: 0; margin-left: -1px; padding: 0 5px; }
.tcfit-joined kbd { margin-left: 4px; }
.tcfit-joined button:first-child { border-radius: 4px 0 0 4px; margin-left: 0; }
.tcfit-joined button:last-child { border-radius: 0 4px 4px 0; }
.tcfit-joined button[aria-pressed=true] { position: relative; z-index: 1; }
.tcfit-panel button.tcfit-danger { border-color: #7d3a38; color: #ff9d97; }
.tcfit-panel button.tcfit-danger:hover:not(:disabled) { background: #5e2826; border-color: #a84d49; color: #fff; }
.tcfit-dim { color: ${COLORS.dim}; } .tcfit-good { color: ${COLORS.good}; } .tcfit-bad { color: ${COLORS.wrong}; }
.tcfit-warn { color: ${COLORS.flagged}; } .tcfit-strong { font-weight: 600; }
.tcfit-badge { margin-left: 4px; padding: 0 4px; border-radius: 3px; color: #111; font-size: 10.5px; }
.tcfit-panel .tcfit-track { --kind: ${COLORS.accent}; margin: 5px 0 7px; }
.tcfit-panel dl { display: grid; grid-template-columns: minmax(74px, auto) 1fr; gap: 2px 6px; margin: 4px 0; font-size: 11.5px; }
.tcfit-panel dt { color: ${COLORS.dim}; overflow-wrap: anywhere; } .tcfit-panel dd { margin: 0; overflow-wrap: anywhere; }
.tcfit-panel ul { margin: 4px 0; padding-left: 14px; font-size: 11.5px; overflow-wrap: anywhere; }
.tcfit-panel pre { margin: 0; font-size: 11px; line-height: 1.35; white-space: pre-wrap; overflow-wrap: anywhere; }
.tcfit-table { width: 100%; border-collapse: collapse; font: 11.5px/1.35 ${FONT}; font-variant-numeric: tabular-nums; }
.tcfit-table th { padding: 2px 4px 3px; text-align: left; font-weight: 500; color: ${COLORS.dim}; white-space: nowrap; }
.tcfit-table td { padding: 2.5px 4px; border-top: 1px solid #31363d; vertical-align: baseline;
  overflow-wrap: anywhere; }
.tcfit-table .tcfit-number, .tcfit-table .tcfit-whole { white-space: nowrap; overflow-wrap: normal; }
.tcfit-table .tcfit-number { text-align: right; }
.tcfit-table tr[data-tcfit] { cursor: pointer; }
.tcfit-table tr[data-tcfit]:hover td { background: #333943; }
.tcfit-table tr.tcfit-here td { background: #1f3f5c; }
.tcfit-table tr.tcfit-off td { color: #737c88; }
.tcfit-table tr.tcfit-off td:last-child { text-decoration: line-through #565e69; }
.tcfit-table kbd { margin: 0; font: 11.5px/1 ${FONT}; color: ${COLORS.text}; white-space: nowrap; }
.tcfit-detected { color: #9fc6ea; } .tcfit-corrected { color: ${COLORS.edited}; }
.tcfit-missing { color: ${COLORS.dim}; }
.mantine-Slider-markLabel { display: none; }
.uplot-container .uplot { width: 100%; }
div[style*="flex-shrink: 0"]:has(> p > label) { width: 78px !important; padding-right: 4px; }
div[style*="flex-shrink: 0"] > p:has(> label) { font-size: 12px !important; letter-spacing: 0 !important; }
`;
// A plot of viser's learns its width only after it has been drawn: until then its title would have a word a line.
const panelSheet = element("style", "", document.head, PANEL_SHEET);
ending.signal.addEventListener("abort", () => panelSheet.remove());

let pressedFirst = null; // what the pointer went down on: the panel may be drawn anew before it goes up

/** The command under an event, if there is one. */
function commandOf(event) {
  const found = event.target instanceof Element ? event.target.closest("[data-tcfit]") : null;
  if (!found || found.disabled) return null;
  return { type: "press", command: found.dataset.tcfit, value: found.dataset.value ?? "" };
}

window.addEventListener("pointerdown", (event) => {
  pressedFirst = event.button === 0 ? commandOf(event) : null;
}, capturing);

window.addEventListener("pointerup", (event) => {
  const command = commandOf(event);
  const same = command?.command === pressedFirst?.command && command?.value === pressedFirst?.value;
  if (command && same) emit(command);
  pressedFirst = null;
}, capturing);

window.addEventListener("click", (event) => {
  const command = event.detail === 0 ? commandOf(event) : null; // by keyboard, or by assistive software
  if (command) emit(command);
}, capturing);

/** Presses the button that closes the window on top; whether there is one. */
function closeWindow() {
  const button = [...document.querySelectorAll("[role=dialog] .tcfit-close")].pop();
  if (button) emit({ type: "press", command: button.dataset.tcfit, value: button.dataset.value });
  return Boolean(button);
}

window.addEventListener("pointerdown", ({ target }) => {
  if (target instanceof Element && target.matches(".mantine-Modal-inner, .mantine-Modal-overlay")) closeWindow();
}, capturing);

// Of a dropdown's text, so that what is typed is looked for and not added to it.
window.addEventListener("click", ({ target }) => {
  const field = target instanceof HTMLInputElement && target.matches("[aria-haspopup=listbox]") ? target : null;
  if (field && field.selectionStart === field.selectionEnd) field.select();
}, capturing);
