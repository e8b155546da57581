// The header above the picture: the clip, what is being done, who is here. The server makes its content.

import { watch } from "../connection.js";
import { header } from "../elements.js";
import { place } from "./markup.js";

watch("header", (state) => {
  if (state) place(header, state.html);
});
