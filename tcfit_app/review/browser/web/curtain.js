// Lifts the curtain that the server lays over viser's page: from the canvas when the first picture is there, and from
// the panels when they are.

import { watch } from "./connection.js";

const LOOKING = 50; // milliseconds between two looks for the panels

function lift() {
  if (document.querySelector("[role=tab]")) document.documentElement.classList.add("tcfit-ready");
  else setTimeout(lift, LOOKING);
}

let drawn = false;
watch("layout", (layout) => {
  if (!layout || drawn) return;
  drawn = true;
  document.documentElement.classList.add("tcfit-drawn");
  lift();
});
