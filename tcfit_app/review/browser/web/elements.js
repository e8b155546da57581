// The script's own elements, laid over viser's canvas, and how text and tooltips fit into them.

import { element } from "./element.js";
import { BARS_SHEET, HEADER_HEIGHT, BAR_HEIGHT } from "./bars/sheet.js";
import { PANEL_SHEET, STYLE_SHEET } from "./style.js";
import { THEME_SHEET } from "./theme.js";
import { VISER_SHEET, canvas as sceneCanvas, canvasBox, correctCanvasSize, leaveRoom } from "./viser/bridge.js";

export { element };

/** CSS pixels that a pressed pointer may move before that is a drag. */
export const DRAG_THRESHOLD = 3;

/** Takes the focus from what has it. */
export function leaveField() {
  if (document.activeElement instanceof HTMLElement && document.activeElement !== document.body)
    document.activeElement.blur();
}

element("style", "", document.head, THEME_SHEET + STYLE_SHEET + PANEL_SHEET + BARS_SHEET + VISER_SHEET);
const box = canvasBox();
box.classList.add("tcfit-stage");
export const layer = element("div", "tcfit", box);
export const overlayCanvas = element("canvas", "", layer);
export const card = element("div", "tcfit-card", layer);
export const tooltip = element("div", "tcfit-tooltip", layer);
export const header = element("header", "tcfit-panel tcfit-header", box);
export const bar = element("div", "tcfit-panel tcfit-transport", box);
export const strip = element("div", "tcfit-strip", box);
export const stripCanvas = element("canvas", "", strip);
export const stripFront = element("canvas", "", strip); // over the other: what moves while the clip plays
export const stripTooltip = element("div", "tcfit-tooltip", strip);
for (const hidden of [card, tooltip, header, bar, strip, stripTooltip]) hidden.hidden = true;
overlayCanvas.setAttribute("role", "img");
overlayCanvas.setAttribute("aria-label", "Keypoints and bones over the picture");
sceneCanvas().setAttribute("role", "img");
sceneCanvas().setAttribute("aria-label", "Picture: the video's frame and the bodies");
card.setAttribute("role", "status");
header.setAttribute("aria-label", "Clip");
bar.setAttribute("role", "toolbar");
bar.setAttribute("aria-label", "Playing and view");
strip.setAttribute("role", "region");
strip.setAttribute("aria-label", "Timeline");
for (const hidden of [stripCanvas, stripFront]) hidden.setAttribute("aria-hidden", "true");
correctCanvasSize();

/** Of header and bar, in CSS pixels. */
export const barsHeight = () => HEADER_HEIGHT + (bar.offsetHeight || BAR_HEIGHT);

/** Gives the strip its height: that, header and bar take their room from viser's canvas. While they are hidden, as
 * before their content has come, their room is kept: so the first picture is drawn in the size that it has in the end.
 * @param {number} height CSS pixels @param {boolean} shown */
export function setStripHeight(height, shown) {
  const below = barsHeight() - HEADER_HEIGHT;
  for (const part of [header, bar, strip]) part.hidden = !shown;
  strip.style.height = `${height}px`;
  strip.style.top = `calc(100% + ${below}px)`;
  leaveRoom(height ? HEADER_HEIGHT : 0, height ? height + below : 0);
}

/** Makes a canvas as fine as the screen; its context, in CSS pixels, emptied. @param {HTMLCanvasElement} canvas */
export function cleared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

/** As much of a text as fits. @param {CanvasRenderingContext2D} context @param {string} text @param {number} width */
function shortened(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let length = text.length;
  while (length > 0 && context.measureText(`${text.slice(0, length)}…`).width > width) length -= 1;
  return length ? `${text.slice(0, length)}…` : "";
}

/** As much of a fit's name as fits: of "A   Fit 1 · first pass" the pass, of others the start and the end.
 * @param {CanvasRenderingContext2D} context @param {string} text @param {number} width */
export function shortenedName(context, text, width) {
  /** @param {string} some */
  const fits = (some) => context.measureText(some).width <= width;
  const [, letter = "", name, pass] = /^([AB] {3})?(.*?)(?: · ([^·]*))?$/.exec(text) ?? [];
  if (fits(text)) return text;
  if (pass) return shortened(context, letter + pass, width);
  for (let length = name.length - 1; length > 0; length -= 1) {
    const end = Math.floor(length / 3);
    const some = `${letter}${name.slice(0, length - end)}…${name.slice(name.length - end)}`;
    if (fits(some)) return some;
  }
  return letter.trim();
}

/** Puts a tooltip beside a point of its parent, within it sideways.
 * @param {HTMLElement} tip @param {number} x @param {number} y @param {boolean} above */
export function placeTooltip(tip, x, y, above) {
  tip.hidden = false;
  const room = (tip.parentElement?.clientWidth ?? 0) - tip.offsetWidth - 4;
  const left = Math.max(4, Math.min(room, x + 14));
  const top = above ? y - tip.offsetHeight - 8 : y > tip.offsetHeight + 22 ? y - tip.offsetHeight - 12 : y + 18;
  tip.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
}
