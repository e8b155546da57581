"""The face's contour (iBUG's points 0 to 16) as a viewer sees it, for each degree of the head's yaw."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from fitting_core.body.geometry import MIRROR

MAX_YAW = 39
POINTS = 17
_CHIN = 8
_SUBDIVISIONS = 4  # samples per triangle edge
_RAY_WIDTH = np.radians(1.2)
_SOFTNESS = 1e-3  # metres: points of the skin this near to the outermost one share in it
_SMOOTHING = 3.5  # degrees of yaw


@dataclass(frozen=True, kw_only=True, eq=False)
class _Samples:
    """Points spread over the skin that the contour can run on."""

    points: Float[np.ndarray, "P 3"]
    angles: Float[np.ndarray, "P"]
    """Below the eyes' height, seen from the front from between the eyes; radians, 0 to the body's left, pi right."""
    between_eyes: float
    """Height of the eyes, in metres."""


def contour_points(skin: Float[np.ndarray, "F 3 3"], eye_height: float) -> Float[np.ndarray, "79 17 3"]:
    """The contour in the frame of the unturned head, in metres.

    For each of 17 directions from between the eyes, it is the point of the skin that lies furthest out in the image
    of the turned head; then smoothed over yaw, since a contour that jumps pulls a fit to and fro.

    Args:
        skin: triangles of the face in front of the ears, without the neck.
        eye_height: y of the middle of the eyes.

    Returns:
        By SMPL-X's bins (0..39: yaw of 0..-39 degrees; 40..78: yaw of 1..39 degrees), points 0 (the body's right
        temple) over 8 (chin) to 16. They may lie a little inside the skin.
    """
    samples = _samples(skin, eye_height)
    directions = _directions(samples)
    one_side = np.stack([_outermost(samples, directions, np.radians(-yaw)) for yaw in range(MAX_YAW + 1)])
    # The head is symmetric: turned the other way it shows the mirror image, in the other order.
    other_side = one_side[:, ::-1] * MIRROR
    front = (one_side[:1] + other_side[:1]) / 2
    by_yaw = np.concatenate([other_side[:0:-1], front, one_side[1:]])
    by_yaw = gaussian_filter1d(by_yaw, _SMOOTHING, axis=0, mode="nearest")
    return np.concatenate([by_yaw[MAX_YAW:], by_yaw[MAX_YAW - 1 :: -1]])


def contour_skin(
    centres: Float[np.ndarray, "Q 3"], on_neck: Bool[np.ndarray, "Q"], eyes: float, ear_front: float
) -> Bool[np.ndarray, "Q"]:
    """Which parts of the head's skin the contour can run on: below the eyes' level and in front of the ears."""
    return ~on_neck & (centres[:, 1] < eyes + 0.02) & (centres[:, 2] > ear_front - 0.002)


def _samples(skin: Float[np.ndarray, "F 3 3"], eye_height: float) -> _Samples:
    n = _SUBDIVISIONS
    weights = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    points = np.einsum("bk,fkd->fbd", weights, skin).reshape(-1, 3)
    angles = np.arctan2(eye_height - points[:, 1], points[:, 0])
    return _Samples(points=points, angles=angles, between_eyes=eye_height)


def _directions(samples: _Samples) -> Float[np.ndarray, "17"]:
    """Angles at which the frontal outline is cut into 16 pieces of the same length."""
    half = np.linspace(0, np.pi / 2, 91)
    outline = _outermost(samples, half, 0.0)[:, :2]
    outline[-1, 0] = 0.0
    outline = gaussian_filter1d(outline, 2, axis=0, mode="nearest")
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    left = np.interp(np.linspace(0, length[-1], _CHIN + 1), length, half)
    return np.concatenate([np.pi - left, left[-2::-1]])


def _outermost(samples: _Samples, directions: Float[np.ndarray, "n"], yaw: float) -> Float[np.ndarray, "n 3"]:
    """The skin's outermost points in given directions in the image of a head that is turned by `yaw` (radians)."""
    across = samples.points @ [np.cos(yaw), 0, np.sin(yaw)]
    down = samples.between_eyes - samples.points[:, 1]
    points = np.zeros((len(directions), 3))
    for i, direction in enumerate(directions):
        reach = np.cos(direction) * across + np.sin(direction) * down
        off = (samples.angles - direction) / _RAY_WIDTH
        near = np.abs(off) < 3
        score = (reach[near] - reach[near].max()) / _SOFTNESS - off[near] ** 2 / 2
        weight = np.exp(score - score.max())
        points[i] = weight @ samples.points[near] / weight.sum()
    return points
