// Links to a frame, a fit and, of several people, a person: in the query of the page's address, since viser takes what
// comes before the query for the server's. And the way to other clips, in the order of this browser's list.

/** @import { CopyLink, Leave } from "./wire" */

import { emit, watch } from "./connection.js";
import { ORDER } from "./remembered.js";

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

/** Copies a link to what is on show. @param {CopyLink} request */
export function copyLink({ frame, run, phase, person }) {
  const fit = run ? `&run=${run}&phase=${phase}` : "";
  const whose = person ? `&person=${person}` : "";
  copy(`${location.origin}${location.pathname}?frame=${frame}${fit}${whose}`);
}

/** The clips' names in addresses, as the list had them last; of this tab, or else of the browser. */
function order() {
  const kept = sessionStorage.getItem(ORDER) ?? localStorage.getItem(ORDER);
  return kept ? kept.split(" ") : [];
}

/** Goes to another clip of the list, or to the list: also from the last clip, and without an order.
 * @param {Leave} request */
export function leave({ to }) {
  const here = location.pathname.split("/").at(-1) ?? "";
  const clips = order();
  const place = clips.indexOf(here);
  const step = { list: 0, next: 1, previous: -1 }[to];
  const there = step && place >= 0 ? clips[place + step] : undefined;
  location.assign(there ? `/clip/${there}` : `/#${here}`);
}
