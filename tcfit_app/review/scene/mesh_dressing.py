"""What viser's meshes cannot do, by a script in the page: colours at vertices, clean transparency, dark plates."""

import base64
import json

import numpy as np
import viser
from jaxtyping import UInt8

from tcfit_app.review.scene.layers import color_table
from tcfit_app.server.viser_bridge import run_javascript


class MeshDressing:
    """Dresses the mesh nodes of one browser tab. A node may have been added just before.

    Colours: viser's own way to colours at vertices is a GLB file, built and parsed anew for each frame; this adds an
    attribute to the mesh that is there, with one byte for each vertex on the wire.

    Transparency: a browser blends a mesh's triangles in the order in which they are listed, so that the back of an arm
    may shine through its front. Drawn into the depth buffer first, the mesh lets only its nearest surface through.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        run_javascript(client, _SCRIPT.replace("TABLE", json.dumps(_linear_table())))

    def paint(self, name: str, indices: UInt8[np.ndarray, "V"] | None) -> None:
        """Gives the node's mesh colours, lines of `layers.color_table` by vertex; None takes them away.

        The mesh's own colour multiplies them: make it white.
        """
        colors = None if indices is None else base64.b64encode(indices.tobytes()).decode()
        self._dress(name, colors=colors)

    def show_front_only(self, name: str, front: bool) -> None:
        """Whether the node's mesh hides its own far side although it is transparent, or a wireframe."""
        self._dress(name, front=front)

    def keep_dark(self, name: str) -> None:
        """Draws an image node dark, and not white, until the browser has decoded its first image."""
        self._dress(name, dark=True)

    def _dress(self, name: str, **wish: object) -> None:
        run_javascript(self._client, f"window.tcfitDress({json.dumps(name)}, {json.dumps(wish)});")


def _linear_table() -> list[float]:
    """The colour table as three.js wants colours at vertices: linear, 0 to 1, flattened."""
    srgb = color_table().astype(np.float64) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return linear.round(4).ravel().tolist()


# The material is looked at before each drawing, because viser makes a new one when opacity or wireframe change. A mesh
# that is not there yet is waited for.
_SCRIPT = """
window.tcfitDress ??= (() => {
  const table = TABLE, wishes = {};
  const viser = () => window.__viserMutable;
  const find = (name) => {
    let found = null;
    viser().nodeRefFromName[name]?.traverse((child) => { found ??= child.isMesh ? child : null; });
    return found;
  };
  const paint = (mesh, wish) => {
    const old = mesh.userData.tcfitColors, indices = wish.colors && atob(wish.colors);
    mesh.userData.tcfitColors = null;
    if (!indices) return;
    const colors = old?.length === 3 * indices.length ? old : new Float32Array(3 * indices.length);
    for (let i = 0; i < indices.length; i++)
      for (let k = 0; k < 3; k++) colors[3 * i + k] = table[3 * indices.charCodeAt(i) + k];
    const { attributes } = mesh.geometry;
    if (attributes.color?.array === colors) attributes.color.needsUpdate = true;
    else mesh.geometry.setAttribute("color", new attributes.position.constructor(colors, 3));
    mesh.userData.tcfitColors = colors;
  };
  // Of the 130 to 150 ms that a frame takes in software, light that nobody sees took 20 to 35.
  const unlit = (shader) => { shader.fragmentShader = "void main() { gl_FragColor = vec4(0.0); }"; };
  const cover = (mesh, wish) => {
    let depth = mesh.userData.tcfitDepth;
    if (!depth && wish.front) {
      depth = new mesh.constructor(mesh.geometry, mesh.material.clone());
      Object.assign(depth.material, { colorWrite: false, transparent: true, wireframe: false, vertexColors: false });
      depth.material.onBeforeCompile = unlit;
      depth.raycast = () => {};
      depth.renderOrder = 1;
      mesh.renderOrder = 2;
      mesh.parent.add(depth);
      mesh.userData.tcfitDepth = depth;
    }
    if (depth) depth.visible = !!wish.front;
  };
  const prepare = (mesh) => {
    const { geometry, material } = mesh;
    if (mesh.userData.tcfitDark) material.color.setScalar(material.map ? 1 : 0.02);
    const on = mesh.userData.tcfitColors?.length === geometry.attributes.position.array.length;
    if (material.vertexColors !== on) { material.vertexColors = on; material.needsUpdate = true; }
  };
  const darken = (mesh, wish) => { mesh.userData.tcfitDark = wish.dark; };
  const parts = { colors: paint, front: cover, dark: darken };
  const dress = (name, wish, tries) => {
    const mesh = find(name);
    if (mesh) {
      mesh.onBeforeRender = () => prepare(mesh);
      for (const part in wish) if (wishes[name][part] === wish[part]) parts[part](mesh, wish);
      viser().requestRender();
    } else if (tries) setTimeout(() => dress(name, wish, tries - 1), 5);
  };
  return (name, wish) => {
    wishes[name] = { ...wishes[name], ...wish };
    dress(name, wish, 1000);
  };
})();
"""
