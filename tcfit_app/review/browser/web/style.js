// The style sheets of the script's own elements and of the panels' HTML.

/** As viser's own. */
export const FONT = '-apple-system, BlinkMacSystemFont, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif';

export const STYLE_SHEET = `
.tcfit, .tcfit * { box-sizing: border-box; }
.tcfit { position: absolute; inset: 0; z-index: 2; pointer-events: none; overflow: hidden; color: var(--tcfit-text);
  font: 13px/1.4 ${FONT}; user-select: none; -webkit-user-select: none; }
.tcfit-stage { background: var(--tcfit-stage); }
.tcfit-lost .tcfit { pointer-events: auto; background: color-mix(in srgb, var(--tcfit-stage) 50%, transparent); }
.tcfit-lost .tcfit > canvas { opacity: 0.5; }
.tcfit-lost .tcfit-strip { pointer-events: none; }
.tcfit-lost .tcfit-strip::after { content: ""; position: absolute; inset: 0; background: color-mix(in srgb, var(--tcfit-stage) 50%, transparent); }
.tcfit > canvas { position: absolute; inset: 0; width: 100%; height: 100%; }
.tcfit-divider { position: absolute; left: -9px; top: 0; width: 18px; pointer-events: auto; cursor: col-resize;
  touch-action: none; outline: none; }
.tcfit-divider::before { content: ""; position: absolute; left: 8px; top: 0; bottom: 0; width: 2px; background: #eef2f6;
  box-shadow: 0 0 0 1px rgba(8, 10, 14, 0.7); }
.tcfit-divider::after { content: "\\2194"; position: absolute; left: -5px; top: calc(50% - 14px); width: 28px; height: 28px;
  border-radius: 50%; background: #eef2f6; color: #14171c; font: 700 17px/27px ${FONT}; text-align: center;
  box-shadow: 0 0 0 1px rgba(8, 10, 14, 0.7); }
.tcfit-person { position: absolute; left: 0; top: 0; pointer-events: auto; cursor: pointer; border: 0; border-radius: 6px;
  padding: 3px 9px; background: var(--tcfit-surface); color: var(--tcfit-text); font: 600 12px ${FONT}; white-space: nowrap; }
.tcfit-person:hover { background: var(--tcfit-pointed); color: var(--tcfit-strong); }
.tcfit-person:focus-visible { outline: 2px solid var(--tcfit-accent); outline-offset: 1px; }
.tcfit-divider:focus-visible::after { box-shadow: 0 0 0 2px #14171c, 0 0 0 5px var(--tcfit-accent); }
.tcfit-card { position: absolute; left: 50%; top: 50%; transform: translate(-50%, -50%); width: min(460px, 84%);
  padding: 22px 26px; border-radius: 12px; background: var(--tcfit-surface);
  border: 1px solid var(--tcfit-edge); border-top-width: 3px;
  box-shadow: 0 12px 40px rgba(0, 0, 0, 0.4); }
.tcfit-card h2 { margin: 0; font-size: 17px; font-weight: 600; line-height: 1.35; color: var(--tcfit-strong); }
.tcfit-card p { margin: 8px 0 0; white-space: pre-line; overflow-wrap: anywhere; user-select: text;
  -webkit-user-select: text; pointer-events: auto; max-height: 40vh; overflow-y: auto; }
.tcfit-tooltip { position: absolute; left: 0; top: 0; padding: 4px 9px; border-radius: 6px; white-space: pre;
  background: var(--tcfit-surface); border: 1px solid var(--tcfit-edge); font-size: 13px;
  font-variant-numeric: tabular-nums; box-shadow: 0 2px 10px rgba(0, 0, 0, 0.4); }
.tcfit-strip { position: absolute; left: 0; right: 0; top: 100%; z-index: 2; background: var(--tcfit-surface);
  border-top: 1px solid var(--tcfit-rule); touch-action: none; user-select: none; -webkit-user-select: none;
  font: 13px/1.4 ${FONT}; color: var(--tcfit-text); }
.tcfit-strip > canvas { position: absolute; inset: 0; width: 100%; height: 100%; cursor: default; }
.tcfit-strip > canvas + canvas { pointer-events: none; }
.tcfit-strip button { flex: none; min-width: 24px; height: 20px; padding: 0 6px; border: 1px solid transparent;
  border-radius: 4px; background: transparent; color: var(--tcfit-text); font: 13px/1 ${FONT}; cursor: pointer; }
.tcfit-strip button:hover { background: var(--tcfit-pointed); color: var(--tcfit-strong); }
.tcfit-strip button:focus-visible { outline: 2px solid var(--tcfit-accent); outline-offset: -1px; }
.tcfit-strip-title { position: absolute; left: 0; display: grid; grid-template-columns: 1fr 16px; align-content: start; align-items: start; gap: 2px;
  padding: 3px 0 0 8px; overflow: hidden; line-height: 14px; pointer-events: none; }
.tcfit-strip-title > p { grid-column: 1 / 3; display: flex; flex-wrap: wrap; gap: 0 6px; margin: 0; line-height: 15px; color: var(--tcfit-dim); }
.tcfit-strip-title i { display: inline-block; width: 7px; height: 7px; margin-right: 3px; border-radius: 50%; }
.tcfit-strip-title > span { overflow-wrap: anywhere; }
.tcfit-strip-title > * { pointer-events: auto; }
.tcfit-strip-title > button { min-width: 16px; height: 15px; padding: 0; color: var(--tcfit-dim); }
.tcfit-strip-title > [aria-haspopup] { height: auto; margin-left: -4px; padding: 0 4px;
  color: inherit; font: inherit; line-height: 14px; text-align: left; overflow-wrap: anywhere; }
.tcfit-menu { position: fixed; z-index: 1000; display: flex; flex-direction: column; min-width: 180px; padding: 4px;
  max-height: calc(100vh - 8px); border-radius: 7px; background: var(--tcfit-menu); border: 1px solid var(--tcfit-edge);
  box-shadow: 0 8px 28px rgba(0, 0, 0, 0.5); font: 13px/1.4 ${FONT}; user-select: none; -webkit-user-select: none; }
.tcfit-menu > [role=menu] { display: flex; flex-direction: column; min-height: 0; overflow-y: auto; }
.tcfit-menu input { flex: none; height: 28px; margin: 0 0 4px; padding: 0 8px; border: 1px solid var(--tcfit-edge); border-radius: 4px;
  background: var(--tcfit-field); color: var(--tcfit-text); font: inherit; }
.tcfit-menu input:focus-visible { outline: 2px solid var(--tcfit-accent); outline-offset: -1px; }
.tcfit-menu button { display: flex; align-items: center; gap: 24px; flex: none; padding: 4px 10px; border: 0;
  border-radius: 4px; background: transparent; color: var(--tcfit-text); font: inherit; text-align: left;
  white-space: nowrap; cursor: pointer; }
.tcfit-menu button > span { flex: 1 1 auto; }
.tcfit-menu button:focus { outline: none; background: var(--tcfit-soft); color: var(--tcfit-strong); }
.tcfit-menu button[aria-disabled] { opacity: 0.45; cursor: default; }
.tcfit-menu button[aria-disabled]:focus { background: var(--tcfit-pointed); color: var(--tcfit-text); }
.tcfit-menu button[aria-checked]::before { content: ""; flex: none; width: 14px; margin-right: -16px; }
.tcfit-menu button[aria-checked=true]::before { content: "✓"; }
.tcfit-menu kbd { flex: none; font: 13px/1 ${FONT}; color: var(--tcfit-key); }
.tcfit-menu p { width: 0; min-width: 100%; min-height: 2.8em; margin: 4px 0 0; padding: 4px 10px 0; color: var(--tcfit-dim);
  border-top: 1px solid var(--tcfit-edge); }
.tcfit-menu .tcfit-heading { flex: none; padding: 6px 10px 2px; color: var(--tcfit-dim); font-weight: 600; }
.tcfit-menu .tcfit-separator { flex: none; height: 1px; margin: 4px 6px; background: var(--tcfit-edge); }
.tcfit-strip .tcfit-tooltip { z-index: 1; pointer-events: none; }
.tcfit-menu [hidden], [hidden].tcfit-person, [hidden].tcfit-tooltip, [hidden].tcfit-divider, [hidden].tcfit-card, [hidden].tcfit-strip { display: none; }
`;

