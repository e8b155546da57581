// From image pixels of a poster to CSS pixels of the canvas, by viser's own camera.

/** Product of two 4 x 4 matrices as three.js stores them, by columns. */
function product(a, b) {
  const result = new Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * k + row] * b[4 * column + k];
      result[4 * column + row] = sum;
    }
  return result;
}

/** viser's world is three.js' world, turned so that its upward axis is up. */
function turnOfWorld() {
  const [w, x, y, z] = window.__viserSceneTree.getState()[""]?.wxyz ?? [1, 0, 0, 0];
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0],
    [0, 0, 0, 1],
  ].flat();
}

/** From a point of viser's world to CSS pixels. */
function screenProjection() {
  const { camera } = viewer();
  const matrix = product(
    product(camera.projectionMatrix.elements, camera.matrixWorldInverse.elements),
    turnOfWorld(),
  );
  const { width, height } = canvasSize();
  return (x, y, z) => {
    const at = (row) => matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row];
    return [((at(0) / at(3) + 1) / 2) * width, ((1 - at(1) / at(3)) / 2) * height];
  };
}

/** For each poster the affine map (it faces the camera) from its image's pixels to CSS pixels. */
function posterMaps() {
  const layout = states.layout;
  if (layout?.mode !== "poster" || !viewer()?.camera) return [];
  const [width, height] = layout.image;
  const screen = screenProjection();
  return layout.posters.map((poster) => {
    const corner = (u, v) => screen((u - width / 2) / height + poster.x, (v - height / 2) / height, 0);
    const [ox, oy] = corner(0, 0);
    const [rx, ry] = corner(width, 0);
    const [bx, by] = corner(0, height);
    const [ux, uy, vx, vy] = [(rx - ox) / width, (ry - oy) / width, (bx - ox) / height, (by - oy) / height];
    return { ox, oy, ux, uy, vx, vy, height: by - oy, poster };
  });
}

const toScreen = (map, [x, y]) => [map.ox + map.ux * x + map.vx * y, map.oy + map.uy * x + map.vy * y];

function toImage(map, x, y) {
  const [dx, dy] = [x - map.ox, y - map.oy];
  const area = map.ux * map.vy - map.uy * map.vx;
  return [(dx * map.vy - dy * map.vx) / area, (dy * map.ux - dx * map.uy) / area];
}

let lastView = [];

/** Whether the camera or the canvas is another than when this was last asked. */
function viewChanged() {
  const { camera } = viewer();
  const { width, height } = canvasSize();
  const view = [...camera.projectionMatrix.elements, ...camera.matrixWorldInverse.elements, width, height];
  const changed = view.some((number, i) => number !== lastView[i]);
  lastView = view;
  return changed;
}
