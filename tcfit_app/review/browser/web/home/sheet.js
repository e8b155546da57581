// The list's style sheet, in the colours of the review's panels.

import { FONT } from "../style.js";

export const ROW = 72; // CSS pixels of a row, all of which are alike: what is out of sight is not there
const STATE_COLORS = { new: "dim", fitted: "text", review: "suspicious", approved: "checked" }; // of the theme

export const LIST_SHEET = `
html { color-scheme: dark light; }
body { margin: 0; height: 100vh; display: flex; flex-direction: column; background: var(--tcfit-surface);
  color: var(--tcfit-text); font: 14px/1.4 ${FONT}; font-variant-numeric: tabular-nums; }
header.tcfit-panel { display: flex; flex-wrap: wrap; align-items: center; gap: 8px 12px; padding: 10px 18px;
  border-bottom: 1px solid var(--tcfit-rule); }
h1 { flex: none; max-width: 30vw; margin: 0 6px 0 0; font-size: 18px; font-weight: 600; color: var(--tcfit-strong);
  overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
header.tcfit-panel button { flex: none; height: 30px; padding: 0 12px; }
header .tcfit-joined { flex: none; flex-wrap: nowrap; }
header .tcfit-joined button { padding: 0 10px; }
header .tcfit-joined b { margin-left: 6px; font-weight: 400; color: var(--tcfit-dim); }
header .tcfit-joined button[aria-pressed=true] b { color: inherit; }
header input { flex: 1 1 120px; min-width: 100px; max-width: 320px; margin-right: auto; height: 28px; padding: 0 10px; border: 1px solid var(--tcfit-edge);
  border-radius: 4px; background: var(--tcfit-field); color: var(--tcfit-text); font: inherit; }
:is(input, a, button, tr, dialog):focus-visible { outline: 2px solid var(--tcfit-accent); outline-offset: 1px; }
tr:focus-visible { outline-offset: -2px; }
main { flex: 1 1 0; min-height: 0; overflow: auto; scrollbar-gutter: stable; }
table { width: 100%; border-collapse: separate; border-spacing: 0; table-layout: fixed; }
thead th { position: sticky; top: 0; z-index: 1; height: 34px; padding: 0 10px; overflow: hidden; border-bottom: 1px solid var(--tcfit-rule);
  background: var(--tcfit-surface); font-weight: 500; text-align: left; color: var(--tcfit-dim); white-space: nowrap; }
thead button { padding: 4px 0; border: 0; background: none; color: inherit; font: inherit; cursor: pointer; }
thead button:hover { color: var(--tcfit-strong); }
th[aria-sort] button { color: var(--tcfit-strong); }
th[aria-sort=ascending] button::after { content: " ▲"; font-size: 10px; }
th[aria-sort=descending] button::after { content: " ▼"; font-size: 10px; }
:is(th, td) { box-sizing: border-box; }
:is(th, td).check { padding-left: 18px; }
.check { width: 42px; } .picture { width: 60px; } .name { width: 20%; } .length { width: 104px; } .state { width: 14%; }
.off { width: 104px; } .reviewer { width: 12%; } .note { width: 15%; }
tbody tr.clip { height: ${ROW}px; cursor: default; }
tbody td { height: ${ROW - 1}px; padding: 0 10px; border-bottom: 1px solid var(--tcfit-rule); overflow: hidden; vertical-align: middle; }
tbody td > div { max-height: ${ROW - 6}px; overflow: hidden; }
tr.clip:hover td { background: var(--tcfit-bed); }
tr.clip[aria-selected=true] td { background: var(--tcfit-soft); }
td.picture { padding: 0 0 0 4px; }
td img, td .blank { display: block; width: 51px; height: 64px; border-radius: 4px; object-fit: cover; background: var(--tcfit-bed); }
td .one { overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
td .two { display: -webkit-box; -webkit-box-orient: vertical; -webkit-line-clamp: 2; overflow: hidden; overflow-wrap: anywhere; }
td .dim { font-size: 13px; color: var(--tcfit-dim); }
tr[aria-selected=true] .dim { color: var(--tcfit-text); }
td a { color: var(--tcfit-strong); font-weight: 600; text-decoration: none; }
td a:hover { text-decoration: underline; }
.badge::before { content: ""; display: inline-block; width: 9px; height: 9px; margin-right: 7px; border-radius: 50%; background: var(--dot); }
${Object.entries(STATE_COLORS).map(([state, color]) => `.badge.${state} { --dot: var(--tcfit-${color}); }`).join(" ")}
.score { font-weight: 600; color: var(--tcfit-strong); }
.score.good { color: var(--tcfit-checked); } .score.doubtful { color: var(--tcfit-suspicious); } .score.worst { color: var(--tcfit-bad); }
.wrong { color: var(--tcfit-bad); }
.busy { color: var(--tcfit-suspicious); }
.plain { max-width: 100%; padding: 2px 0; border: 0; background: none; color: inherit; font: inherit; text-align: left; cursor: pointer; }
.plain:hover { color: var(--tcfit-strong); text-decoration: underline; }
.plain.empty { color: var(--tcfit-dim); opacity: 0; } tr:is(:hover, :focus-within) .plain.empty { opacity: 1; }
.track { height: 4px; margin-top: 5px; border-radius: 2px; background: var(--tcfit-rule); overflow: hidden; }
.track > div { height: 100%; background: var(--tcfit-accent); transition: width 0.3s; }
.nothing { margin: 12vh auto 0; max-width: 34em; padding: 0 20px; text-align: center; color: var(--tcfit-dim); }
footer { display: flex; gap: 24px; padding: 7px 18px; border-top: 1px solid var(--tcfit-rule); font-size: 13px;
  color: var(--tcfit-dim); white-space: nowrap; }
footer .keys { flex: 1; overflow: hidden; text-overflow: ellipsis; }
footer .keys span { margin-right: 18px; }
footer .notice { color: var(--tcfit-text); }
footer kbd { font: inherit; color: var(--tcfit-key); font-weight: 600; }
.alert { position: fixed; right: 24px; bottom: 48px; z-index: 3; display: flex; gap: 14px; align-items: flex-start; max-width: 460px;
  padding: 14px 16px; border-radius: 8px; background: var(--tcfit-menu); border: 1px solid var(--tcfit-edge);
  border-left: 3px solid var(--tcfit-bad); box-shadow: 0 8px 28px rgba(0, 0, 0, 0.4); overflow-wrap: anywhere; }
.alert div { max-height: 40vh; overflow: auto; white-space: pre-line; }
.alert.tcfit-panel button { flex: none; }
.alert[hidden] { display: none; }
dialog { width: min(460px, 90vw); padding: 18px 20px; border: 1px solid var(--tcfit-edge); border-radius: 10px;
  background: var(--tcfit-menu); color: var(--tcfit-text); }
dialog::backdrop { background: rgba(0, 0, 0, 0.45); }
dialog.wide { width: min(840px, 92vw); }
dialog h2 { margin: 0 0 12px; font-size: 16px; font-weight: 600; color: var(--tcfit-strong); }
dialog .group { display: flex; gap: 12px; padding: 5px 0; }
dialog .group > .dim { flex: 0 0 90px; margin: 0; line-height: 22px; }
dialog .choices { flex: 1; display: grid; grid-template-columns: repeat(4, 1fr); gap: 2px 12px; }
dialog .choices label { display: flex; gap: 7px; align-items: center; min-height: 22px; margin: 0; font-weight: 400; }
dialog .choices input { margin: 0; }
dialog .dim { margin: 6px 0 0; font-size: 13px; color: var(--tcfit-dim); }
dialog select { flex: 1; min-width: 0; height: 28px; border: 1px solid var(--tcfit-edge); border-radius: 4px;
  background: var(--tcfit-field); color: var(--tcfit-text); font: inherit; }
@media (max-width: 800px) { dialog .choices { grid-template-columns: repeat(2, 1fr); } }
dialog :is(input[type=checkbox], select):focus-visible { outline: 2px solid var(--tcfit-accent); outline-offset: 1px; }
dialog label { display: block; margin-bottom: 8px; font-weight: 600; }
dialog input:not([type=checkbox]) { box-sizing: border-box; width: 100%; height: 32px; padding: 0 10px; border: 1px solid var(--tcfit-edge); border-radius: 4px;
  background: var(--tcfit-field); color: var(--tcfit-text); font: inherit; }
dialog .buttons { display: flex; justify-content: flex-end; gap: 8px; margin-top: 14px; padding: 0; }
dialog .buttons button { flex: none; height: 30px; padding: 0 16px; }
@media (max-width: 1000px) { .length { display: none; } }
`;
