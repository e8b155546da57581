// Light and dark, as the system has it: colours of what stands beside the picture. What lies on it is dark always.

const DARK = {
  surface: "#14171c", bed: "#1b1f26", grid: "#222730", line: "#2a2f38", thumb: "#56616f",
  "whole-thumb": "#2b323c", hair: "rgba(255, 255, 255, 0.35)",
  text: "#cfd6df", dim: "#a3adba", strong: "#ffffff", key: "#b3becb", off: "#8a94a3", cursor: "#f4f7fb",
  "on-cursor": "#10131a", selected: "#ffe14d", bad: "#ff5a52", edited: "#35d6ee", flagged: "#ffb02e",
  checked: "#55c26a", note: "#f2a7c3", good: "#51cf66", wrong: "#ff8787", detected: "#9fc6ea",
  worst: "#ff5a52", worse: "#ff9f43", doubtful: "#e6cf6a",
  button: "#2c3037", edge: "#3d434c", raised: "#3a404a", "raised-edge": "#59616d", sunk: "#23272d", rule: "#33383f",
  pointed: "#2a2f38", here: "#1f3f5c", field: "#1b1f26", menu: "#1d2128",
  danger: "#ff9d97", "danger-edge": "#7d3a38", "danger-ground": "#5e2826",
};

/** @type {typeof DARK} */
const LIGHT = {
  surface: "#f4f6f8", bed: "#e4e8ed", grid: "#dde2e8", line: "#d3d9e0", thumb: "#98a2ae",
  "whole-thumb": "#c9d0d8", hair: "rgba(0, 0, 0, 0.4)",
  text: "#22272e", dim: "#525c68", strong: "#000000", key: "#475260", off: "#69727e", cursor: "#14171c",
  "on-cursor": "#ffffff", selected: "#8a6d00", bad: "#c92a2a", edited: "#0b7285", flagged: "#945200",
  checked: "#1f7a34", note: "#a61e5d", good: "#176128", wrong: "#b42323", detected: "#1c5f9e",
  worst: "#c92a2a", worse: "#c75a00", doubtful: "#8f7500",
  button: "#ffffff", edge: "#b4bdc8", raised: "#e9eef4", "raised-edge": "#8f9bab", sunk: "#dce3ea", rule: "#d8dde3",
  pointed: "#e4e9ef", here: "#d3e6f7", field: "#ffffff", menu: "#ffffff",
  danger: "#b42323", "danger-edge": "#d99", "danger-ground": "#fbe3e1",
};

const light = window.matchMedia("(prefers-color-scheme: light)");
// Read once: Chromium fires no change event for a value that was read before the event.
let dark = !light.matches;

/** Those that hold now; for canvases. */
export const tones = { ...(dark ? DARK : LIGHT) };

/** Whether everything beside the picture is dark. */
export const isDark = () => dark;

light.addEventListener("change", ({ matches }) => {
  dark = !matches;
  Object.assign(tones, dark ? DARK : LIGHT);
});

/** Calls back when the system has gone over to the other one. @param {() => void} change */
export const onOtherTheme = (change) => light.addEventListener("change", change);

/** @param {typeof DARK} palette */
const variables = (palette) => Object.entries(palette).map(([name, color]) => `--tcfit-${name}: ${color};`).join(" ");

export const THEME_SHEET = `
:root { ${variables(DARK)} }
@media (prefers-color-scheme: light) { :root { ${variables(LIGHT)} } }
`;

/** A colour that is made for dark ground, as it is drawn on the ground that there is.
 * @param {string} color "#5aa0ff", or in another form, which stays */
export function onGround(color) {
  if (isDark() || !/^#[0-9a-f]{6}$/i.test(color)) return color;
  const parts = [1, 3, 5].map((at) => Math.round(0.78 * parseInt(color.slice(at, at + 2), 16)));
  return `rgb(${parts.join(", ")})`;
}
