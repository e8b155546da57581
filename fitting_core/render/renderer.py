"""Off-screen rendering of meshes with the clip's camera: the only import of pyrender.

pyrender draws through EGL or OSMesa. Which of them works is found out in a subprocess, because a broken OpenGL
installation can abort the whole process. Near and far planes are always given: pyrender 0.1.45 would otherwise look at
`Mesh.bounds` or `Scene.scale`, which use `np.infty`, gone in numpy 2.
"""

import functools
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from fitting_core.body.geometry import vertex_normals
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.render.off_screen import BACKENDS, use_backend

PROBE_SECONDS = 60
DEFAULT_COLOR = (0.62, 0.68, 0.76)
_CAMERA_TO_GL = np.array([1.0, -1.0, -1.0])
# Directions towards the lights (camera space of OpenGL: x right, y up, z backward) and their intensities: a key light
# from the upper left, a weak fill from the right, and a rim from behind that parts limbs from the trunk.
_LIGHTS = (((-0.5, 0.7, 0.9), 2.3), ((0.9, 0.1, 0.6), 0.7), ((0.3, 0.6, -1.0), 0.8))
_AMBIENT = 0.14
_PROBE = """
import sys
from fitting_core.render.off_screen import use_backend
use_backend(sys.argv[1])
import pyrender
scene = pyrender.Scene()
scene.add(pyrender.Mesh([pyrender.Primitive(positions=[[-1, -1, -2], [1, -1, -2], [0, 1, -2]], mode=4)]))
scene.add(pyrender.IntrinsicsCamera(16, 16, 8, 8, znear=0.1, zfar=10))
renderer = pyrender.OffscreenRenderer(16, 16)
_, depth = renderer.render(scene)
assert abs(depth[8, 8] - 2) < 1e-3, depth[8, 8]
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnMesh:
    """A mesh to draw."""

    vertices: Float[np.ndarray, "V 3"]
    """Camera space: x right, y down, z away from the camera, metres."""
    faces: Int[np.ndarray, "F 3"]
    color: tuple[float, float, float] = DEFAULT_COLOR
    """Red, green, blue, 0 to 1, linear."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A drawing without background."""

    rgb: UInt8[np.ndarray, "H W 3"]
    """Colour times alpha."""
    alpha: UInt8[np.ndarray, "H W"]
    """0 (nothing) to 255 (surface); between them along outlines, which are anti-aliased."""
    depth: Float[np.ndarray, "H W"]
    """Distance along z in metres, somewhere within the pixel (the outlines' samples lie off its middle); infinite where
    nothing is."""

    def over(
        self, background: UInt8[np.ndarray, "H W 3"] | None = None, *, opacity: float = 1.0
    ) -> UInt8[np.ndarray, "H W 3"]:
        """The picture over a background of its size (white when None)."""
        alpha = self.alpha[..., None].astype(np.float32) * (opacity / 255)
        below = 255.0 if background is None else background
        return (self.rgb * np.float32(opacity) + (1 - alpha) * below + 0.5).astype(np.uint8)


@functools.cache
def off_screen_gl() -> str | None:
    """The name of the backend of BACKENDS that works here, or None. The first call takes a few seconds."""
    return next((name for name in _candidates() if probe(name) is None), None)


def _candidates() -> list[str]:
    """The backend of the user's PYOPENGL_PLATFORM alone, if it is one of ours; else all."""
    wish = os.environ.get("PYOPENGL_PLATFORM")
    return [wish] if wish in BACKENDS else list(BACKENDS)