export const PANEL_SHEET = `
.tcfit-panel { padding: 0 10px 7px; font: 13px/1.4 ${FONT}; color: var(--tcfit-text); font-variant-numeric: tabular-nums; }
.tcfit-panel h3 { display: flex; justify-content: space-between; gap: 8px; margin: 4px 0 5px; padding-top: 6px;
  border-top: 1px solid var(--tcfit-rule); font: 600 13px/1.4 ${FONT}; color: var(--tcfit-dim); }
.tcfit-panel h3.tcfit-first { margin-top: 0; padding-top: 0; border-top: 0; }
.tcfit-panel h3.tcfit-first b { color: var(--tcfit-strong); }
.tcfit-panel h3 span { font-weight: 400; }
.tcfit-panel p { margin: 3px 0; white-space: pre-line; overflow-wrap: anywhere; }
.tcfit-row { display: flex; align-items: center; gap: 4px; margin: 0 0 5px; }
.tcfit-row:last-child { margin-bottom: 0; }
.tcfit-wrap { flex-wrap: wrap; }
.tcfit-cells { display: grid; grid-template-columns: 1fr 1fr; gap: 4px; }
.tcfit-row > label { flex: none; width: 80px; color: var(--tcfit-dim); }
.tcfit-panel button { display: inline-flex; align-items: center; justify-content: center; flex: 1 1 auto; min-width: 0;
  height: 25px; padding: 0 7px; border: 1px solid var(--tcfit-edge);
  border-radius: 4px; background: var(--tcfit-button); color: var(--tcfit-text); font: 13px/1 ${FONT}; white-space: nowrap; cursor: pointer; touch-action: manipulation; user-select: none;
  -webkit-user-select: none; }
.tcfit-panel button > span { overflow: hidden; text-overflow: ellipsis; padding: 3px 0; }
.tcfit-cells button { height: auto; min-height: 25px; padding: 0 3px; white-space: normal; }
.tcfit-panel button:hover:not(:disabled) { background: var(--tcfit-raised); border-color: var(--tcfit-raised-edge); color: var(--tcfit-strong); }
.tcfit-panel button:active:not(:disabled) { background: var(--tcfit-sunk); }
.tcfit-panel button:focus-visible { outline: 2px solid var(--tcfit-accent); outline-offset: 1px; }
.tcfit-panel button:disabled { opacity: 0.42; cursor: default; }
.tcfit-panel button[aria-pressed=true], .tcfit-panel button[aria-pressed=true]:hover:not(:disabled) { background: var(--tcfit-soft); border-color: var(--tcfit-accent); color: var(--tcfit-accent); }
.tcfit-panel button.tcfit-main { background: var(--tcfit-accent); border-color: var(--tcfit-accent); color: var(--tcfit-on-accent); font-weight: 600; }
.tcfit-panel button.tcfit-main:hover:not(:disabled) { background: color-mix(in srgb, var(--tcfit-accent) 88%, var(--tcfit-strong)); color: var(--tcfit-on-accent); }
.tcfit-panel button.tcfit-fold { justify-content: flex-start; border-color: transparent; background: none; font-weight: 600; }
.tcfit-panel button.tcfit-fold:hover:not(:disabled) { background: var(--tcfit-pointed); }
.tcfit-panel button.tcfit-tall { width: 100%; height: auto; justify-content: flex-start; margin-bottom: 5px;
  padding: 4px 9px; line-height: 1.35; text-align: left; white-space: normal; }
.tcfit-panel button.tcfit-tall > span > span { display: block; }
.tcfit-panel button.tcfit-mini { flex: none; height: 20px; padding: 0 7px; font-size: 13px; }
.tcfit-panel kbd { flex: none; margin-left: 6px; font: 13px/1 ${FONT}; color: var(--tcfit-key); }
.tcfit-panel button[aria-pressed=true] kbd, .tcfit-panel button.tcfit-main kbd { color: inherit; }
.tcfit-panel button.tcfit-close { position: sticky; bottom: 0; width: 100%; margin-top: 10px; }
.tcfit-keys { columns: 330px; column-gap: 28px; margin-top: 10px; }
.tcfit-keys section { break-inside: avoid; padding-bottom: 12px; }
.tcfit-keys table { table-layout: fixed; }
.tcfit-keys td:first-child { width: 136px; }
.tcfit-keys .tcfit-table kbd { white-space: normal; }
.tcfit-joined { display: flex; flex-wrap: wrap; flex: 1 1 auto; min-width: 0; }
.tcfit-joined button { border-radius: 0; margin-left: -1px; padding: 0 5px; }
.tcfit-joined kbd { margin-left: 4px; }
.tcfit-joined button:first-child { border-radius: 4px 0 0 4px; margin-left: 0; }
.tcfit-joined button:last-child { border-radius: 0 4px 4px 0; }
.tcfit-joined button[aria-pressed=true] { position: relative; z-index: 1; }
.tcfit-panel button.tcfit-danger { border-color: currentcolor; background: var(--tcfit-surface); color: var(--tcfit-bad); }
.tcfit-panel button.tcfit-danger:hover:not(:disabled) { background: var(--tcfit-pointed); }
.tcfit-dim { color: var(--tcfit-dim); } .tcfit-good { color: var(--tcfit-checked); } .tcfit-bad { color: var(--tcfit-bad); }
.tcfit-warn { color: var(--tcfit-suspicious); } .tcfit-strong { font-weight: 600; }
.tcfit-badge { margin-right: 6px; padding: 0 4px; border: 2px solid; border-radius: 3px; line-height: 1.1; }
.tcfit-track { height: 4px; margin: 5px 0 7px; border-radius: 2px; background: var(--tcfit-rule); overflow: hidden; }
.tcfit-bar { height: 100%; background: var(--tcfit-accent); transition: width 0.2s; }
.tcfit-panel dl { display: grid; grid-template-columns: minmax(74px, auto) 1fr; gap: 2px 6px; margin: 4px 0; font-size: 13px; }
.tcfit-panel dt { color: var(--tcfit-dim); overflow-wrap: anywhere; } .tcfit-panel dd { margin: 0; overflow-wrap: anywhere; }
.tcfit-panel ul { margin: 4px 0; padding-left: 14px; font-size: 13px; overflow-wrap: anywhere; }
.tcfit-panel button.tcfit-entry { display: block; width: 100%; height: auto; margin: 0 0 5px; padding: 5px 8px; line-height: 1.4; text-align: left; white-space: normal; }
.tcfit-entry b, .tcfit-panel button.tcfit-entry span { display: block; padding: 0; }
.tcfit-entry span { color: var(--tcfit-dim); }
.tcfit-panel button.tcfit-entry[aria-current] { background: var(--tcfit-soft); }
.tcfit-table { width: 100%; border-collapse: collapse; font: 13px/1.35 ${FONT}; font-variant-numeric: tabular-nums; }
.tcfit-table th { padding: 2px 4px 3px; text-align: left; font-weight: 500; color: var(--tcfit-dim); white-space: nowrap; }
.tcfit-table td { padding: 2.5px 4px; border-top: 1px solid var(--tcfit-rule); vertical-align: baseline;
  overflow-wrap: anywhere; }
.tcfit-table .tcfit-number, .tcfit-table .tcfit-whole { white-space: nowrap; overflow-wrap: normal; }
.tcfit-table .tcfit-number { text-align: right; }
.tcfit-table .tcfit-number div { white-space: normal; }
.tcfit-table tr[data-tcfit] { cursor: pointer; }
.tcfit-table tr[data-tcfit]:hover td { background: var(--tcfit-pointed); }
.tcfit-panel .tcfit-open { display: inline; height: auto; padding: 0; border: 0; background: none; color: inherit; font: inherit; text-align: inherit;
  text-decoration: inherit; white-space: inherit; cursor: pointer; }
.tcfit-panel .tcfit-open:focus-visible { outline: 2px solid var(--tcfit-accent); outline-offset: 1px; }
.tcfit-table tr.tcfit-here td { background: var(--tcfit-soft); }
.tcfit-table tr.tcfit-off td { color: var(--tcfit-off); }
.tcfit-table tr.tcfit-off td:last-child { text-decoration: line-through var(--tcfit-off); }
.tcfit-table kbd { margin: 0; font: 13px/1 ${FONT}; color: var(--tcfit-text); white-space: nowrap; }
`;
