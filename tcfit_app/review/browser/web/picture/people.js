// The names of the clip's other people, above their heads in each picture: a press on one goes to that person.

/** @import { OtherPerson } from "../wire" */
/** @import { PosterMap } from "./projection.js" */

import { emit, invalidate, states, watch } from "../connection.js";
import { element, layer } from "../elements.js";
import { peeking } from "./peeking.js";
import { inBox, toScreen } from "./projection.js";

const ABOVE = 10; // CSS pixels between a head and its name

/** @type {HTMLButtonElement[]} */
let names = [];

/** @param {OtherPerson} person */
function nameOf({ name, number }) {
  const made = element("button", "tcfit-person", layer, name);
  made.type = "button";
  made.title = `Show and correct ${name}`;
  made.addEventListener("click", () => emit({ type: "go_to_person", person: number }));
  return made;
}

/** Puts a name above a head, if that is in the picture's window.
 * @param {HTMLButtonElement} name @param {PosterMap} map @param {readonly [number, number]} at */
function place(name, map, at) {
  const [x, y] = toScreen(map, [at[0], at[1]]);
  name.hidden = peeking.now || !inBox(map.seen, { x, y: Math.max(y, map.seen.top) });
  const top = Math.max(y - ABOVE, map.seen.top + 26); // a head may be cut off
  name.style.transform = `translate(-50%, -100%) translate(${Math.round(x)}px, ${Math.round(top)}px)`;
}

/** Puts them where the heads are. @param {PosterMap[]} maps */
export function placePeople(maps) {
  const people = (states.other_people?.people ?? []).filter(({ at }) => at);
  const pictures = maps.filter(({ poster }) => poster.kind === "picture");
  const wanted = pictures.flatMap((map) => people.map((person) => ({ map, person })));
  const same = wanted.length === names.length && wanted.every(({ person }, i) => names[i].textContent === person.name);
  if (!same) {
    names.forEach((name) => name.remove());
    names = wanted.map(({ person }) => nameOf(person));
  }
  wanted.forEach(({ map, person }, i) => {
    if (person.at) place(names[i], map, person.at);
  });
}

watch("other_people", () => invalidate("overlay"));
