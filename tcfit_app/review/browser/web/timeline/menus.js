// The menus of the timeline: of the selected frames, and elsewhere; by right click, or by a button in the bar.

/** @import { MenuItem } from "../menu.js" */

import { chip, clearRange } from "../bars/bar.js";
import { emitLast, invalidate, states } from "../connection.js";
import { strip, stripCanvas } from "../elements.js";
import { onRightClick, openMenu, openMenuAt } from "../menu.js";
import { GUTTER, clipLength, frameAt, frameNumber, showFrames, shownCount } from "./axis.js";
import { chosenRange, cursorFrame, pointed } from "./pointed.js";

const AROUND = 0.1; // of the selected frames that are zoomed to, on either side

/** @param {number} frame */
const selected = (frame) => {
  const range = chosenRange();
  return range !== null && range.first <= frame && frame <= range.last;
};

/** What the server offers, and what the page can do by itself. @param {boolean} ofSelected
 * @returns {(MenuItem | null)[]} */
function items(ofSelected) {
  const groups = (ofSelected ? states.menus?.frames : states.menus?.timeline) ?? [];
  const range = chosenRange();
  /** @type {(MenuItem | null)[]} */
  const own = [{ label: "Show the whole clip", obstacle: zoomed() ? "" : "It is shown already.", run: showWhole }];
  if (range) {
    const name = `${frameNumber(range.first)}–${frameNumber(range.last)}`;
    own.unshift({ label: `Zoom to frames ${name}`, run: () => zoomTo(range.first, range.last) });
    own.push({ label: "Clear frame selection", run: clearRange });
  }
  return [...groups.flatMap((group) => [...group, null]), ...own];
}

const zoomed = () => shownCount() < clipLength();
const showWhole = () => showFrames(0, clipLength());

/** @param {number} first @param {number} last */
function zoomTo(first, last) {
  const margin = Math.max(AROUND * (last + 1 - first), 1);
  showFrames(first - margin, last + 1 - first + 2 * margin);
}

/** @param {MouseEvent} event */
function rightClick(event) {
  const x = event.clientX - stripCanvas.getBoundingClientRect().left;
  if (!states.timeline || x < GUTTER) return;
  const frame = frameAt(x);
  const ofSelected = selected(frame);
  // What the menu says is done to what is on show: to the frame under the pointer, or to the frames around it.
  if (!ofSelected || !selected(cursorFrame() ?? -1)) emitLast({ type: "seek", frame });
  pointed.clicked = { x, y: event.clientY - strip.getBoundingClientRect().top }; // the menu says more
  invalidate("cursor");
  openMenu("Frames", items(ofSelected), event.clientX, event.clientY);
}

function openMore() {
  const range = chosenRange();
  if (range && !selected(cursorFrame() ?? -1)) emitLast({ type: "seek", frame: range.first });
  openMenuAt("Frames", items(range !== null), chip);
}

onRightClick(({ target }) => target === stripCanvas, rightClick);
chip.addEventListener("click", openMore);
