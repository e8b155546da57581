// What the app says over the picture: a card, and a colour bar.

/** @import { Notice } from "./wire" */

import { states, watch } from "./connection.js";
import { card, element, layer } from "./elements.js";
import { KIND_COLORS } from "./style.js";

const SAVED = "Saved edits are safe.";
/** @type {{ [lost: string]: Notice }} */
const LOST = {
  ended: {
    title: "tcfit has ended or cannot be reached",
    text:
      `${SAVED}\nThe page reconnects by itself. ` +
      "If tcfit has ended, start it again (tcfit review ...) and open the link that it prints.",
    kind: "error",
    progress: null,
  },
  restarted: {
    title: "tcfit was started again",
    text: `${SAVED}\nOpen the link that it printed in this browser. Then this page reconnects too.`,
    kind: "error",
    progress: null,
  },
  silent: {
    title: "tcfit does not answer",
    text:
      `${SAVED}\nEither tcfit is busy, or the connection to it hangs. ` +
      "The page reconnects by itself. Until then, input is ignored. Reloading may help.",
    kind: "error",
    progress: null,
  },
};

function drawCard() {
  const { lost } = states;
  const notice = lost ? LOST[lost === true ? "ended" : lost] : states.notice;
  card.hidden = !notice;
  if (!notice) return;
  card.style.setProperty("--kind", KIND_COLORS[notice.kind]);
  card.setAttribute("role", notice.kind === "error" ? "alert" : "status");
  const parts = [element("h2", "", null, notice.title)];
  if (notice.text) parts.push(element("p", "", null, notice.text));
  if (notice.progress !== null) parts.push(progressTrack(notice.progress));
  card.replaceChildren(...parts);
}

watch("notice", drawCard);
watch("lost", (lost) => {
  layer.classList.toggle("tcfit-lost", Boolean(lost));
  drawCard();
});

/** @param {number} progress 0 to 1 */
function progressTrack(progress) {
  const track = element("div", "tcfit-track");
  element("div", "tcfit-bar", track).style.width = `${100 * progress}%`;
  return track;
}
