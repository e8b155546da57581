// In place of the page's elements: the strip has a width, and nothing is drawn.

export const strip = { clientWidth: 178 + 1000 + 14 };
