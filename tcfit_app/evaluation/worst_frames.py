"""The worst frames of an evaluation as pictures: truth and methods side by side.

Bodies are drawn by pyrender, or in software where there is no off-screen OpenGL.
"""

import base64
import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from fitting_core.body.geometry import vertex_normals
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.measure.curves import CURVES
from fitting_core.measure.records import Record, baseline_of, methods, of, sequences
from fitting_core.measure.report.plots import style_of
from fitting_core.measure.report.sections import BodyPicture, WorstFrame
from fitting_core.render.rasterize import rasterize
from fitting_core.render.renderer import Renderer

_RANKED = ("vertex_to_surface", "pa_mpjpe", "reprojection")
"""What makes a frame bad: the first of these that was measured."""
_COLORS = {"red": (0.75, 0.28, 0.20), "blue": (0.16, 0.40, 0.78), "violet": (0.45, 0.27, 0.72)}
_OTHER, _TRUE = (0.30, 0.55, 0.52), (0.62, 0.63, 0.62)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedBody:
    """A posed mesh in camera space."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    pelvis: Float[np.ndarray, "3"]
    color: tuple[float, float, float]
    """Red, green, blue, 0 to 1, linear."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawable:
    """A sequence's bodies."""

    camera: Camera
    bodies: dict[str, tuple[BodyModel, BodyParams]]
    """By method."""
    truth: tuple[BodyModel, BodyParams] | None
    """With the reference's frame for each of the fit's, all of them there."""


@dataclass(frozen=True, kw_only=True)
class _Bad:
    sequence: str
    frame: int
    """Counted from the fit's first."""
    method: str
    value: float


def worst_frames(
    records: Sequence[Record], drawable: Callable[[str], Drawable | None], *, count: int
) -> list[WorstFrame]:
    """At most `count` frames with the largest errors, one of each sequence for the last method and the baseline each.

    `drawable` gives the bodies of a sequence by its name, or None if there are none.
    """
    found: list[WorstFrame] = []
    ready: dict[str, Drawable | None] = {}
    for bad in _ranked(records)[:count]:
        if bad.sequence not in ready:
            ready = {bad.sequence: drawable(bad.sequence)}
        shown = ready[bad.sequence]
        if shown is not None:
            found.append(_pictured(bad, records, shown))
    return found


def _ranked(records: Sequence[Record]) -> list[_Bad]:
    """Those of the last method first."""
    curve = next((name for name in _RANKED if any(r.curve(name) is not None for r in records)), None)
    if curve is None:
        return []
    chosen = list(dict.fromkeys([methods(records)[-1], baseline_of(records)]))
    found: list[_Bad] = []
    for method in chosen:
        some = [bad for sequence in sequences(records) if (bad := _worst(records, sequence, method, curve))]
        found += sorted(some, key=lambda bad: -bad.value)
    kept = {(bad.sequence, bad.frame): bad for bad in reversed(found)}
    return [bad for bad in found if kept[bad.sequence, bad.frame] is bad]


def _worst(records: Sequence[Record], sequence: str, method: str, curve: str) -> _Bad | None:
    for record in of(records, sequence=sequence, method=method):
        values = record.curve(curve)
        if values is not None and np.isfinite(values).any():
            frame = int(np.nanargmax(values))
            return _Bad(sequence=sequence, frame=frame, method=method, value=float(values[frame]))
    return None


def _pictured(bad: _Bad, records: Sequence[Record], shown: Drawable) -> WorstFrame:
    curve = next(name for name in _RANKED if any(r.curve(name) is not None for r in records))
    kind, own = CURVES[curve], of(records, sequence=bad.sequence)
    said = ", ".join(f"{r.method} {_told(r, curve, bad.frame)}" for r in own if r.method in shown.bodies)
    placed = dict(_placed(bad.frame, shown, methods(records)))
    return WorstFrame(
        title=f"{bad.sequence}, frame {own[0].comparison.first_frame + bad.frame}",
        note=f"worst of {bad.method}; {kind.title.lower()}: {said} {kind.unit}",
        rows=_rows(placed, shown.camera),
    )


