// To other clips of the list that was opened, in the order in which this browser's list has them.

import { watch } from "./connection.js";
import { ORDER } from "./order.js";

/** The clips' names in addresses, as the list had them last; of this tab, or else of the browser. */
function order() {
  const kept = sessionStorage.getItem(ORDER) ?? localStorage.getItem(ORDER);
  return kept ? kept.split(" ") : [];
}

watch("leaving", (leaving) => {
  if (!leaving) return;
  const here = location.pathname.split("/").at(-1) ?? "";
  const clips = order();
  const place = clips.indexOf(here);
  const step = { list: 0, next: 1, previous: -1 }[leaving.to];
  const there = step && place >= 0 ? clips[place + step] : undefined;
  // At its end, as without an order, the list is where one can go on.
  location.assign(there ? `/clip/${there}` : `/#${here}`);
});
