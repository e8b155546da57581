import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { states } from "./connection.js";
import { sideMiddle } from "./picture/following.js";

const poster = { node: "", window: [0, 0, 1, 1], width: 2, kind: "side", clipped: true, label: "", color: "" };
const window = { left: 0, top: 0, right: 100, bottom: 100 };
const body = (followed) => ({ color: "", points: [[0, 1, 5], [0, 0, 2]], error_bars: [], followed });

beforeEach(() => {
  states.layout = { mode: "poster", image: [640, 480], posters: [poster], wipe: false };
  states.keypoints = { frame: 0, xy: [[320, 480], [320, 240]], confidence: [1, 1] };
  // A plate seen from the side: depth runs to the right, 100 pixels a metre.
  states.side = { plate: [[0, 0, 100], [0, 100, 0]], shifts: [[0, 240], [0, 240]] };
});

test("without a close-up, what is around the picture's middle counts", () => {
  states.bodies = { bodies: [body(null)] };
  const { x, y } = sideMiddle(poster, window, { x: 0, y: 0, scale: 800 });
  assert.ok(Math.abs(x - (200 / 480 - 1)) < 0.01 && Math.abs(y) < 0.01, `${x} ${y}`);
});

test("of a close-up, only what it follows counts: the middle between the fits", () => {
  states.bodies = { bodies: [body([0, 0.9, 6]), body([0, 0.7, 4])] };
  const { x, y } = sideMiddle(poster, window, { x: 0, y: 0.1, scale: 800 });
  assert.ok(Math.abs(x - (500 / 480 - 1)) < 1e-9 && Math.abs(y - 80 / 480) < 1e-9, `${x} ${y}`);
});
