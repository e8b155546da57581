// How the header above the picture and the bar under it look. Their buttons are those of the panels, but flat.

/** In CSS pixels. */
export const HEADER_HEIGHT = 40;
/** The least; it wraps where there is little room. */
export const BAR_HEIGHT = 34;

export const BARS_SHEET = `
.tcfit-header, .tcfit-transport { position: absolute; left: 0; right: 0; z-index: 3; display: flex; align-items: center;
  gap: 4px 3px; padding: 0 8px; background: var(--tcfit-surface); contain: layout style; container-type: inline-size; }
.tcfit-header { bottom: 100%; height: ${HEADER_HEIGHT}px; border-bottom: 1px solid var(--tcfit-rule); }
.tcfit-transport { top: 100%; flex-wrap: wrap; min-height: ${BAR_HEIGHT}px; padding-block: 3px; border-top: 1px solid var(--tcfit-rule); }
:is(.tcfit-header, .tcfit-transport)[hidden], :is(.tcfit-header, .tcfit-transport) [hidden] { display: none; }
:is(.tcfit-header, .tcfit-transport) > * { flex: none; }
:is(.tcfit-header, .tcfit-transport) > span:empty { display: none; }
:is(.tcfit-header, .tcfit-transport) :is(button, .tcfit-joined) { flex: none; }
:is(.tcfit-header, .tcfit-transport) .tcfit-joined { flex-wrap: nowrap; }
:is(.tcfit-header, .tcfit-transport) button:not([aria-pressed=true], .tcfit-main) { border-color: transparent; background: none; }
:is(.tcfit-header, .tcfit-transport) button { padding: 0 5px; }
:is(.tcfit-header, .tcfit-transport) button > span { display: inline-flex; align-items: center; gap: 5px; }
:is(.tcfit-header, .tcfit-transport) kbd { display: none; }
:is(.tcfit-header, .tcfit-transport) svg { flex: none; width: 17px; height: 17px; }
.tcfit-spring { display: flex; flex: 1 1 0 !important; align-items: center; justify-content: flex-end; gap: 4px; padding-right: 6px; white-space: nowrap; }
.tcfit-spring i { flex: 0 1 110px; min-width: 10px; height: 9px; border-radius: 3px; }
.tcfit-now, .tcfit-frames { display: flex; align-items: center; gap: 6px; font-variant-numeric: tabular-nums; }
.tcfit-now input { box-sizing: content-box; height: 22px; padding: 0 3px; border: 1px solid var(--tcfit-edge); border-radius: 4px;
  background: var(--tcfit-field); color: var(--tcfit-text); font: inherit; text-align: right; }
.tcfit-time { contain: strict; height: 18px; } /* laid out alone, for every frame */
.tcfit-frames { gap: 0; }
.tcfit-frames button { gap: 4px; }
.tcfit-hint { margin-left: 8px; }
.tcfit-header h1 { flex: 0 1 auto; min-width: 40px; margin: 0 4px; overflow: hidden; text-overflow: ellipsis; white-space: nowrap;
  font: 600 15px/1.3 inherit; font-size: 15px; font-weight: 600; color: var(--tcfit-strong); }
.tcfit-status { display: flex; flex: 1 1 0 !important; align-items: center; gap: 12px; min-width: 0; padding: 0 6px; }
.tcfit-message { display: flex; flex: 0 1 auto; align-items: center; gap: 6px; min-width: 0; }
.tcfit-message > span { display: -webkit-box; overflow: hidden; -webkit-box-orient: vertical; -webkit-line-clamp: 2; line-height: 1.25; }
.tcfit-message.tcfit-good { color: var(--tcfit-text); } .tcfit-message.tcfit-warning { color: var(--tcfit-suspicious); }
.tcfit-message .tcfit-track { flex: none; width: 60px; margin: 0; }
.tcfit-others { display: flex; align-items: center; gap: 5px; color: var(--tcfit-dim); }
.tcfit-panel ol { margin: 0 0 8px; padding-left: 20px; }
.tcfit-panel li { margin: 3px 0; }
.tcfit-panel li kbd { margin-left: 0; padding: 1px 5px; border: 1px solid var(--tcfit-edge); border-radius: 4px; white-space: nowrap; }
.tcfit-lost :is(.tcfit-header, .tcfit-transport) { pointer-events: none; opacity: 0.5; }
@container (max-width: 1200px) { .tcfit-hint, svg:has(+ .tcfit-word) { display: none !important; } }
@container (max-width: 1000px) {
  .tcfit-time, .tcfit-frames .tcfit-word:not(.tcfit-kept) { display: none; }
}
@container (max-width: 900px) {
  .tcfit-saved, .tcfit-header .tcfit-word { display: none; }
  .tcfit-header svg:has(+ .tcfit-word) { display: block !important; }
}
@container (max-width: 800px) {
  .tcfit-transport svg:has(+ .tcfit-word) { display: block !important; }
  :is(.tcfit-transport .tcfit-word:not(.tcfit-kept), .tcfit-others > span) { display: none; }
}
`;
