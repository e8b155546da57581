"""Where the viewer's camera stands to see posters, or a body in space: arithmetic, no viser."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

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
_BODY_DISTANCE, _OVERVIEW_DISTANCE = 1.3, 0.95
"""Of the viewer, in diagonals of what is looked at."""


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
    """Of the height, at the bottom: the timeline's strip."""


def poster_pose(rectangle: Rectangle, whole: Rectangle, window: Window) -> Pose:
    """Looks straight at a rectangle of the poster world, which fills the window's free part.

    Args:
        rectangle: What to see.
        whole: All posters: sets how far the user may zoom.
        window: The canvas.
    """
    scale = _scale(rectangle, window)
    x = (rectangle[0] + rectangle[2]) / 2
    y = (rectangle[1] + rectangle[3]) / 2 + scale * window.covered / 2
    furthest = _distance(_scale(whole, window), window)
    least, most = furthest / _MOST_ZOOM, furthest / _LEAST_ZOOM
    distance = min(max(_distance(scale, window), least), most)
    return Pose(
        position=(x, y, -distance),
        look_at=(x, y, _TARGET_DEPTH),
        fov=POSTER_FOV,
        near=least / 2,
        far=most * 1.1,
        least_distance=least,
        most_distance=most,
    )


def _scale(rectangle: Rectangle, window: Window) -> float:
    """World units in one unit of the window when the rectangle fills its free part."""
    left, top, right, bottom = rectangle
    free = max(window.height - window.covered, 0.1 * window.height)
    return _MARGIN * max((right - left) / window.width, (bottom - top) / free)


def _distance(scale: float, window: Window) -> float:
    return scale * window.height / 2 / math.tan(POSTER_FOV / 2)


def straightened(pose: Pose) -> Pose:
    """From as far away at the same point of the posters, without any turn."""
    x, y, z = pose.look_at
    return replace(pose, position=(x, y, z - pose.distance), up=(0.0, -1.0, 0.0))


def space_pose(bounds: Float[np.ndarray, "2 3"], window: Window) -> Pose:
    """Looks at bodies in a box (least and greatest coordinates), half from the side."""
    return _space_pose(bounds, window, _BODY_FROM, _BODY_DISTANCE)


def overview_pose(bounds: Float[np.ndarray, "2 3"], window: Window) -> Pose:
    """Looks at bodies in a box and at the video camera, which is in the origin, from the side."""
    everything = np.stack([np.minimum(bounds[0], 0.0), np.maximum(bounds[1], 0.0)])
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
