"""The flat world of the 2D modes: video frames as posters, and bodies as reliefs that coincide with them.

Pixel (u, v) of a clip of W x H pixels is at world ((u - W/2)/H, (v - H/2)/H, 0) on every poster; the page draws each in
its own window (`windows.py`). Pixel coordinates start at the image's corner: the centre of the first pixel is (0.5,
0.5). The viewer looks along +z from far away (`poses.py`), so that z does not shift anything on the screen, and bodies
are projected here, with the clip's own intrinsics.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest

import numpy as np
import viser
from jaxtyping import Float

from fitting_core.camera import Camera
from tcfit_app.review.browser.page_states import Color, Layout
from tcfit_app.review.browser.page_states import Poster as PosterPlace
from tcfit_app.review.scene.layers import MOST_OTHERS, NEAREST, BodyLayer, uniform_jpeg
from tcfit_app.review.scene.nodes import BodyNode, ImageNode, MeshDressing
from tcfit_app.review.scene.other_view import OtherCamera
from tcfit_app.review.scene.poses import Window
from tcfit_app.review.scene.side_view import SideView
from tcfit_app.review.scene.windows import MARGIN, Arrangement, Division, divide

PLATE = uniform_jpeg((38, 40, 44))
"""Replaces a frame that is not ready, or a video that is switched off."""
_FAR_OUT = 8.0
"""Maximum distance of a drawn vertex from the centre, in image heights: float32 and clipping fail beyond."""
_CLEARANCE = 0.01
"""Between the image and the farthest vertex, in image heights."""
_SLOTS = 2
_ROOT = "/posters"
PICTURE_NODES = tuple(f"{_ROOT}/{i}" for i in range(_SLOTS))
"""viser's nodes for the pictures and the side view."""
SIDE_NODE = f"{_ROOT}/side"


def body_nodes(poster: str) -> tuple[str, ...]:
    """viser's nodes for the bodies on a poster, given its own: of the fits, and of other people."""
    return tuple(f"{poster}/body{i}" for i in range(_SLOTS + MOST_OTHERS))


@dataclass(frozen=True, kw_only=True, eq=False)
class Poster:
    """A video frame and the bodies on it."""

    image: bytes | None = None
    """A JPEG; None: not ready; a plain plate is shown."""
    bodies: tuple[BodyLayer, ...] = ()
    """At most two."""
    others: tuple[BodyLayer, ...] = ()
    """Of other people, at most MOST_OTHERS."""
    plain: bool = False
    """The video alone, without keypoints too."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SidePoster:
    """What is beside the pictures, with the same bodies: a plate with the side view, or another view's picture."""

    view: SideView | OtherCamera
    """Compared by identity."""
    image: bytes | None = None
    """A JPEG of another view."""
    bodies: tuple[BodyLayer, ...] = ()
    """At most two."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Posters:
    """What the 2D modes show: one or two pictures, with the side view to the right."""

    camera: Camera
    """The clip's. Pictures have its size for any resolution of the encoded images."""
    posters: tuple[Poster, ...]
    side: SidePoster | None = None
    arrangement: Arrangement | None = None
    """Arrangement of two pictures; None: whichever makes them larger."""

    def __post_init__(self) -> None:
        assert 1 <= len(self.posters) <= _SLOTS
        for poster in self.posters:
            assert len(poster.bodies) <= _SLOTS and len(poster.others) <= MOST_OTHERS

    @property
    def width(self) -> float:
        """Width of a picture, in image heights."""
        return self.camera.size[0] / self.camera.size[1]

    def divide(self, canvas: Window) -> Division:
        """Windows for all posters."""
        side = None if self.side is None else self.side.view.width
        if self.side is not None and isinstance(self.side.view, OtherCamera):
            side = MARGIN * self.side.view.width
        return divide(canvas, pictures=len(self.posters), width=self.width, side=side, arrangement=self.arrangement)


def world_of_pixels(pixels: Float[np.ndarray, "*n 2"], size: tuple[int, int]) -> Float[np.ndarray, "*n 2"]:
    """World x and y of pixel positions."""
    return (pixels - np.array(size) / 2) / size[1]


