"""The flat world of the 2D modes: video frames as posters, and bodies as reliefs that lie on them exactly.

Pixel (u, v) of a clip of W x H pixels lies at world ((u - W/2)/H + x, (v - H/2)/H, 0), where x is the poster's. Pixels
are counted from the image's corner: the middle of the first one is (0.5, 0.5). The viewer looks along +z from far away
(`cameras.py`), so that z shifts nothing on the screen, and a body is projected here, with the clip's own intrinsics.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
from jaxtyping import Float

from fitting_core.camera import Camera
from tcfit_app.review.scene.layers import NEAREST, BodyLayer, FrameImage, drawable
from tcfit_app.review.scene.nodes import BodyNode, ImageNode, MeshDressing
from tcfit_app.review.scene.poses import Rectangle

GAP = 0.03
"""Between two posters, in image heights."""
PLATE = FrameImage.uniform((38, 40, 44))
"""In place of a frame that is not there yet, or of a video that is switched off."""
_FAR_OUT = 8.0
"""How far from the middle, in image heights, a vertex is drawn: beyond, float32 and the browser's clipping lose it."""
_CLEARANCE = 0.01
"""Between the image and the furthest vertex, in image heights."""
_SLOTS = 2
_ROOT = "/posters"


@dataclass(frozen=True, kw_only=True, eq=False)
class Poster:
    """A video frame and the bodies on it."""

    image: FrameImage | None = None
    """None: not there yet; a plain plate is shown. Compared by identity."""
    bodies: tuple[BodyLayer, ...] = ()
    """At most two."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Posters:
    """What the 2D modes show: one poster, or two side by side."""

    camera: Camera
    """The clip's. Its size is the size of the posters, whatever that of the encoded images is."""
    posters: tuple[Poster, ...]

    def __post_init__(self) -> None:
        assert 1 <= len(self.posters) <= _SLOTS
        assert all(len(poster.bodies) <= _SLOTS for poster in self.posters)

    @property
    def places(self) -> tuple[float, ...]:
        """World x of the posters' middles."""
        return poster_places(len(self.posters), self.camera.size)

    @property
    def bounds(self) -> Rectangle:
        """Of all posters, in the world."""
        half = self.camera.size[0] / self.camera.size[1] / 2
        return self.places[0] - half, -0.5, self.places[-1] + half, 0.5


def poster_places(count: int, size: tuple[int, int]) -> tuple[float, ...]:
    """World x of the middles of so many posters of that many pixels (width, height)."""
    step = size[0] / size[1] + GAP
    return tuple(step * (i - (count - 1) / 2) for i in range(count))


def world_of_pixels(
    pixels: Float[np.ndarray, "*n 2"], size: tuple[int, int], x: float = 0.0
) -> Float[np.ndarray, "*n 2"]:
    """World x and y of pixels on a poster whose middle is at x."""
    return (pixels - np.array(size) / 2) / size[1] + np.array([x, 0.0])


def relief(
    bodies: Sequence[Float[np.ndarray, "V 3"]], camera: Camera, own: Sequence[Camera | None] = ()
) -> list[Float[np.ndarray, "V 3"]]:
    """Vertices on a poster at x = 0, of bodies that hide each other by their depth.

    Depth is drawn as f/H log(z / furthest z): it keeps the order and stretches z as the projection stretches x and y,
    at every z, so that a body is shaded as it is shaped.

    Args:
        bodies: In camera space, metres.
        camera: The poster's.
        own: Of each body that has one of its own, of the same image size: its intrinsics.
    """
    if not bodies:
        return []
    depths = [np.maximum(vertices[:, 2:], NEAREST) for vertices in bodies]
    furthest = max(float(depth.max()) for depth in depths)
    scale = camera.focal[1] / camera.size[1]
    cameras = [one or camera for one in own] or [camera] * len(bodies)
    out = []
    for vertices, depth, one in zip(bodies, depths, cameras, strict=True):
        pixels = vertices[:, :2] / depth * np.array(one.focal) + np.array(one.center)
        flat = np.clip(world_of_pixels(pixels, camera.size), -_FAR_OUT, _FAR_OUT)
        out.append(np.hstack([flat, scale * np.log(depth / furthest)]).astype(np.float32))
    return out


class PosterNodes:
    """The posters in one browser tab."""

    def __init__(self, client: viser.ClientHandle, dressing: MeshDressing) -> None:
        self._root = client.scene.add_frame(_ROOT, show_axes=False, visible=False)
        self._slots = [_Slot(client, f"{_ROOT}/{i}", dressing) for i in range(_SLOTS)]

    def draw(self, snapshot: Posters) -> list[str]:
        """Sends what changed; returns what cannot be shown, and why."""
        places = snapshot.places
        problems = []
        for i, slot in enumerate(self._slots):
            if i < len(places):
                problems += slot.draw(snapshot.posters[i], snapshot.camera, places[i])
            else:
                slot.hide()
        return problems

    def set_visible(self, visible: bool) -> None:
        """Shows or hides all of them."""
        self._root.visible = visible


class _Slot:
    """One poster's nodes, made once, so that frames replace each other without a gap."""

    def __init__(self, client: viser.ClientHandle, name: str, dressing: MeshDressing) -> None:
        self._frame = client.scene.add_frame(name, show_axes=False, visible=False)
        self._image = ImageNode(client, f"{name}/video", dressing, PLATE)
        # Transparent things are drawn from far to near by their nodes' places: the bodies' lie in front of the image's.
        front = (0.0, 0.0, -_CLEARANCE)
        self._bodies = [BodyNode(client, f"{name}/body{i}", dressing, front) for i in range(_SLOTS)]
        self._source: tuple[object, ...] = ()
        self._reliefs: list[np.ndarray] = []

    def draw(self, poster: Poster, camera: Camera, x: float) -> list[str]:
        self._image.draw(poster.image or PLATE, (camera.size[0] / camera.size[1], 1.0))
        problems = self._draw_bodies(poster.bodies, camera)
        self._frame.position = (x, 0.0, 0.0)
        self._frame.visible = True
        return problems

    def hide(self) -> None:
        self._frame.visible = False

    def _draw_bodies(self, bodies: tuple[BodyLayer, ...], camera: Camera) -> list[str]:
        shown, problems = drawable(bodies)
        own = [body.camera for body in shown if body]
        source = camera, *own, *(body.vertices for body in shown if body)
        if not _same(source, self._source):
            self._reliefs = relief([body.vertices for body in shown if body], camera, own)
            self._source = source
        reliefs = iter(self._reliefs)
        for i, node in enumerate(self._bodies):
            body = shown[i] if i < len(shown) else None
            node.draw(body, next(reliefs)) if body else node.hide()
        return problems


def _same(a: tuple[object, ...], b: tuple[object, ...]) -> bool:
    return len(a) == len(b) and all(x is y for x, y in zip(a, b, strict=True))
