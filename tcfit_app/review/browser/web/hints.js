// What to do first: a card over the picture, until it has been read in this browser.

/** @import { Hints } from "./wire" */

import { element, layer } from "./elements.js";
import { remember } from "./remembered.js";

const READ = "tcfit-hints";
const card = element("section", "tcfit-hints", layer);
card.setAttribute("aria-label", "First steps");
card.hidden = true;

/** @param {Hints} request */
export function showHints({ steps }) {
  card.hidden = false;
  const list = element("ol", "");
  for (const { text, keys } of steps) {
    const step = element("li", "", list, text);
    if (keys) element("kbd", "", step, keys);
  }
  const close = element("button", "", null, "Got it");
  close.type = "button";
  close.addEventListener("click", () => {
    remember(READ, "read");
    card.hidden = true;
  });
  card.replaceChildren(element("h2", "", null, "First steps"), list, close);
}