def relief(
    bodies: Sequence[Float[np.ndarray, "V 3"]], camera: Camera, own: Sequence[Camera | None] = ()
) -> list[Float[np.ndarray, "V 3"]]:
    """Vertices on a poster of bodies that occlude each other by depth.

    Depth is drawn as f/H log(z / greatest z): this preserves the order, and scales z like the projection scales x and y
    at every z, so that the shading matches the body's shape.

    Args:
        bodies: In camera space, metres.
        camera: The poster's.
        own: Intrinsics of each body that has its own, for the same image size.
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


def poster_layout(
    snapshot: Posters, named: tuple[tuple[str, Color | None], ...], canvas: Window, *, clipped: bool
) -> Layout:
    """The positions and labels of the posters."""
    division = snapshot.divide(canvas)
    pictures, beside = len(snapshot.posters), "side"
    if snapshot.side is not None and isinstance(snapshot.side.view, OtherCamera):
        beside = "view"
    nodes = (*PICTURE_NODES[:pictures], SIDE_NODE)
    posters = tuple(
        PosterPlace(
            node=node,
            window=(left / canvas.width, top / canvas.height, right / canvas.width, bottom / canvas.height),
            width=snapshot.width if snapshot.side is None or i < pictures else snapshot.side.view.width,
            kind=beside if i >= pictures else "video" if snapshot.posters[i].plain else "picture",
            clipped=clipped or i >= pictures,
            label=label,
            color=color,
        )
        for i, (node, (left, top, right, bottom), (label, color)) in enumerate(
            zip(nodes, division.windows, named, strict=False)
        )
    )
    wipe = pictures == 2 and division.arrangement == "wipe"
    return Layout(mode="poster", image=snapshot.camera.size, posters=posters, wipe=wipe)


class PosterNodes:
    """The posters in one browser tab."""

    def __init__(self, client: viser.ClientHandle, dressing: MeshDressing) -> None:
        self._root = client.scene.add_frame(_ROOT, show_axes=False, visible=False)
        self._slots = [_Slot(client, name, dressing) for name in PICTURE_NODES]
        self._side, self._dressing, self._filmed = _Slot(client, SIDE_NODE, dressing), dressing, False
        self._dress_side()

    def draw(self, snapshot: Posters) -> None:
        """Send what changed."""
        camera = snapshot.camera
        for i, slot in enumerate(self._slots):
            if i < len(snapshot.posters):
                poster = snapshot.posters[i]
                slot.show(poster.image or PLATE, snapshot.width)
                slot.draw(poster.bodies, poster.others, camera, partial(_on_picture, camera))
            else:
                slot.hide()
        side = snapshot.side
        if side is None:
            self._side.hide()
        else:
            filmed = isinstance(side.view, OtherCamera)
            if filmed != self._filmed:
                self._filmed = filmed
                self._dress_side()
            self._side.show(side.image or PLATE, side.view.width)
            # No video would be visible through those of the side view.
            self._side.draw(side.bodies, (), side.view, partial(_beside, side.view), solid=not filmed)

    def _dress_side(self) -> None:
        self._dressing.dress(f"{SIDE_NODE}/video", nothing=not self._filmed)  # else the page's ground is seen

    def set_visible(self, visible: bool) -> None:
        """Show or hide all of them."""
        self._root.visible = visible


Project = Callable[[Sequence[BodyLayer]], list[Float[np.ndarray, "V 3"]]]
"""Returns the vertices of bodies on a poster."""


def _on_picture(camera: Camera, bodies: Sequence[BodyLayer]) -> list[Float[np.ndarray, "V 3"]]:
    return relief([body.vertices for body in bodies], camera, [body.camera for body in bodies])


def _beside(view: SideView | OtherCamera, bodies: Sequence[BodyLayer]) -> list[Float[np.ndarray, "V 3"]]:
    # Without other people: two who stand side by side before the camera would hide each other here.
    vertices = [body.vertices for body in bodies]
    if isinstance(view, OtherCamera):
        return relief([view.seen(points) for points in vertices], view.camera)
    return view.relief(vertices, view.shifts(vertices))


class _Slot:
    """One poster's nodes, created once, so that frames replace each other without a gap."""

    def __init__(self, client: viser.ClientHandle, name: str, dressing: MeshDressing) -> None:
        self._frame = client.scene.add_frame(name, show_axes=False, visible=False)
        self._image = ImageNode(client, f"{name}/video", dressing, PLATE)
        # Transparent nodes are drawn from far to near by their positions: bodies are in front of the image.
        front = (0.0, 0.0, -_CLEARANCE)
        self._bodies = [BodyNode(client, body, dressing, front) for body in body_nodes(name)]
        self._source: tuple[object, ...] = ()
        self._reliefs: list[np.ndarray] = []

    def show(self, image: bytes, width: float) -> None:
        """Show it. Its node stays in place; the page moves it into the poster's window."""
        self._image.draw(image, (width, 1.0))
        self._frame.visible = True

    def hide(self) -> None:
        self._frame.visible = False

    def draw(
        self,
        bodies: tuple[BodyLayer, ...],
        others: tuple[BodyLayer, ...],
        how: object,
        project: Project,
        *,
        solid: bool = False,
    ) -> None:
        """Draw bodies on it.

        Args:
            bodies: Of the fits.
            others: Of other people.
            how: Identifies `project`.
            project: The projection.
            solid: Opaque, regardless of the layers' opacity.
        """
        everybody = (*bodies, *others)
        source = how, len(bodies), *(body.camera for body in everybody), *(body.vertices for body in everybody)
        if not _same(source, self._source):
            self._reliefs = project(everybody)
            self._source = source
        reliefs = iter(self._reliefs)
        for node, body in zip_longest(self._bodies, (*bodies, *[None] * (_SLOTS - len(bodies)), *others)):
            if body is None:
                node.hide()
            else:
                node.draw(body, next(reliefs), solid=solid, lines=not solid)


def _same(a: tuple[object, ...], b: tuple[object, ...]) -> bool:
    return len(a) == len(b) and all(x is y for x, y in zip(a, b, strict=True))
