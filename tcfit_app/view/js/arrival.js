// States that come without anything for viser's scene are taken at once, and viser's scene is not drawn again for them:
// each message would have viser draw for a quarter of a second, which in software takes a whole processor core.

const usualRequest = viewer().requestRender;

const leavesScene = ({ type, source }) =>
  type === "GuiUpdateMessage" || (type === "RunJavascriptMessage" && source.startsWith("tcfit.receive("));

/** In viser's place, which asks for a frame when messages have come. Its own messages keep their order among ours. */
function requestRender() {
  const { messageQueue, drainMessageQueue, getRenderRequestState } = viewer();
  const ready = drainMessageQueue && getRenderRequestState === "ready";
  if (ready && messageQueue.length && messageQueue.every(leavesScene)) drainMessageQueue();
  else usualRequest();
}

viewer().requestRender = requestRender;
ending.signal.addEventListener("abort", () => {
  if (viewer().requestRender === requestRender) viewer().requestRender = usualRequest;
});
