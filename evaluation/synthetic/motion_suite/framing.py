"""Where the suite's cameras stand: direction and lens are given, the way back follows from what the image shows."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from evaluation.synthetic.studio.view import View
from fitting_core.camera import Camera, focal_from_35mm
from fitting_core.keypoints import INDEX

CUTS = ("whole", "knee", "hip", "chest")
"""Where the image's lower edge goes through the person."""
_EDGE_BETWEEN: dict[str, tuple[tuple[str, ...], tuple[str, ...], float]] = {
    "knee": (("left_knee", "right_knee"), ("left_ankle", "right_ankle"), 0.2),
    "hip": (("left_hip", "right_hip"), ("left_knee", "right_knee"), 0.25),
    "chest": (("neck",), ("mid_hip",), 0.5),
}
"""By cut: the edge lies between the first points and the second, at that part of the way."""
_SHOWN_WHEN_CUT = (
    "neck",
    "nose",
    "left_ear",
    "right_ear",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
)
"""What the image's sides and upper edge leave in it, nearly always."""
_NEAREST = 1.2
"""Metres from the camera to the body's nearest keypoint, at least: who would have to come nearer is shown smaller."""
_MARGIN = 0.07
"""Of the image's height, above the head and below the feet; twice that at the sides together."""
_ROUNDS = 12


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A camera as it is wished for."""

    azimuth: float
    """Degrees from the front to the person's left."""
    elevation: float
    """Degrees that the camera stands above what it looks at."""
    lens: float
    """Focal length, millimetres on 35 mm film."""
    size: tuple[int, int]
    cut: str
    """One of CUTS."""
    aside: float
    """Where the person's middle is, of the image's width right of its middle."""

    @property
    def camera(self) -> Camera:
        """With the principal point in the image's middle."""
        focal, (width, height) = focal_from_35mm(self.lens, self.size), self.size
        return Camera(
            focal=(focal, focal), center=(width / 2, height / 2), size=self.size, source="the suite's own camera"
        )


def view_of(shot: Shot, points: Float[np.ndarray, "T 137 3"]) -> View:
    """Where the camera has to stand, so that the person fills the image.

    The distance and the point looked at are improved in turn: each round the image is scaled and moved as if it were
    flat.

    Args:
        shot: What is wished.
        points: BODY_25 keypoints in the world (others are ignored), metres.
    """
    body = points[:, :25]
    target, distance = body.mean((0, 1)), 5.0
    width, height = shot.size
    focal = shot.camera.focal[0]
    whole = shot.cut == "whole"
    lowest = height * (1 - _MARGIN) if whole else height
    for _ in range(_ROUNDS):
        pose = _view(shot, target, distance).pose()
        placed = pose(body)
        depth, nearest = float(np.median(placed[..., 2])), float(placed[..., 2].min())
        xy = placed[..., :2] / placed[..., 2:].clip(0.2) * focal + (width / 2, height / 2)
        top, bottom, left, right = _extent(shot.cut, xy)
        tall = (bottom - top) / (lowest - _MARGIN * height)
        larger = max(tall, (right - left) / ((1 - 2 * _MARGIN - 2 * abs(shot.aside)) * width))
        # Whole people stand in the middle of the room that is left; of others the lower edge is what counts.
        down = (top + bottom - height) / 2 if whole else bottom - lowest
        sideways = (left + right) / 2 - width * (0.5 + shot.aside)
        target = target + (sideways * pose.rotation[0] + down * pose.rotation[1]) * depth / focal
        distance = max(distance + depth * (larger - 1), distance + _NEAREST - nearest)
    return _view(shot, target, distance)


def _view(shot: Shot, target: Float[np.ndarray, "3"], distance: float) -> View:
    """The camera in the shot's direction from what it looks at, so far away."""
    angle, flat = np.radians(shot.azimuth), distance * np.cos(np.radians(shot.elevation))
    x, y, z = (float(value) for value in target)
    # A View stands about the line x = 0; what it looks at may lie beside that.
    place = np.array([x + flat * np.sin(angle), z + flat * np.cos(angle)])
    azimuth = float(np.degrees(np.arctan2(place[0], place[1] - z)))
    return View(
        azimuth=azimuth,
        height=y + distance * float(np.sin(np.radians(shot.elevation))),
        distance=float(np.hypot(place[0], place[1] - z)),
        looking_at=(x, y, z),
    )


def _extent(cut: str, xy: Float[np.ndarray, "T 25 2"]) -> tuple[float, float, float, float]:
    """Top, bottom, left and right of what is to be shown, pixels; the top of a head lies above its keypoints."""
    eyes = xy[:, [INDEX["left_ear"], INDEX["right_ear"], INDEX["nose"]]].mean(1)
    crown = eyes + 0.45 * (eyes - xy[:, INDEX["neck"]])
    if cut == "whole":
        points = np.concatenate([xy, crown[:, None]], 1)
        (left, top), (right, bottom) = points.min((0, 1)), points.max((0, 1))
        return float(top), float(bottom), float(left), float(right)
    upper, lower, part = _EDGE_BETWEEN[cut]
    one, two = (xy[:, _indices(names), 1].mean(1) for names in (upper, lower))
    trunk = np.concatenate([xy[:, _indices(_SHOWN_WHEN_CUT)], crown[:, None]], 1)
    (left, top), (right, _) = np.percentile(trunk, 4, axis=(0, 1)), np.percentile(trunk, 96, axis=(0, 1))
    return float(top), float(np.median(one + part * (two - one))), float(left), float(right)


def _indices(names: tuple[str, ...]) -> list[int]:
    return [INDEX[name] for name in names]
