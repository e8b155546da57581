// Where the list of clips leaves its order for the pages of its clips.

/** The key in the browser's storage: names in addresses, with blanks between them. */
export const ORDER = "tcfit-order";
