// Light and dark, as the system has it or the user has chosen: the colours of everything but the video and the marks on
// it, which have those of the dark theme always.

/** @import { Meaning } from "./wire" */

import { COLORS as PAIRS } from "./colors.js";
import { remember, remembered } from "./remembered.js";

/** @param {0 | 1} theme @returns {{ [meaning in Meaning]: string }} */
const meanings = (theme) =>
  /** @type {any} */ (Object.fromEntries(Object.entries(PAIRS).map(([name, pair]) => [name, pair[theme]])));

/** Over the video. */
export const COLORS = meanings(0);

const DARK = {
  ...COLORS,
  surface: "#14171c", stage: "#101318", bed: "#1b1f26", grid: "#222730", line: "#2a2f38", thumb: "#56616f",
  "whole-thumb": "#2b323c", hair: "rgba(255, 255, 255, 0.35)",
  text: "#cfd6df", dim: "#a3adba", key: "#b3becb", off: "#8a94a3", "on-accent": "#0d1a2d", soft: "#1b273b",
  button: "#2c3037", edge: "#3d434c", raised: "#3a404a", "raised-edge": "#59616d", sunk: "#23272d", rule: "#33383f",
  pointed: "#2a2f38", field: "#1b1f26", menu: "#1d2128",
};

/** @type {typeof DARK} */
const LIGHT = {
  ...meanings(1),
  surface: "#f4f6f8", stage: "#eceff3", bed: "#e4e8ed", grid: "#dde2e8", line: "#d3d9e0", thumb: "#98a2ae",
  "whole-thumb": "#c9d0d8", hair: "rgba(0, 0, 0, 0.4)",
  text: "#22272e", dim: "#525c68", key: "#475260", off: "#69727e", "on-accent": "#ffffff", soft: "#e5eefb",
  button: "#ffffff", edge: "#b4bdc8", raised: "#e9eef4", "raised-edge": "#8f9bab", sunk: "#dce3ea", rule: "#d8dde3",
  pointed: "#e4e9ef", field: "#ffffff", menu: "#ffffff",
};

const light = window.matchMedia("(prefers-color-scheme: light)");
// Read once: Chromium fires no change event for a value that was read before the event.
let system = light.matches ? "light" : "dark";
const CHOSEN = "tcfit-theme";
const isChosenDark = () => (remembered(CHOSEN) || system) === "dark";
let dark = isChosenDark();
document.documentElement.classList.toggle("tcfit-light", !dark);

/** Those that hold now; for canvases. */
export const tones = { ...(dark ? DARK : LIGHT) };

/** Whether everything beside the picture is dark. */
export const isDark = () => dark;

/** @type {(() => void)[]} */
const changes = [];

/** Calls back when it has become the other one. @param {() => void} change */
export const onOtherTheme = (change) => void changes.push(change);

function follow() {
  if (dark === isChosenDark()) return;
  dark = !dark;
  document.documentElement.classList.toggle("tcfit-light", !dark);
  Object.assign(tones, dark ? DARK : LIGHT);
  for (const change of changes) change();
}

light.addEventListener("change", ({ matches }) => {
  system = matches ? "light" : "dark";
  follow();
});

/** Goes over to the other one, for good unless that is the system's. */
export function switchTheme() {
  const other = dark ? "light" : "dark";
  remember(CHOSEN, other === system ? "" : other);
  follow();
}

/** @param {typeof DARK} palette */
const variables = (palette) => Object.entries(palette).map(([name, color]) => `--tcfit-${name}: ${color};`).join(" ");

export const THEME_SHEET = `
:root { ${variables(DARK)} }
:root.tcfit-light { ${variables(LIGHT)} }
`;
