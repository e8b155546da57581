import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { states } from "./connection.js";
import { divider, inBox, placeInWorld, posterMaps, toImage, toScreen } from "./picture/projection.js";

const poster = (window, kind = "picture") =>
  ({ node: "", window, width: 4 / 3, kind, clipped: false, label: "", color: "" });

beforeEach(() => {
  for (const name of Object.keys(states)) delete states[name];
  states.layout = { mode: "poster", image: [640, 480], posters: [poster([0, 0, 1, 1])], wipe: false };
});

/** @param {number[]} found @param {number[]} expected */
const near = (found, expected) => expected.forEach((value, i) => assert.ok(Math.abs(found[i] - value) < 1e-9, `${found}`));

test("a picture's middle is in the middle of the canvas, and places lead back to pixels", () => {
  const [map] = posterMaps();
  near(toScreen(map, [320, 240]), [500, 300]);
  near(toScreen(map, [0, 0]), [500 - (400 * 4) / 6, 100]);
  near(toImage(map, ...toScreen(map, [123, 45])), [123, 45]);
});

test("pictures beside each other lie in the middle of their windows", () => {
  states.layout.posters = [poster([0, 0, 0.5, 1]), poster([0.5, 0, 1, 1])];
  const [a, b] = posterMaps();
  near(toScreen(a, [320, 240]), [250, 300]);
  near(toScreen(b, [320, 240]), [750, 300]);
  near(placeInWorld(b), [250 / 400, 0]);
});

test("a close-up takes what it follows to the middle", () => {
  states.focus = { x: 100, y: 400 };
  near(toScreen(posterMaps()[0], [100, 400]), [500, 300]);
});

test("a wipe shows A up to the divider and B from there on", () => {
  Object.assign(states.layout, { posters: [poster([0, 0, 1, 1]), poster([0, 0, 1, 1])], wipe: true });
  divider.share = 0.25;
  const [a, b] = posterMaps();
  assert.deepEqual([a.seen.right, b.seen.left], [250, 250]);
  assert.ok(inBox(a.seen, { x: 100, y: 10 }) && !inBox(b.seen, { x: 100, y: 10 }));
});

test("in 3D pixels are those of the canvas", () => {
  states.layout = { mode: "space", image: [0, 0], posters: [], wipe: false };
  near(toImage(posterMaps()[0], 12, 34), [12, 34]);
});
