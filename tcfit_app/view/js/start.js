// What the server can call.

window.tcfit = {
  version: VERSION,
  connect,
  receive,
  dispose() {
    ending.abort();
    if (frameRequest) cancelAnimationFrame(frameRequest);
  },
};
