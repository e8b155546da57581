"""Where the viewer's camera stands to see posters, or a body in space: arithmetic, no viser."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera

Vector = tuple[float, float, float]
Rectangle = tuple[float, float, float, float]
"""Left, top, right, bottom."""

POSTER_FOV = 0.0004
"""Radians. The further away and the narrower, the less a relief's depth shifts it: by depth / distance of what lies off
the middle of the window. With this a body shifts by less than a pixel at 20-fold zoom."""
SPACE_FOV = 0.75
_MOST_ZOOM = 60.0
"""How much nearer than the whole poster the user may get."""
_LEAST_ZOOM = 0.3
_TARGET_DEPTH = 0.1
"""Posters are orbited around a point behind them, in image heights: viser marks it with a cross, which they hide."""
_MARGIN = 1.03
_BODY_FROM = np.array([0.62, -0.28, -0.73])
"""From the body towards the viewer in 3D: the video camera's side, from the right and a little from above."""
_OVERVIEW_FROM = np.array([0.74, -0.38, -0.6])
SPACE_FROM = {"front": (0.0, -0.05, -1.0), "side": (1.0, -0.05, 0.0), "top": (0.0, -1.0, -0.002)}
"""From the body towards the viewer, by what that is called. From right above there would be no up on the screen."""
_BODY_DISTANCE, _OVERVIEW_DISTANCE = 1.3, 0.95
"""Of the viewer, in diagonals of what is looked at."""


_ORIGIN = np.zeros(3)
_LEAST_SIZE, _CLOSE = 0.15, 1.3
"""Of what is zoomed to in 3D: metres at least, and how much more than it is seen."""


@dataclass(frozen=True, kw_only=True)
class Pose:
    """A camera of viser: world coordinates, radians."""

    position: Vector
    look_at: Vector
    up: Vector = (0.0, -1.0, 0.0)
    fov: float
    near: float
    far: float
    least_distance: float
    """How near to `look_at` the user may get."""
    most_distance: float

    @property
    def distance(self) -> float:
        """From `look_at`."""
        return math.dist(self.position, self.look_at)

    @property
    def height(self) -> float:
        """Of what the window shows at `look_at`."""
        return 2 * self.distance * math.tan(self.fov / 2)

    def close_to(self, other: "Pose") -> bool:
        """Whether the user sees the same, within about a tenth of a pixel."""
        tolerance = 1e-4 * self.height
        return (
            abs(self.fov - other.fov) < 1e-3 * self.fov
            and math.dist(self.position, other.position) < tolerance
            and math.dist(self.look_at, other.look_at) < tolerance
        )


@dataclass(frozen=True, kw_only=True)
class Window:
    """What the user looks through, in any unit of length that all three share."""

    width: float
    height: float
    covered: float = 0.0
    """Of the height, at the bottom: what lies over it."""


def poster_pose(middle: tuple[float, float], scale: float, *, whole: float, canvas: Window) -> Pose:
    """Looks straight at a place of the poster world.

    Args:
        middle: What is in the middle of each window.
        scale: Pixels of the canvas per image height.
        whole: The scale with which the whole picture is seen: sets how far the user may zoom.
        canvas: All of it.
    """
    furthest = _distance(whole, canvas)
    least, most = furthest / _MOST_ZOOM, furthest / _LEAST_ZOOM
    distance = min(max(_distance(scale, canvas), least), most)
    return Pose(
        position=(*middle, -distance),
        look_at=(*middle, _TARGET_DEPTH),
        fov=POSTER_FOV,
        near=least / 2,
        far=most * 1.1,
        least_distance=least,
        most_distance=most,
    )


def _distance(scale: float, canvas: Window) -> float:
    return canvas.height / scale / 2 / math.tan(POSTER_FOV / 2)


def straightened(pose: Pose) -> Pose:
    """From as far away at the same point of the posters, without any turn."""
    x, y, z = pose.look_at
    return replace(pose, position=(x, y, z - pose.distance), up=(0.0, -1.0, 0.0))


