// In place of viser: a camera that looks straight at the posters' plane, with 400 CSS pixels for an image's height.

const SCALE = 400;
export const canvasSize = () => ({ width: 1000, height: 600 });
export const worldToCanvas = () => ({ equals: () => true });
/** @param {unknown} _ @param {number[]} point */
export const canvasPoint = (_, [x, y]) => [500 + SCALE * x, 300 + SCALE * y];
