"""Colours at the vertices of viser's plain meshes, by a script in the page."""

import base64
import json

import numpy as np
import viser
from jaxtyping import UInt8
from viser import _messages

from tcfit_app.view.layers import color_table


class VertexColors:
    """Paints meshes of one browser tab by `layers.color_table`.

    viser's plain meshes have one colour. Its own way to colours at vertices is a GLB file, built and parsed anew for
    each frame; this adds an attribute to the mesh that is there, with one byte for each vertex on the wire.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._run(_SCRIPT)

    def paint(self, name: str, indices: UInt8[np.ndarray, "V"] | None) -> None:
        """Gives the node's mesh colours, lines of the table by vertex; None takes them away.

        The mesh's own colour multiplies them: make it white. The node may have been added just before.
        """
        encoded = None if indices is None else base64.b64encode(indices.tobytes()).decode()
        self._run(f"window.tcfitPaint({json.dumps(name)}, {json.dumps(encoded)});")

    def _run(self, source: str) -> None:
        self._client._websock_connection.queue_message(_messages.RunJavascriptMessage(source=source))


def _linear_table() -> list[float]:
    """The colour table as three.js wants colours at vertices: linear, 0 to 1, flattened."""
    srgb = color_table().astype(np.float64) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return linear.round(4).ravel().tolist()


# The material is checked before each drawing, because viser makes a new one when opacity or wireframe change. A mesh
# that is not there yet is waited for.
_SCRIPT = """
window.tcfitPaint ??= (() => {
  const table = TABLE;
  const three = () => window.__viserMutable;
  const find = (name) => {
    let mesh = null;
    three().nodeRefFromName[name]?.traverse((child) => { if (child.isMesh && !mesh) mesh = child; });
    return mesh;
  };
  const prepare = (mesh) => {
    const wanted = mesh.userData.tcfitColors;
    const { geometry, material } = mesh;
    const on = !!wanted && wanted.length === geometry.attributes.position.array.length;
    if (material.vertexColors !== on) { material.vertexColors = on; material.needsUpdate = true; }
  };
  const put = (mesh, indices) => {
    let colors = mesh.userData.tcfitColors;
    if (!indices) { mesh.userData.tcfitColors = null; three().requestRender(); return; }
    if (colors?.length !== 3 * indices.length) colors = new Float32Array(3 * indices.length);
    for (let i = 0; i < indices.length; i++)
      for (let k = 0; k < 3; k++) colors[3 * i + k] = table[3 * indices.charCodeAt(i) + k];
    mesh.userData.tcfitColors = colors;
    const { attributes } = mesh.geometry;
    if (attributes.color?.array === colors) attributes.color.needsUpdate = true;
    else mesh.geometry.setAttribute("color", new attributes.position.constructor(colors, 3));
    mesh.onBeforeRender = () => prepare(mesh);
    three().requestRender();
  };
  const latest = {};
  return (name, encoded, tries = 200) => {
    const job = latest[name] = {};
    const indices = encoded && atob(encoded);
    const attempt = (left) => {
      if (latest[name] !== job) return;
      const mesh = find(name);
      if (mesh) put(mesh, indices);
      else if (left) setTimeout(() => attempt(left - 1), 20);
    };
    attempt(tries);
  };
})();
""".replace("TABLE", json.dumps(_linear_table()))
