// The script's own elements, laid over viser's canvas, and its end when a newer script takes over.

const viewer = () => window.__viserMutable;
const ending = new AbortController(); // ends listeners and observers
const listening = { signal: ending.signal };
const capturing = { signal: ending.signal, capture: true };

/** An element with a class, and text if there is some: always as text, so that nothing in it is ever HTML. */
function element(tag, className, parent, text) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  if (parent) parent.append(made);
  return made;
}

/** viser's box around its canvas: a stacking context, so what is put into it stays below panels and messages. */
function canvasBox(canvas) {
  for (let box = canvas.parentElement; box; box = box.parentElement) if (box.style.zIndex === "0") return box;
  return canvas.parentElement;
}

const box = canvasBox(viewer().canvas);
const sheet = element("style", "", document.head, STYLE_SHEET);
const layer = element("div", "tcfit", box);
const overlayCanvas = element("canvas", "", layer);
const chipsBox = element("div", "tcfit-chips", layer);
const card = element("div", "tcfit-card", layer);
const legendBox = element("div", "tcfit-legend", layer);
const tooltip = element("div", "tcfit-tooltip", layer);
const strip = element("div", "tcfit-strip", box);
const stripCanvas = element("canvas", "", strip);
const stripToggle = element("button", "", strip);
const stripTooltip = element("div", "tcfit-tooltip", strip);
for (const hidden of [card, legendBox, tooltip, strip, stripTooltip]) hidden.hidden = true;
card.setAttribute("role", "status");
stripToggle.type = "button";

/** Gives the strip its height, taken from viser's canvas. */
function setStripHeight(height) {
  strip.hidden = height === 0;
  strip.style.height = `${height}px`;
  box.style.height = height ? `calc(100% - ${height}px)` : "100%";
}

// While a docked panel is resized viser sets its canvas's size by itself, from the room that it knows of.
const syncCanvasSize = viewer().syncCanvasSize;
if (syncCanvasSize)
  viewer().syncCanvasSize = (width, height) => syncCanvasSize(width, height - (strip.hidden ? 0 : strip.offsetHeight));

ending.signal.addEventListener("abort", () => {
  for (const mine of [sheet, layer, strip]) mine.remove();
  box.style.height = "100%";
  viewer().syncCanvasSize = syncCanvasSize;
});

/** Makes a canvas as fine as the screen; its context, in CSS pixels, emptied. */
function cleared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

/** As much of a text as fits. */
function shortened(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let length = text.length;
  while (length > 0 && context.measureText(`${text.slice(0, length)}…`).width > width) length -= 1;
  return length ? `${text.slice(0, length)}…` : "";
}

/** As much of a run's name as fits, of its start and its end, and the whole of its phase: "Run wi…ted · temporal". */
function shortenedName(context, text, width) {
  const fits = (some) => context.measureText(some).width <= width;
  if (fits(text)) return text;
  const cut = text.lastIndexOf(" · ");
  const [name, phase] = cut < 0 ? [text, ""] : [text.slice(0, cut), text.slice(cut)];
  for (let length = name.length - 1; length > 0; length -= 1) {
    const end = Math.floor(length / 3);
    const some = `${name.slice(0, length - end)}…${name.slice(name.length - end)}${phase}`;
    if (fits(some)) return some;
  }
  return shortened(context, text, width);
}

/** Puts a tooltip beside a point of its parent, within it sideways. */
function place(tip, x, y, above) {
  tip.hidden = false;
  const room = tip.parentElement.clientWidth - tip.offsetWidth - 4;
  const left = Math.max(4, Math.min(room, x + 14));
  const top = above ? y - tip.offsetHeight - 8 : y > tip.offsetHeight + 22 ? y - tip.offsetHeight - 12 : y + 18;
  tip.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
}
