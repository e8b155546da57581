"""three.js with its glTF loader in a page of its own, from the viewer that comes with trimesh: no network is needed."""

import base64
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

_SCRIPT = """
async (content) => {
  const bytes = Uint8Array.from(atob(content), (c) => c.charCodeAt(0));
  const gltf = await new Promise((done, failed) => new THREE.GLTFLoader().parse(bytes.buffer, "", done, failed));
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0x20242b);
  scene.add(gltf.scene, new THREE.HemisphereLight(0xffffff, 0x444a55, 0.5));
  const sun = new THREE.DirectionalLight(0xffffff, 0.7);
  sun.position.set(-2, 3, 4);
  scene.add(sun);
  const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  renderer.outputEncoding = THREE.sRGBEncoding;
  renderer.setSize(innerWidth, innerHeight);
  document.body.style.margin = 0;
  document.body.appendChild(renderer.domElement);
  const mixer = new THREE.AnimationMixer(gltf.scene);
  mixer.clipAction(gltf.animations[0]).play();
  let mesh = null;
  gltf.scene.traverse((node) => { if (node.isSkinnedMesh) mesh = node; });
  const camera = gltf.cameras[0];
  window.show = (time) => {
    mixer.setTime(time);
    scene.updateMatrixWorld(true);
    mesh.frustumCulled = false;
    renderer.render(scene, camera);
  };
  window.posed = (time) => {
    show(time);
    const { position } = mesh.geometry.attributes, shapes = mesh.geometry.morphAttributes.position || [];
    const found = new Float32Array(3 * position.count), vertex = new THREE.Vector3(), shift = new THREE.Vector3();
    for (let i = 0; i < position.count; i++) {
      vertex.fromBufferAttribute(position, i);
      shapes.forEach((shape, k) => {
        vertex.addScaledVector(shift.fromBufferAttribute(shape, i), mesh.morphTargetInfluences[k]);
      });
      mesh.boneTransform(i, vertex).applyMatrix4(mesh.matrixWorld).toArray(found, 3 * i);
    }
    return btoa(Array.from(new Uint8Array(found.buffer), (b) => String.fromCharCode(b)).join(""));
  };
  return { duration: gltf.animations[0].duration, bones: mesh.skeleton.bones.length, revision: THREE.REVISION,
           relative: mesh.geometry.morphTargetsRelative };
}
"""


def _library() -> str:
    """The scripts of trimesh's viewer, up to where it begins to show something."""
    path = Path(trimesh.__file__).parent / "resources" / "templates" / "viewer.zip"
    if not path.is_file():
        pytest.skip("this trimesh brings no viewer with three.js")
    with zipfile.ZipFile(path) as archive:
        page = archive.read("viewer.html.template").decode()
    start, end = page.find("<script>"), page.find("var camera,controls,scene")
    if min(start, end) < 0 or "THREE.GLTFLoader" not in page:
        pytest.skip("trimesh's viewer is another than this test knows")
    return page[start + len("<script>") : end]


class ThreePage:
    """A GLB file as three.js has loaded it."""

    def __init__(self, browser: "Browser", path: Path, *, size: tuple[int, int] = (640, 480)) -> None:
        self.complaints: list[str] = []
        self.page: Page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.set_content("<!doctype html><body></body>")
        self.page.add_script_tag(content=_library())
        self.about = self.page.evaluate(_SCRIPT, base64.b64encode(path.read_bytes()).decode())

    def vertices(self, time: float) -> np.ndarray:
        """The skinned mesh at a time in seconds, (V, 3)."""
        content = self.page.evaluate("(time) => posed(time)", time)
        return np.frombuffer(base64.b64decode(content), np.float32).reshape(-1, 3)

    def picture(self, time: float) -> bytes:
        """What is on the screen at a time, as PNG."""
        self.page.evaluate("(time) => show(time)", time)
        return self.page.screenshot()
