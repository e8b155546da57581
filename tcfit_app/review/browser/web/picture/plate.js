// Where points of camera space lie on the side view's plate.

/** @import { SidePlate } from "../wire" */

/** @param {readonly number[]} a @param {readonly number[]} b */
export const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);

/** In its pixels. @param {SidePlate} side @param {number} body @param {readonly number[]} point in metres
 * @returns {[u: number, v: number]} */
export function onPlate({ plate, shifts }, body, point) {
  const [across, down] = plate;
  return [dot(across, point) + shifts[body][0], dot(down, point) + shifts[body][1]];
}
