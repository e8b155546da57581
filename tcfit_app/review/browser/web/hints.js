// What to do first: a card over the picture, until it has been read in this browser.

import { states, watch } from "./connection.js";
import { element, layer } from "./elements.js";
import { remember } from "./remembered.js";

const READ = "tcfit-hints";
const card = element("section", "tcfit-hints", layer);
card.setAttribute("aria-label", "First steps");
card.hidden = true;

watch("hints", () => {
  card.hidden = !states.hints;
  if (!states.hints) return;
  const list = element("ol", "");
  for (const { text, keys } of states.hints.steps) {
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
});
