// What the app says over the picture: a card.

/** @import { Notice } from "./wire" */

import { states, watch } from "./connection.js";
import { card, element } from "./elements.js";

const SAVED = "Saved edits are safe.";
/** @type {{ [lost: string]: Notice }} */
const LOST = {
  ended: {
    title: "tcfit has ended or cannot be reached",
    text:
      `${SAVED}\nThe page reconnects by itself. ` +
      "If tcfit has ended, start it again (tcfit review ...) and open the link that it prints.",
  },
  restarted: {
    title: "tcfit was started again",
    text: `${SAVED}\nOpen the link that it printed in this browser. Then this page reconnects too.`,
  },
  silent: {
    title: "tcfit does not answer",
    text:
      `${SAVED}\nEither tcfit is busy, or the connection to it hangs. ` +
      "The page reconnects by itself. Until then, input is ignored. Reloading may help.",
  },
};

function drawCard() {
  const { lost } = states;
  const notice = lost ? LOST[lost === true ? "ended" : lost] : states.notice;
  card.hidden = !notice;
  if (!notice) return;
  card.style.borderTopColor = `var(--tcfit-${lost ? "bad" : "accent"})`;
  card.setAttribute("role", lost ? "alert" : "status");
  card.replaceChildren(element("h2", "", null, notice.title), element("p", "", null, notice.text));
}

watch("notice", drawCard);
watch("lost", (lost) => {
  document.documentElement.classList.toggle("tcfit-lost", Boolean(lost));
  drawCard();
});
