// What the server can call.

window.tcfit = {
  version: VERSION,
  connect,
  receive,
  /** What the server sent last under a name. */
  state: (name) => states[name] ?? null,
  /** Where a pixel of a poster's image is in the window, in CSS pixels; null without such a poster. */
  place(x, y, poster = 0) {
    const map = posterMaps()[poster];
    if (!map) return null;
    const { left, top } = viewer().canvas.getBoundingClientRect();
    const [right, down] = toScreen(map, [x, y]);
    return [left + right, top + down];
  },
  dispose() {
    ending.abort();
    if (frameRequest) cancelAnimationFrame(frameRequest);
  },
};
