// HTML that the server makes for what stands around the picture. It is put into place part by part, so that what has
// not changed stays as it is: with its focus, and with what the page itself has drawn into it.

/** @type {WeakMap<Element, string>} */
const sources = new WeakMap();

/** @param {HTMLElement} box @param {string} html its parts, as many each time */
export function place(box, html) {
  // As viser does with the HTML of panels; the server escapes all text in it.
  const parts = [...new DOMParser().parseFromString(html, "text/html").body.children];
  parts.forEach((part, index) => {
    const old = box.children[index];
    const source = part.outerHTML;
    if (old && sources.get(old) === source) return;
    const focused = old?.contains(document.activeElement) ? document.activeElement : null;
    if (old) old.replaceWith(part);
    else box.append(part);
    sources.set(part, source);
    if (focused instanceof HTMLElement) alike(part, focused)?.focus({ preventScroll: true });
  });
}

/** The button that does the same. @param {Element} part @param {HTMLElement} button */
function alike(part, { dataset }) {
  const buttons = [...part.querySelectorAll("button")];
  return buttons.find((each) => each.dataset.tcfit === dataset.tcfit && each.dataset.value === dataset.value);
}
