// Picture, body and keypoints of a frame are drawn together: messages wait until the pictures in them are decoded.
//
// viser itself takes messages in the next frame that it draws, which shows the old scene, draws the bodies in another
// one and the picture, decoded by then, in a third, and goes on for a quarter of a second.

/** @import { Message } from "./internals" */

import { viewer } from "./bridge.js";
import { hangPicture, leavePicturesToViser } from "./meshes.js";

/** @type {Message[] | null} */
let decoding = null; // messages whose pictures are being decoded
/** @type {Message[]} */
const behind = []; // those that came meanwhile

const usualRequest = viewer().requestRender;

/** @param {Message} message */
const isPicture = ({ type, updates }) => type === "SceneNodeUpdateMessage" && updates._data instanceof Uint8Array;

/** Panels and their like: viser itself takes them at once. @param {Message} message */
const isGui = ({ type }) => /^(Set)?Gui(?!3D)|Notification/.test(type);

/** They touch nothing in viser's scene: it is not drawn again for them. @param {Message} message */
const leavesScene = (message) =>
  isGui(message) || (message.type === "RunJavascriptMessage" && /^tcfit\.(receive|perform)\(/.test(message.source));

const CHANGES = new Set(["SceneNodeUpdateMessage", "SetPositionMessage", "SetSceneNodeVisibilityMessage"]);

/** They change what is in the scene, at once. @param {Message} message */
const changesScene = (message) => CHANGES.has(message.type) || leavesScene(message);

/** In viser's place, which asks for a frame when messages have come. Those for panels overtake those that wait for
 * pictures; among themselves both keep their order. */
function requestRender() {
  const { messageQueue } = viewer();
  if (document.hidden) leavePicturesToViser(); // viser took the messages without asking
  if (messageQueue.length && (decoding || messageQueue.some(isPicture))) {
    const waiting = messageQueue.filter((message) => !isGui(message));
    messageQueue.splice(0, messageQueue.length, ...messageQueue.filter(isGui));
    if (decoding) behind.push(...waiting);
    else decode(waiting);
    if (!messageQueue.length) return;
  }
  apply();
}

/** Takes messages when their pictures are there; of several for one node only the last one is looked at.
 * @param {Message[]} messages */
async function decode(messages) {
  decoding = messages;
  const newest = new Map(messages.filter(isPicture).map((message) => [message.name, message.updates._data]));
  const bitmaps = await Promise.all([...newest.values()].map(decoded));
  if (decoding !== messages) return bitmaps.forEach((bitmap) => bitmap?.close()); // they were given back meanwhile
  decoding = null;
  // A node that comes with its picture, as after a new connection, is not there yet, or an older one is.
  const added = new Set(messages.filter(({ type }) => type === "ImageMessage").map(({ name }) => name));
  const hung = new Set([...newest.keys()].filter((name, i) => hangPicture(name, added.has(name) ? null : bitmaps[i])));
  /** @param {Message} message */
  const done = (message) => isPicture(message) && hung.has(message.name);
  viewer().messageQueue.push(...messages.map((message) => (done(message) ? withoutPicture(message) : message)));
  apply();
  if (!behind.length) return;
  viewer().messageQueue.push(...behind.splice(0));
  requestRender();
}

/** The bytes as rows from the bottom up, as the graphics card wants them; null if they are no picture.
 * @param {BlobPart} bytes */
const decoded = (bytes) => createImageBitmap(new Blob([bytes]), { imageOrientation: "flipY" }).catch(() => null);

/** @param {Message} message */
function withoutPicture(message) {
  const { _data, ...updates } = message.updates;
  return { ...message, updates };
}

/** Takes what has come, now where that is safe, and draws the scene once if that has changed. */
function apply() {
  const { messageQueue, drainMessageQueue, getRenderRequestState, scene } = viewer();
  const ready = drainMessageQueue && getRenderRequestState === "ready";
  if (!ready || !messageQueue.length || !messageQueue.every(changesScene)) return usualRequest();
  if (!messageQueue.every(leavesScene)) scene.__r3f?.root.getState().invalidate();
  drainMessageQueue();
}

/** Back to viser with everything that waits. */
function giveBack() {
  if (decoding) viewer().messageQueue.unshift(...decoding, ...behind.splice(0));
  decoding = null;
}

viewer().requestRender = requestRender;
document.addEventListener("visibilitychange", giveBack);
