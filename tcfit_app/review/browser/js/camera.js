// Tells the server when the user moves viser's camera: it then stops fitting the picture into the window.

function cameraGesture(event) {
  if (event.target !== viewer().canvas || !states.layout) return;
  const turning = states.layout.mode === "space" || event.button !== 0 || event.pointerType === "touch";
  if (event.type === "wheel" || turning) emitSoon({ type: "gesture" });
}

window.addEventListener("wheel", cameraGesture, { ...capturing, passive: true });
window.addEventListener("pointerdown", cameraGesture, capturing);
