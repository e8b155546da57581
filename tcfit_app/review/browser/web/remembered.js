// What a browser remembers for good: in cookies, which hold for all ports. tcfit may be at another one the next time.

/** Where the list leaves the order of its clips for their pages: names in addresses, with spaces between. */
export const ORDER = "tcfit-order";

/** Set once the first steps have been read. */
export const STEPS = "tcfit-hints";

const YEAR = 31536000; // seconds

/** Nothing if nothing is remembered under this name. @param {string} name */
export const remembered = (name) =>
  document.cookie.split("; ").find((cookie) => cookie.startsWith(`${name}=`))?.slice(name.length + 1);

/** @param {string} name @param {string} value */
export function remember(name, value) {
  document.cookie = `${name}=${value}; path=/; max-age=${YEAR}; samesite=strict`;
}