def _told(record: Record, curve: str, frame: int) -> str:
    value = record.comparison.curves[curve][frame] if curve in record.comparison.curves else None
    return "–" if value is None else f"{value:.1f}"


def _placed(frame: int, shown: Drawable, names: list[str]) -> Iterable[tuple[str, PlacedBody]]:
    if shown.truth is not None:
        yield "truth", placed_body(*shown.truth, frame, _TRUE)
    for method, (body, params) in shown.bodies.items():
        color = _COLORS.get(style_of(method, names).split()[0], _OTHER)
        yield method, placed_body(body, params, frame, color)


def placed_body(body: BodyModel, params: BodyParams, frame: int, color: tuple[float, float, float]) -> PlacedBody:
    """The body of one frame, in a colour."""
    mesh, one = shared_mesh(body), params[frame : frame + 1]
    vertices = mesh(one)[0].numpy().astype(np.float64)
    pelvis = mesh.joints(one)[0, JOINT["pelvis"]].numpy().astype(np.float64)
    return PlacedBody(vertices=vertices, faces=body.faces, pelvis=pelvis, color=color)


def _rows(placed: dict[str, PlacedBody], camera: Camera) -> tuple[tuple[BodyPicture, ...], ...]:
    first = next(iter(placed.values()))
    front = camera_around(first, camera)
    aside = {name: _from_the_side(body) for name, body in placed.items()}
    wide = Camera(focal=(1000.0, 1000.0), center=(0.0, 0.0), size=SIZE)
    side = camera_around(next(iter(aside.values())), wide)
    return (
        tuple(BodyPicture(title=name, picture=_picture(body, front)) for name, body in placed.items()),
        tuple(BodyPicture(title=f"{name}, side", picture=_picture(body, side)) for name, body in aside.items()),
    )


SIZE = (260, 320)
"""Width and height in pixels."""
_SHARPNESS = 2
"""Pictures are drawn so many times as large, and reduced."""
_DRAWN = (_SHARPNESS * SIZE[0], _SHARPNESS * SIZE[1])
_MARGIN = 1.3
_NEAREST = 0.1
"""Metres: bodies nearer to the camera, or behind it, are not drawn."""
_DISTANCE = 6.0
"""Metres from the side's camera."""
_GROUND = (236, 239, 243)
_LIGHT = np.array([-0.4, -0.55, -0.75])


def camera_around(body: PlacedBody, camera: Camera, *, size: tuple[int, int] = _DRAWN) -> Camera:
    """The clip's camera, cut to a body and a margin around it, for pictures of so many pixels."""
    pixels = body.vertices[:, :2] / body.vertices[:, 2:] * camera.focal + camera.center
    low, high = pixels.min(0), pixels.max(0)
    factor = min(size / (_MARGIN * np.maximum(high - low, 1.0)))
    focal = factor * np.array(camera.focal)
    center = factor * (camera.center - (low + high) / 2) + np.array(size) / 2
    return Camera(focal=(float(focal[0]), float(focal[1])), center=(float(center[0]), float(center[1])), size=size)


def _from_the_side(body: PlacedBody) -> PlacedBody:
    """The body turned by 90 degrees about the image's vertical, its pelvis before the side's camera."""
    turned = (body.vertices - body.pelvis) @ np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    place = np.array([0.0, 0.0, _DISTANCE])
    return replace(body, vertices=turned + place, pelvis=place)


def _picture(body: PlacedBody, camera: Camera) -> str:
    """A JPEG as data URI; empty ground where the body is not in front of the camera."""
    image = np.full((*camera.size[::-1], 3), _GROUND, np.uint8)
    if body.vertices[:, 2].min() > _NEAREST:
        image = _drawn(body, camera, image)
    small = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()


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
