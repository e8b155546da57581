// Colours, and the style sheets of the script's own elements and of the panels' HTML.

export const COLORS = {
  surface: "#14171c",
  line: "#2a2f38",
  text: "#cfd6df",
  dim: "#8a94a3",
  accent: "#288cdc",
  cursor: "#f4f7fb",
  selected: "#ffe14d",
  hover: "#ffffff",
  bad: "#ff5a52",
  edited: "#35d6ee",
  flagged: "#ffb02e",
  checked: "#55c26a",
  apart: "#c9a3ff",
  good: "#51cf66",
  wrong: "#ff8787", // in text: lighter than the marks, to be read on the panels' grey
};
export const FIT_COLORS = { fitting: "#f0c44a", phase1: "#35618a", phase2: "#2f86c9", done: "#46b37b" };
export const FIT_NAMES = {
  fitting: "in work",
  phase1: "phase 1 done",
  phase2: "phase 2 done",
  done: "finished",
};
export const KIND_COLORS = {
  info: COLORS.accent,
  busy: COLORS.flagged,
  good: COLORS.checked,
  warning: COLORS.flagged,
  error: COLORS.bad,
};
export const FONT = 'Inter, system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif';

export const STYLE_SHEET = `
.tcfit, .tcfit * { box-sizing: border-box; }
.tcfit { position: absolute; inset: 0; z-index: 2; pointer-events: none; overflow: hidden; color: ${COLORS.text};
  font: 13px/1.4 ${FONT}; user-select: none; -webkit-user-select: none; }
.tcfit-lost { pointer-events: auto; background: rgba(12, 14, 18, 0.5); }
.tcfit-lost > canvas { opacity: 0.5; }
.tcfit-lost ~ .tcfit-strip { pointer-events: none; }
.tcfit-lost ~ .tcfit-strip::after { content: ""; position: absolute; inset: 0; background: rgba(12, 14, 18, 0.5); }
.tcfit > canvas { position: absolute; inset: 0; width: 100%; height: 100%; }
.tcfit-chips { position: absolute; bottom: 12px; left: 12px; right: 12px; display: flex; flex-wrap: wrap-reverse;
  gap: 8px; }
.tcfit:has(.tcfit-legend:not([hidden])) .tcfit-chips { bottom: 42px; }
.tcfit-chip { display: flex; align-items: center; gap: 8px; max-width: 100%; padding: 4px 12px; border-radius: 14px;
  background: rgba(16, 19, 24, 0.86); border: 1px solid rgba(255, 255, 255, 0.09); font-size: 12.5px;
  font-variant-numeric: tabular-nums; box-shadow: 0 2px 8px rgba(0, 0, 0, 0.3); overflow: hidden; position: relative; }
.tcfit-chip span { overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
.tcfit-dot { flex: none; width: 8px; height: 8px; border-radius: 50%; }
.tcfit-chip .tcfit-bar { position: absolute; left: 0; bottom: 0; height: 2px; }
.tcfit-card { position: absolute; left: 50%; top: 50%; transform: translate(-50%, -50%); width: min(460px, 84%);
  padding: 22px 26px; border-radius: 12px; background: rgba(20, 23, 28, 0.95);
  border: 1px solid rgba(255, 255, 255, 0.1); border-top: 3px solid var(--kind);
  box-shadow: 0 12px 40px rgba(0, 0, 0, 0.4); }
.tcfit-card h2 { margin: 0; font-size: 17px; font-weight: 600; line-height: 1.35; color: #eef2f6; }
.tcfit-card p { margin: 8px 0 0; white-space: pre-line; overflow-wrap: anywhere; color: #b4bdc9; user-select: text;
  -webkit-user-select: text; pointer-events: auto; max-height: 40vh; overflow-y: auto; }
.tcfit-track { margin-top: 16px; height: 4px; border-radius: 2px; background: #2b313b; overflow: hidden; }
.tcfit-bar { height: 100%; background: var(--kind); transition: width 0.2s; }
.tcfit-legend { position: absolute; right: 14px; bottom: 5px; display: flex; align-items: center; gap: 7px;
  max-width: calc(100% - 28px); height: 24px; padding: 0 12px; border-radius: 8px; font-size: 12px; white-space: nowrap;
  background: rgba(16, 19, 24, 0.86); border: 1px solid rgba(255, 255, 255, 0.09);
  font-variant-numeric: tabular-nums; }
.tcfit-legend div { flex: none; width: 130px; height: 9px; border-radius: 3px; }
.tcfit-legend span { color: ${COLORS.dim}; }
.tcfit-legend span:first-child { color: ${COLORS.text}; overflow: hidden; text-overflow: ellipsis; margin-right: 4px; }
.tcfit-tooltip { position: absolute; left: 0; top: 0; padding: 4px 9px; border-radius: 6px; white-space: pre;
  background: rgba(12, 14, 18, 0.94); border: 1px solid rgba(255, 255, 255, 0.14); font-size: 12px; color: #e8edf3;
  font-variant-numeric: tabular-nums; box-shadow: 0 2px 10px rgba(0, 0, 0, 0.4); }
.tcfit-strip { position: absolute; left: 0; right: 0; top: 100%; z-index: 2; background: ${COLORS.surface};
  border-top: 1px solid #000; touch-action: none; user-select: none; -webkit-user-select: none;
  font: 12px/1.4 ${FONT}; color: ${COLORS.text}; }
.tcfit-strip > canvas { position: absolute; inset: 0; width: 100%; height: 100%; cursor: default; }
.tcfit-strip > button { position: absolute; right: 4px; top: 1px; width: 24px; height: 18px; padding: 0; border: 0;
  border-radius: 4px; background: transparent; color: ${COLORS.dim}; cursor: pointer; font-size: 12px; }
.tcfit-strip > button:hover { background: #2a2f38; color: #fff; }
.tcfit-strip .tcfit-tooltip { z-index: 1; pointer-events: none; }
[hidden].tcfit-tooltip, [hidden].tcfit-card, [hidden].tcfit-legend, [hidden].tcfit-strip { display: none; }
`;

export const PANEL_SHEET = `
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
`;
