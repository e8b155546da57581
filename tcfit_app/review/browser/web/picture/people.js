// The clip's other people in each picture: a name above the head and, where nothing else shows them, their bones.
// Clicking either selects that person.

/** @import { OtherPerson } from "../wire" */
/** @import { PosterMap } from "./projection.js" */

import { emit, invalidate, states, watch } from "../connection.js";
import { element, layer } from "../elements.js";
import { openMenu } from "../menu.js";
import { COLORS } from "../theme.js";
import { canvas } from "../viser/bridge.js";
import { inBox, toImage, toScreen } from "./projection.js";
import { stroke } from "./shapes.js";

const ABOVE = 10; // CSS pixels between a head and its name
const BONES = { color: COLORS.beside, alpha: 0.7, width: 2 };

/** @type {HTMLButtonElement[]} */
let names = [];
/** @type {typeof states.other_people} */
let told; // what the names were made for

const others = () => states.other_people?.people ?? [];

/** @param {OtherPerson} person */
function nameOf({ name, hint, number }) {
  const made = element("button", "tcfit-person", layer, name);
  made.title = hint;
  made.addEventListener("click", () => emit({ type: "go_to_person", person: number }));
  return made;
}

/** Puts a name above a head, if that is in the picture's window.
 * @param {HTMLButtonElement} name @param {PosterMap} map @param {readonly [number, number]} at */
function place(name, map, at) {
  const [x, y] = toScreen(map, [at[0], at[1]]);
  name.hidden = !inBox(map.seen, { x, y: Math.max(y, map.seen.top) });
  const top = Math.max(y - ABOVE, map.seen.top + 26); // a head may be cut off
  name.style.transform = `translate(-50%, -100%) translate(${Math.round(x)}px, ${Math.round(top)}px)`;
}

/** Puts them where the heads are. @param {PosterMap[]} maps */
export function placePeople(maps) {
  const people = others().filter(({ at }) => at);
  const pictures = maps.filter(({ poster }) => poster.kind === "picture");
  const wanted = pictures.flatMap((map) => people.map((person) => ({ map, person })));
  const same = wanted.length === names.length && told === states.other_people;
  if (!same) {
    names.forEach((name) => name.remove());
    names = wanted.map(({ person }) => nameOf(person));
    told = states.other_people;
  }
  wanted.forEach(({ map, person }, i) => {
    if (person.at) place(names[i], map, person.at);
  });
}

/** Draws the bones of those who have some. @param {CanvasRenderingContext2D} context @param {PosterMap} map */
export function drawPeople(context, map) {
  const lines = new Path2D();
  for (const [x0, y0, x1, y1] of others().flatMap(({ bones }) => bones)) {
    lines.moveTo(...toScreen(map, [x0, y0]));
    lines.lineTo(...toScreen(map, [x1, y1]));
  }
  stroke(context, lines, "rgba(8, 10, 14, 0.5)", BONES.width + 1.6, { alpha: BONES.alpha });
  stroke(context, lines, BONES.color, BONES.width, { alpha: BONES.alpha });
}

/** Reports that the user means the person at a place of a picture, if another person's bones are around it; offers to
 * search there if no person was detected. @param {PosterMap} map @param {{ x: number, y: number }} at */
export function selectPersonAt(map, at) {
  const spot = toImage(map, at.x, at.y);
  const person = others().find(({ bones }) =>
    surrounded(bones.flatMap(([x0, y0, x1, y1]) => /** @type {Pixel[]} */ ([[x0, y0], [x1, y1]])), spot));
  const nobody = states.menus?.nobody;
  const { xy = [], confidence = [] } = states.keypoints ?? {};
  if (person) emit({ type: "go_to_person", person: person.number });
  else if (nobody && !surrounded(xy.filter((_, joint) => confidence[joint] > 0), spot)) {
    const { left, top } = canvas().getBoundingClientRect();
    openMenu("Nobody was detected here", [nobody], left + at.x, top + at.y);
  }
}

/** @typedef {readonly [number, number]} Pixel */

/** Whether the rectangle around points contains a pixel. @param {readonly Pixel[]} points @param {Pixel} spot */
function surrounded(points, spot) {
  return spot.every((value, axis) => {
    const values = points.map((point) => point[axis]);
    return Math.min(...values) <= value && value <= Math.max(...values);
  });
}

watch("other_people", () => invalidate("overlay"));
