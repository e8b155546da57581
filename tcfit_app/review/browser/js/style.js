// Colours, sizes and the style sheet.

const COLORS = {
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
const FIT_COLORS = { queued: "#39414d", fitting: "#f0c44a", phase1: "#35618a", phase2: "#2f86c9", done: "#46b37b" };
const FIT_NAMES = {
  queued: "waiting",
  fitting: "in work",
  phase1: "phase 1 done",
  phase2: "phase 2 done",
  done: "finished",
};
const KIND_COLORS = {
  info: COLORS.accent,
  loading: COLORS.accent,
  busy: COLORS.flagged,
  good: COLORS.checked,
  warning: COLORS.flagged,
  error: COLORS.bad,
};
const FONT = 'Inter, system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif';

const STYLE_SHEET = `
.tcfit, .tcfit * { box-sizing: border-box; }
.tcfit { position: absolute; inset: 0; z-index: 2; pointer-events: none; overflow: hidden; color: ${COLORS.text};
  font: 13px/1.4 ${FONT}; user-select: none; -webkit-user-select: none; }
.tcfit-lost { pointer-events: auto; background: rgba(12, 14, 18, 0.5); }
.tcfit-lost > canvas { opacity: 0.5; }
.tcfit-lost ~ .tcfit-strip { pointer-events: none; }
.tcfit-lost ~ .tcfit-strip::after { content: ""; position: absolute; inset: 0; background: rgba(12, 14, 18, 0.5); }
body:has(.tcfit-lost) .mantine-Modal-root { display: none; }
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
.tcfit-waiting { width: 30%; animation: tcfit-wait 1.4s ease-in-out infinite alternate; }
@keyframes tcfit-wait { from { margin-left: 0; } to { margin-left: 70%; } }
@media (prefers-reduced-motion: reduce) { .tcfit-waiting { animation: none; width: 100%; opacity: 0.5; } }
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
