"""Pictures of bodies for reports: by pyrender, or in software where there is no off-screen OpenGL."""

import base64
import functools
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from fitting_core.body.geometry import vertex_normals
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.render.renderer import Renderer
from fitting_core.synthetic.studio.rasterize import rasterize

SIZE = (260, 320)
"""Width and height in pixels."""
_SHARPNESS = 2
"""Pictures are drawn so many times as large, and reduced."""
_MARGIN = 1.3
_NEAREST = 0.1
"""Metres: bodies nearer to the camera, or behind it, are not drawn."""
_DISTANCE = 6.0
"""Metres from the side's camera."""
_GROUND = (236, 239, 243)
_LIGHT = np.array([-0.4, -0.55, -0.75])


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedBody:
    """A posed mesh in camera space."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    pelvis: Float[np.ndarray, "3"]
    color: tuple[float, float, float]
    """Red, green, blue, 0 to 1, linear."""


def camera_around(body: PlacedBody, camera: Camera) -> Camera:
    """The clip's camera, cut to a body and a margin around it."""
    pixels = body.vertices[:, :2] / body.vertices[:, 2:] * camera.focal + camera.center
    return _cut(camera, pixels.min(0), pixels.max(0))


def from_the_side(body: PlacedBody) -> PlacedBody:
    """The body turned by 90 degrees about the image's vertical, its pelvis before the side's camera."""
    turned = (body.vertices - body.pelvis) @ np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    place = np.array([0.0, 0.0, _DISTANCE])
    return replace(body, vertices=turned + place, pelvis=place)


def side_camera(body: PlacedBody) -> Camera:
    """A camera that shows a body that `from_the_side` has placed."""
    wide = Camera(focal=(1000.0, 1000.0), center=(0.0, 0.0), size=SIZE)
    return camera_around(body, wide)


def picture(body: PlacedBody, camera: Camera) -> str:
    """A JPEG as data URI; empty ground where the body is not in front of the camera."""
    image = np.full((*camera.size[::-1], 3), _GROUND, np.uint8)
    if body.vertices[:, 2].min() > _NEAREST:
        image = _drawn(body, camera, image)
    small = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()


def _cut(camera: Camera, low: np.ndarray, high: np.ndarray) -> Camera:
    width, height = (_SHARPNESS * length for length in SIZE)
    factor = min((width, height) / (_MARGIN * np.maximum(high - low, 1.0)))
    middle = (low + high) / 2
    fx, fy, cx, cy = (float(v) for v in (*camera.focal, *camera.center))
    return Camera(
        focal=(factor * fx, factor * fy),
        center=(factor * (cx - float(middle[0])) + width / 2, factor * (cy - float(middle[1])) + height / 2),
        size=(width, height),
    )


@functools.cache
def _has_gl() -> bool:
    try:
        Renderer(Camera(focal=(1.0, 1.0), center=(1.0, 1.0), size=(2, 2)))
    except InputError:
        return False
    return True


def _drawn(body: PlacedBody, camera: Camera, ground: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W 3"]:
    if _has_gl():
        return Renderer(camera).render(body.vertices, body.faces, color=body.color, background=ground)
    return in_software(body, camera, ground)


def in_software(body: PlacedBody, camera: Camera, ground: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W 3"]:
    """The body shaded by one light and the sky, over an image of the camera's size."""
    depth = np.full(camera.size[::-1], np.inf)
    shown = rasterize(body.vertices, body.faces, camera, depth)
    normals = shown.interpolate(body.faces, vertex_normals(body.vertices, body.faces))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    lit = 0.35 + 0.65 * np.maximum(normals @ (_LIGHT / np.linalg.norm(_LIGHT)), 0) - 0.1 * normals[:, 1]
    image = ground.reshape(-1, 3).copy()
    image[shown.pixel] = (255 * np.clip(lit[:, None] * np.sqrt(body.color), 0, 1)).astype(np.uint8)
    return image.reshape(ground.shape)
