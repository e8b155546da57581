"""The side view: the picture's bodies seen from the side, upright and without perspective, on a plate of the poster
world (see poster.py). Arithmetic, no viser.

The scale and the plate's centre are fixed for the whole clip: the ground and its ticks do not move, and a step towards
the camera is visible. Only a body that would leave the plate shifts the view.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera
from tcfit_app.review.scene.layers import NEAREST
from tcfit_app.review.scene.room import Room, extent

Direction = Literal["left", "right", "top"]
"""Where the viewer is: left or right of the picture, or above."""
DIRECTION_TEXTS: dict[Direction, str] = {
    "left": "from the left",
    "right": "from the right",
    "top": "from above",
}
_AXES: dict[Direction, Float[np.ndarray, "3 3"]] = {
    "left": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    "right": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    "top": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),  # up on the plate is ahead
}
"""Right, down and away for a viewer: rows, unit vectors in level space."""
_CUT = 0.15
"""Fraction of a body's height outside the picture above which it counts as cut off."""
_FREE = 0.05
"""Margin on each side, relative to the plate's height and width, that bodies usually do not enter."""


def usual_width(pictures: float) -> float:
    """Width of a plate beside pictures of this total width, in image heights: narrower for wide pictures."""
    return min(max(1.75 - pictures, 0.5), 0.9)


