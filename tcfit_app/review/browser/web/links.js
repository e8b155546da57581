// Links to a frame, a fit and, of several people, a person: in the query of the page's address, since viser takes what
// comes before the query for the server's.

import { emit, watch } from "./connection.js";

/** A number in the address; undefined if it is not a number. @param {string | null} text */
const whole = (text) => (text !== null && /^-?\d{1,15}$/.test(text) ? Number(text) : undefined);

/** Goes where the address says, once: later the frame on show is another one. */
function follow() {
  const parts = new URLSearchParams(location.search);
  const [frame, run, phase, person] = ["frame", "run", "phase", "person"].map((name) => whole(parts.get(name)));
  if (frame === undefined) return;
  history.replaceState(null, "", location.pathname);
  emit({ type: "open_link", frame, run: run ?? null, phase: phase ?? null, person: person ?? null });
}

/** @param {string} link */
function copy(link) {
  const copied = navigator.clipboard ? navigator.clipboard.writeText(link) : Promise.reject(new Error("no clipboard"));
  // Browsers have no clipboard for pages that come over the network without encryption.
  copied.catch(() => window.prompt("The link to this frame and fit", link));
}

// The first thing that comes once the server has heard of the page.
watch("beat", (beat) => {
  if (beat) follow();
});
watch("linking", (linking) => {
  if (!linking) return;
  const { frame, run, phase, person } = linking;
  const fit = run ? `&run=${run}&phase=${phase}` : "";
  const whose = person ? `&person=${person}` : "";
  copy(`${location.origin}${location.pathname}?frame=${frame}${fit}${whose}`);
});
