import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

import { states } from "./connection.js";
import {
  axis, clockText, edgeX, followCursor, frameAt, frameNumber, frameX, niceStep, showAll, showFrames, shownCount,
  valueScale, valueText, zoomAxis,
} from "./timeline/axis.js";

beforeEach(() => {
  states.timeline = { length: 500, frame_rate: 25, first_frame: 7, choices: [] };
  showAll();
});

const curve = (values, error_bars = []) => ({ label: "A", color: "", values, error_bars });

test("steps are 1, 2 or 5 times a power of ten", () => {
  assert.deepEqual([[4, 4], [7, 4], [9, 4], [0.03, 4], [1300, 4]].map(([extent, count]) =>
    Number(niceStep(extent, count).toPrecision(6))), [1, 2, 5, 0.01, 500]);
});

test("a frame's place leads back to it", () => {
  for (const frame of [0, 17, 499]) assert.equal(frameAt(frameX(frame)), frame);
  assert.equal(frameAt(-1e4), 0);
  assert.equal(frameAt(1e4), 499);
});

test("what is under the pointer stays there while it is zoomed", () => {
  const x = edgeX(200);
  zoomAxis(0.5, x);
  assert.equal(shownCount(), 250);
  assert.ok(Math.abs(edgeX(200) - x) < 1e-6);
});

test("no fewer frames than can be told apart, and none beyond the clip", () => {
  showFrames(495, 1);
  assert.deepEqual(axis, { first: 488, last: 500 });
  showFrames(-50, 1e6);
  assert.deepEqual(axis, { first: 0, last: 500 });
});

test("the page turns only where the cursor has left it", () => {
  showFrames(100, 100);
  followCursor(150);
  assert.equal(axis.first, 100);
  followCursor(200);
  assert.deepEqual(axis, { first: 190, last: 290 });
});

test("an axis of values begins at zero and ends at a round number above its curves and their bars", () => {
  assert.deepEqual(valueScale([curve([1, 3, null, 7])], false), { low: 0, high: 8, step: 2 });
  assert.deepEqual(valueScale([curve([1, 7], [null, 2])], false), { low: 0, high: 10, step: 5 });
  assert.deepEqual(valueScale([curve([-3, 2])], true), { low: -4, high: 2, step: 2 });
  assert.equal(valueScale([curve([null])], false), null);
});

test("values beyond what is on show do not count", () => {
  showFrames(0, 12);
  assert.equal(valueScale([curve([...Array(20).fill(1), 1e6])], false)?.high, 1);
});

test("numbers and times are as users read them", () => {
  assert.equal(frameNumber(3), "10");
  assert.deepEqual([0, 105, 1500 * 25].map(clockText), ["0:00.00", "0:04.20", "25:00.00"]);
  assert.deepEqual([valueText(1.25, 0.5), valueText(12, 5), valueText(2e5, 1e5)], ["1.3", "12", "2.0e+5"]);
});