def probe(backend: str) -> str | None:
    """None if the backend draws a triangle correctly in a process of its own; else the last line of what it said."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
    command = [sys.executable, "-c", _PROBE, backend]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PROBE_SECONDS)
    except subprocess.TimeoutExpired:
        return f"did not answer within {PROBE_SECONDS} s"
    if done.returncode == 0:
        return None
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"ended with exit status {done.returncode}"


def _no_gl_message() -> str:
    reasons = "; ".join(f"{name}: {probe(name)}" for name in _candidates())
    packages = " or ".join(f"`apt-get install {packages}`" for packages in BACKENDS.values())
    return (
        f"No off-screen OpenGL was found, which rendering needs ({reasons}). On Debian or Ubuntu, {packages} "
        "provides one, without a graphics card and without a display. Everything but rendered video works without."
    )


def _load_pyrender() -> Any:
    """pyrender, set to the backend that works."""
    backend = off_screen_gl()
    if backend is None:
        raise InputError(_no_gl_message())
    use_backend(backend)
    import pyrender

    return pyrender


def scaled_camera(camera: Camera, factor: float) -> Camera:
    """The camera of the same images resized by a factor, to whole and even pixels (as video encoders want them)."""
    width, height = (max(2, 2 * round(length * factor / 2)) for length in camera.size)
    return camera.resized((width, height))


class _Target:
    """The process's OpenGL context, in a thread of its own.

    There is one only, because pyrender closes the display, and with it every other context, when it closes one. It
    never leaves its thread, because pyrender never releases it, and a context is bound to one thread at a time.
    """

    def __init__(self) -> None:
        self.pyrender = _load_pyrender()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="off-screen")
        self._renderer = self._thread.submit(self._open).result()

    def _open(self) -> Any:
        renderer = self.pyrender.OffscreenRenderer(2, 2)
        # pyrender assumes that OSMesa has no framebuffers; Mesa's OpenGL 3.3 has, and alpha and soft edges need them.
        renderer._platform.supports_framebuffers = lambda: True
        return renderer

    def render(self, scene: Any, size: tuple[int, int], flags: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour and depth buffers. Callers from several threads are served one after the other."""
        return self._thread.submit(self._draw, scene, size, flags).result()

    def _draw(self, scene: Any, size: tuple[int, int], flags: int) -> tuple[np.ndarray, np.ndarray]:
        self._renderer.viewport_width, self._renderer.viewport_height = size
        return self._renderer.render(scene, flags=flags)


@functools.cache
def _target() -> _Target:
    return _Target()


class Renderer:
    """Draws meshes as the camera sees them. Cheap to make and to drop; any thread may use it.

    Raises InputError when the machine has no off-screen OpenGL; the message names the packages to install.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._target = _target()
        self._pyrender = self._target.pyrender

    def draw(self, surfaces: Sequence[DrawnMesh]) -> Picture:
        """Several meshes in one picture, hiding each other by depth."""
        scene = self._pyrender.Scene(bg_color=np.zeros(4), ambient_light=np.full(3, _AMBIENT))
        for surface in surfaces:
            scene.add(self._mesh(surface))
        for direction, intensity in _LIGHTS:
            scene.add(self._pyrender.DirectionalLight(intensity=intensity), pose=_light_pose(direction))
        near, far = _depth_range(surfaces)
        lens = self._pyrender.IntrinsicsCamera(*self.camera.focal, *self.camera.center, znear=near, zfar=far)
        scene.add(lens)
        # Both sides of every face: a mesh with a hole or with mixed winding still has its outline and its depth.
        flags = self._pyrender.RenderFlags.RGBA | self._pyrender.RenderFlags.SKIP_CULL_FACES
        rgba, depth = self._target.render(scene, self.camera.size, flags)
        return Picture(
            rgb=np.ascontiguousarray(rgba[..., :3]),
            alpha=np.ascontiguousarray(rgba[..., 3]),
            depth=np.where(depth > 0, depth, np.inf).astype(np.float32),
        )

    def render(
        self,
        vertices: Float[np.ndarray, "V 3"],
        faces: Int[np.ndarray, "F 3"],
        *,
        color: tuple[float, float, float] = DEFAULT_COLOR,
        background: UInt8[np.ndarray, "H W 3"] | None = None,
        opacity: float = 1.0,
    ) -> UInt8[np.ndarray, "H W 3"]:
        """One mesh in camera space (metres) over an image of the camera's size, or over white; colours are RGB."""
        surface = DrawnMesh(vertices=vertices, faces=faces, color=color)
        return self.draw([surface]).over(background, opacity=opacity)

    def _mesh(self, surface: DrawnMesh) -> Any:
        vertices = np.asarray(surface.vertices, np.float64) * _CAMERA_TO_GL
        primitive = self._pyrender.Primitive(
            positions=vertices,
            normals=vertex_normals(vertices, surface.faces),
            indices=surface.faces,
            material=self._pyrender.MetallicRoughnessMaterial(
                baseColorFactor=(*surface.color, 1.0), metallicFactor=0.0, roughnessFactor=0.6
            ),
            mode=self._pyrender.GLTF.TRIANGLES,
        )
        return self._pyrender.Mesh([primitive])


def _depth_range(surfaces: Sequence[DrawnMesh]) -> tuple[float, float]:
    """Near and far planes close around the meshes, so that the depth buffer's 24 bits are spent on them."""
    z = np.concatenate([surface.vertices[:, 2] for surface in surfaces]) if surfaces else np.ones(1)
    near = max(0.05, 0.9 * float(z.min()))
    return near, max(1.1 * float(z.max()), 2 * near)


def _light_pose(direction: tuple[float, float, float]) -> np.ndarray:
    """Pose (4, 4) of a directional light: it shines along its -z, so its z axis points towards where it comes from."""
    z = np.array(direction) / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = x, np.cross(z, x), z
    return pose