@dataclass(frozen=True, kw_only=True, eq=False)
class SideView:
    """Maps camera space to a plate in the poster world whose centre is the origin: x right, y down, image heights."""

    axes: Float[np.ndarray, "3 3"]
    """Right, down and away on the plate: rows, unit vectors in camera space."""
    middle: Float[np.ndarray, "2"]
    """The point at the plate's centre: metres right and down of the camera."""
    scale: float
    """Image heights per metre."""
    width: float
    """Size of the plate, in image heights."""
    floor: float | None
    """Metres along down; None from above."""
    turn: Float[np.ndarray, "3 3"]
    """The room's."""
    ground: float
    """y of the room's floor in level space."""

    def before(self, camera: Camera, frame: int) -> "SideView":
        """The same plate relative to the camera space of a frame; derived from still space if the camera moves."""
        if camera.path is None:
            return self
        turn, place = camera.path.to_still[frame], camera.path.places[frame]
        return replace(
            self,
            axes=self.axes @ turn,
            middle=self.middle - self.axes[:2] @ place,
            floor=None if self.floor is None else self.floor - float(self.axes[1] @ place),
            turn=self.turn @ turn,
            ground=self.ground - float(self.turn[1] @ place),
        )

    @property
    def half(self) -> Float[np.ndarray, "2"]:
        """Half the plate's width and height."""
        return np.array([self.width, 1.0]) / 2

    def flat(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """Plate positions of points in camera space, before any shift."""
        return (points @ self.axes[:2].T - self.middle) * self.scale

    def shifts(self, bodies: Sequence[Float[np.ndarray, "V 3"]]) -> Float[np.ndarray, "n 2"]:
        """Shifts that bring each body onto the plate: the same for all, if they fit together.

        Only sideways if there is a floor.
        """
        if not bodies:
            return np.zeros((0, 2))
        flat = [self.flat(vertices) for vertices in bodies]
        found = np.array([(points.min(0), points.max(0)) for points in flat])
        together = _onto(np.stack([found[:, 0].min(0), found[:, 1].max(0)]), self.half)
        shifts = np.array([together + _onto(box + together, self.half) for box in found])
        return shifts if self.floor is None else shifts * [1.0, 0.0]

    def relief(
        self, bodies: Sequence[Float[np.ndarray, "V 3"]], shifts: Float[np.ndarray, "n 2"]
    ) -> list[Float[np.ndarray, "V 3"]]:
        """Vertices of bodies that occlude each other, the farthest at z = 0; parts outside go to the plate's edge."""
        if not bodies:
            return []
        away = [vertices @ self.axes[2] for vertices in bodies]
        furthest = max(float(depth.max()) for depth in away)
        out = []
        for vertices, depth, shift in zip(bodies, away, shifts, strict=True):
            flat = np.clip(self.flat(vertices) + shift, -self.half, self.half)
            out.append(np.hstack([flat, self.scale * (depth - furthest)[:, None]]).astype(np.float32))
        return out

    def pixels(
        self, points: Float[np.ndarray, "*n 3"], shift: Float[np.ndarray, "2"], height: int
    ) -> Float[np.ndarray, "*n 2"]:
        """Points of camera space in pixels of a plate of this height, from its upper left corner."""
        return (self.flat(points) + shift + self.half) * height

    def sight(self, camera: Camera, height: int) -> Float[np.ndarray, "2 3"]:
        """Maps the picture's pixels (u, v, 1) to the direction of their viewing ray on the plate, pixels per metre of
        depth."""
        inverse = np.linalg.inv(
            [[camera.focal[0], 0.0, camera.center[0]], [0.0, camera.focal[1], camera.center[1]], [0.0, 0.0, 1.0]]
        )
        return self.plate(height) @ inverse

    def plate(self, height: int) -> Float[np.ndarray, "2 3"]:
        """Maps camera space, metres, to pixels of a plate of this height, up to the origin's position."""
        return height * self.scale * self.axes[:2]

    def heights(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Heights above the floor of points in camera space, metres."""
        return self.ground - points @ self.turn[1]


def _onto(box: Float[np.ndarray, "2 2"], half: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    """The smallest shift that moves a box onto a plate; to its centre if it is too large."""
    least, most = -half - box[0], half - box[1]
    return np.where(least > most, (least + most) / 2, np.clip(0.0, least, most))


def side_view(room: Room, camera: Camera, direction: Direction, width: float) -> SideView:
    """How a room is seen from a direction.

    The body has the height and vertical position that it usually has in the picture. It is smaller if the whole body
    does not fit on the plate; but legs cut off by the picture are cut off by the plate too.

    Args:
        room: The clip's.
        camera: The fit's.
        direction: Where the viewer is.
        width: Of the plate, in image heights.
    """
    axes, above = _AXES[direction], direction == "top"
    middles, halves = room.boxes.mean(1) @ axes.T, np.diff(room.boxes, axis=1)[:, 0] / 2 @ np.abs(axes).T
    seen = extent(np.stack([middles - halves, middles + halves], 1))[:, :2]
    if not above:
        seen[1, 1] = max(seen[1, 1], room.floor)
    usual = np.median(room.boxes.mean(1), axis=0) @ room.turn  # in camera space
    depth = max(float(usual[2]), NEAREST)
    in_picture = camera.focal[1] / camera.size[1] / depth
    height = 0.0 if above else (camera.focal[1] * usual[1] / depth + camera.center[1]) / camera.size[1] - 0.5
    middle = np.median(middles[:, :2], axis=0) - np.array([0.0, height / in_picture])
    free = np.array([width, 1.0]) * (1 - 2 * _FREE)
    tall = seen[1, 1] - seen[0, 1]
    beyond = abs(seen[:, 1] - middle[1]).max() - 0.5 / in_picture
    cut = not above and beyond > _CUT * tall
    # From above the view may follow in both directions, otherwise only sideways, so that the floor stays put.
    widest = np.percentile(2 * halves[:, :2], 98, axis=0)
    needed = np.maximum([widest[0], widest[1] if above else 0.0 if cut else tall], 1e-3)
    scale = min(in_picture, *(free / needed))
    middle[1] += height / in_picture - height / scale
    on_plate = np.sort(seen[::-1] + free / 2 / scale * [[-1.0], [1.0]], axis=0)
    middle = np.where([True, not cut], np.clip(middle, *on_plate), middle)
    return SideView(
        axes=axes @ room.turn,
        middle=middle,
        scale=float(scale),
        width=width,
        floor=None if above else room.floor,
        turn=room.turn,
        ground=room.floor,
    )
