"""The poses of the viewer's camera for posters and for bodies in space. Arithmetic, no viser."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

Vector = tuple[float, float, float]
Rectangle = tuple[float, float, float, float]
"""Left, top, right, bottom."""

POSTER_FOV = 0.0004
"""Field of view, radians. The farther away and the narrower, the less a relief's depth shifts it on the screen: by
depth / distance times the offset from the window's centre. With this value, by under a pixel at 20-fold zoom."""
SPACE_FOV = 0.75
_MOST_ZOOM = 60.0
"""Maximum zoom relative to the whole poster."""
_LEAST_ZOOM = 0.3
_TARGET_DEPTH = 0.1
"""Posters are orbited around a point this far behind them, in image heights: they hide the cross that viser draws
there."""
_MARGIN = 1.03
_BODY_FROM: Vector = (0.62, -0.28, -0.73)
"""From the body towards the viewer in 3D: the video camera's side, from the right and slightly above."""
_BODY_DISTANCE = 1.4
"""Distance of the viewer, in diagonals of the subject."""


_LEAST_SIZE, _CLOSE = 0.15, 1.3
"""Zooming in 3D: minimum size in metres, and the margin relative to the subject."""

_TURN, _PITCH = 30, 60
"""Degrees: steps of the directions that are tried for a free view, and the largest change of the pitch."""
_AROUND, _BEAM, _FREE = 0.15, 0.05, 0.1
"""Metres: around the point, vertices are its own; vertices of a body are at most 5 cm apart; room around the camera."""


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
    """The minimum distance to `look_at`."""
    most_distance: float

    @property
    def distance(self) -> float:
        """From `look_at`."""
        return math.dist(self.position, self.look_at)

    @property
    def height(self) -> float:
        """Height of the visible part at `look_at`."""
        return 2 * self.distance * math.tan(self.fov / 2)


@dataclass(frozen=True, kw_only=True)
class Window:
    """The user's window, in any common unit of length."""

    width: float
    height: float


def poster_pose(middle: tuple[float, float], scale: float, *, whole: float, canvas: Window) -> Pose:
    """Looks straight at a point of the poster world.

    Args:
        middle: The point at the centre of each window.
        scale: Pixels of the canvas per image height.
        whole: The scale that shows the whole picture; determines the zoom limit.
        canvas: The whole canvas.
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
    """The same point seen from the same distance, without rotation."""
    x, y, z = pose.look_at
    return replace(pose, position=(x, y, z - pose.distance), up=(0.0, -1.0, 0.0))


def nearer_pose(pose: Pose, bounds: Float[np.ndarray, "2 3"], window: Window) -> Pose:
    """Fits a bounding box (least and greatest coordinates) into the window, seen from another pose's direction."""
    away = np.subtract(pose.position, pose.look_at) / pose.distance
    middle, size = bounds.mean(0), max(math.dist(bounds[0], bounds[1]), _LEAST_SIZE)
    narrow = max(1.0, window.height / window.width)
    distance = max(_CLOSE * narrow * size / 2 / math.tan(pose.fov / 2), pose.least_distance)
    return replace(pose, position=_vector(middle + distance * away), look_at=_vector(middle))


def clear_pose(pose: Pose, obstacles: Float[np.ndarray, "n 3"]) -> Pose:
    """The pose, turned about the point that it looks at as little as a free view of that point needs.

    Args:
        pose: Looks at a point on or in a body.
        obstacles: Vertices of bodies.
    """
    from scipy.spatial.transform import Rotation  # the first picture does not wait for it

    target, away = np.array(pose.look_at), np.subtract(pose.position, pose.look_at)
    turns = [
        Rotation.from_euler("yx", (yaw, pitch), degrees=True)
        for yaw in range(-180, 180, _TURN)
        for pitch in range(-_PITCH, _PITCH + 1, _TURN)
    ]
    for turn in sorted(turns, key=Rotation.magnitude):
        turned = turn.apply(away)
        if _is_free(target, turned, obstacles):
            return replace(pose, position=_vector(target + turned))
    return pose


def _is_free(target: Float[np.ndarray, "3"], away: Float[np.ndarray, "3"], obstacles: Float[np.ndarray, "n 3"]) -> bool:
    """Whether nothing is around the camera, or between it and the surroundings of the point that it looks at."""
    distance = float(np.linalg.norm(away))
    moved = obstacles - target
    along = moved @ (away / distance)
    across = np.linalg.norm(moved - np.outer(along, away / distance), axis=1)
    between = (along > _AROUND) & (along < distance) & (across < _BEAM)
    return not between.any() and not (np.linalg.norm(moved - away, axis=1) < _FREE).any()


def space_pose(bounds: Float[np.ndarray, "2 3"], window: Window) -> Pose:
    """Looks at bodies in a bounding box (least and greatest coordinates), from an oblique angle."""
    middle = bounds.mean(0)  # the centre of rotation
    # A window higher than wide needs a greater distance.
    distance = _BODY_DISTANCE * math.dist(bounds[0], bounds[1]) * max(1.0, window.height / window.width)
    position = middle + np.array(_BODY_FROM) / np.linalg.norm(_BODY_FROM) * distance
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