def space_pose(bounds: Float[np.ndarray, "2 3"], window: Window) -> Pose:
    """Looks at bodies in a box (least and greatest coordinates), half from the side."""
    return _space_pose(bounds, window, _BODY_FROM, _BODY_DISTANCE)


def named_pose(name: str, bounds: Float[np.ndarray, "2 3"], window: Window) -> Pose:
    """Looks at bodies in a box from one of SPACE_FROM."""
    return _space_pose(bounds, window, np.array(SPACE_FROM[name]), _BODY_DISTANCE)


def filming_pose(
    camera: Camera,
    turn: Float[np.ndarray, "3 3"],
    bounds: Float[np.ndarray, "2 3"],
    window: Window,
    *,
    near: float,
    place: Float[np.ndarray, "3"] = _ORIGIN,
) -> Pose:
    """Looks at bodies in a box from the video camera, the way that it looks; its whole picture is in the window.

    Args:
        camera: Of the video; its picture's middle is taken for that of the view.
        turn: From camera space to the world.
        bounds: Least and greatest coordinates, in the world.
        window: The canvas.
        near: Metres within which nothing is drawn.
        place: Of the camera, in the world.
    """
    free = max(window.height - window.covered, 0.1 * window.height)
    scale = _MARGIN * max(camera.size[0] / window.width, camera.size[1] / free)
    ahead = turn @ np.array([0.0, 0.0, 1.0])
    return Pose(
        position=_vector(place),
        look_at=_vector(place + ahead * max(float((bounds.mean(0) - place) @ ahead), 2 * near)),
        up=_vector(turn @ np.array([0.0, -1.0, 0.0])),
        fov=2 * math.atan(scale * window.height / 2 / camera.focal[1]),
        near=near,
        far=300.0,
        least_distance=0.1,
        most_distance=60.0,
    )


def nearer_pose(pose: Pose, bounds: Float[np.ndarray, "2 3"], window: Window) -> Pose:
    """Looks at a box (least and greatest coordinates), which fills the window, from the side of another pose."""
    away = np.subtract(pose.position, pose.look_at) / pose.distance
    middle, size = bounds.mean(0), max(math.dist(bounds[0], bounds[1]), _LEAST_SIZE)
    narrow = max(1.0, window.height / window.width)
    distance = max(_CLOSE * narrow * size / 2 / math.tan(pose.fov / 2), pose.least_distance)
    return replace(pose, position=_vector(middle + distance * away), look_at=_vector(middle))


def overview_pose(bounds: Float[np.ndarray, "2 3"], window: Window, place: Float[np.ndarray, "3"] = _ORIGIN) -> Pose:
    """Looks at bodies in a box and at the video camera, which is in that place, from the side."""
    everything = np.stack([np.minimum(bounds[0], place), np.maximum(bounds[1], place)])
    return _space_pose(everything, window, _OVERVIEW_FROM, _OVERVIEW_DISTANCE)


def _space_pose(
    bounds: Float[np.ndarray, "2 3"], window: Window, view_from: Float[np.ndarray, "3"], diagonals: float
) -> Pose:
    middle = bounds.mean(0)  # what the user turns around
    free = (window.height - window.covered) / window.height
    # A window higher than wide must stand further off.
    distance = diagonals * math.dist(bounds[0], bounds[1]) / free * max(1.0, window.height / window.width)
    middle[1] += distance * math.tan(SPACE_FOV / 2) * window.covered / window.height  # bodies above what is covered
    position = middle + view_from / np.linalg.norm(view_from) * distance
    return Pose(
        position=_vector(position),
        look_at=_vector(middle),
        fov=SPACE_FOV,
        near=0.02,
        far=300.0,
        least_distance=0.1,
        most_distance=60.0,
    )


def _vector(a: Float[np.ndarray, "3"]) -> Vector:
    return float(a[0]), float(a[1]), float(a[2])
