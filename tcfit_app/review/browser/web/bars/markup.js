// HTML that the server makes for what stands around the picture: all of the header above it, and most of the bar. It is
// put into place part by part, so that what has not changed stays as it is: with its focus, and with what the page
// itself has drawn into it.

import { watch } from "../connection.js";
import { header } from "../elements.js";

/** @type {WeakMap<Element, string>} */
const sources = new WeakMap();

/** @param {HTMLElement} box @param {string} html its parts, as many each time */
export function place(box, html) {
  // As viser does with the HTML of panels; the server escapes all text in it.
  const parts = [...new DOMParser().parseFromString(html, "text/html").body.children];
  parts.forEach((part, index) => {
    const source = part.outerHTML;
    const old = box.children[index];
    if (old && sources.get(old) === source) return;
    if (old) renew(old, part);
    else box.append(part);
    sources.set(box.children[index], source);
  });
}

/** Makes an element like another one. A button in it stays: it may have the focus, or be pressed just now.
 * @param {ChildNode} old @param {ChildNode} wanted */
function renew(old, wanted) {
  const [before, after] = [[...old.childNodes], [...wanted.childNodes]];
  if (old.nodeName !== wanted.nodeName || before.length !== after.length) return old.replaceWith(wanted);
  if (old instanceof Element && wanted instanceof Element) {
    for (const { name } of [...old.attributes]) if (!wanted.hasAttribute(name)) old.removeAttribute(name);
    for (const { name, value } of wanted.attributes)
      if (old.getAttribute(name) !== value) old.setAttribute(name, value);
  } else old.nodeValue = wanted.nodeValue;
  before.forEach((child, index) => renew(child, after[index]));
}

watch("header", (state) => {
  if (state) place(header, state.html);
});
