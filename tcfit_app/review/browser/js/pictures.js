// Pictures of the video, decoded beside the page's own work and hung into viser's image nodes.
//
// viser hands the bytes to an <img>, and so to a later frame than the body's: the picture is decoded as it goes to the
// graphics card, after frames that show the new body on the old picture.

const textures = new Map(); // by name of a node: ours
const yielded = new Map(); // by name of a node: its texture when viser was given a picture, which it then replaces

const isPicture = ({ type, updates }) => type === "SceneNodeUpdateMessage" && updates._data instanceof Uint8Array;

/** The mesh of an image node, if it is there. */
function imageMesh(name) {
  let mesh = null;
  viewer().nodeRefFromName[name]?.traverse((child) => (mesh ??= child.isMesh ? child : null));
  return mesh;
}

/** viser shows the next picture of a node itself. */
const leaveToViser = (name) => yielded.set(name, imageMesh(name)?.material.map);

/** The bytes as rows from the bottom up, as the graphics card wants them; null if they are no picture. */
const decoded = ({ updates }) =>
  createImageBitmap(new Blob([updates._data]), { imageOrientation: "flipY" }).catch(() => null);

/** Shows a picture in a node; false if viser must do it, for it has one of its own still to come there. */
function hang(name, bitmap) {
  const material = imageMesh(name)?.material;
  if (bitmap && material?.map && material.map !== yielded.get(name)) {
    material.map = textureOf(name, bitmap, material.map);
    return true;
  }
  bitmap?.close();
  leaveToViser(name);
  return false;
}

/** A node's own texture with that picture in it, made like another one. */
function textureOf(name, bitmap, model) {
  const last = textures.get(name);
  const generateMipmaps = shrinks(bitmap);
  const same = (image) => image.width === bitmap.width && image.height === bitmap.height;
  const fits = last && same(last.image) && last.generateMipmaps === generateMipmaps;
  const texture = fits ? last : new model.constructor();
  last?.image.close();
  if (!fits) {
    last?.dispose();
    const minFilter = generateMipmaps ? texture.minFilter : texture.magFilter;
    Object.assign(texture, { colorSpace: model.colorSpace, flipY: false, generateMipmaps, minFilter });
    textures.set(name, texture);
  }
  texture.image = bitmap;
  texture.needsUpdate = true;
  return texture;
}

/** Whether it is drawn so much smaller that it would shimmer without its smaller copies, which in software cost a tenth
 * of a frame. */
function shrinks({ width, height }) {
  const { canvas } = viewer();
  return states.layout?.mode !== "poster" || width > canvas.width || height > 1.5 * canvas.height;
}
