// Makes elements, in the review's page and in the list's.

/**
 * An element with a class, and text if there is some: always as text, so that nothing in it is ever HTML. A button
 * submits nothing unless it is made to.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {string} className
 * @param {Element | null} [parent]
 * @param {string} [text]
 * @returns {HTMLElementTagNameMap[T]}
 */
export function element(tag, className, parent, text) {
  const made = document.createElement(tag);
  if (made instanceof HTMLButtonElement) made.type = "button";
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  if (parent) parent.append(made);
  return made;
}
