// The beginning: it starts the script's parts if viser's page is one that they know, and else says what is missing.

import { KNOWN_VERSION, canSend, missingParts, sendText } from "./viser/bridge.js";

const missing = missingParts();
const calls = missing.length ? strangerCalls() : (await import("./page.js")).calls;
const { calls: waiting = [], ...about } = window.tcfit;
window.tcfit = { ...about, ...calls };
for (const [name, values] of waiting) window.tcfit[name](...values);

/** In the page of another viser: says so in the page, in its console and to the server, and does nothing else. */
function strangerCalls() {
  const { viser, complain } = window.tcfit;
  complain(`tcfit needs viser ${KNOWN_VERSION}, found ${viser}, whose page lacks: ${missing.join(", ")}. Reinstall tcfit.`);
  /** @param {string} field */
  const tell = (field) => {
    if (canSend()) sendText(field, JSON.stringify({ number: 1, event: { type: "stranger", viser, missing } }));
  };
  const ignore = () => null;
  const others = { receive: ignore, perform: ignore, dress: ignore, setColorTable: ignore, placeOfFit: ignore };
  return { ...others, connect: tell, state: ignore, place: ignore };
}
