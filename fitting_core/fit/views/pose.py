"""Relative pose and offset in time of two views, from their viewing rays."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from fitting_core import keypoints as kp
from fitting_core.fit.views.track import Track

NOISE = 0.016
"""Standard deviation of a keypoint across its viewing ray, metres (`keypoint_noise`)."""
_RHO, _LIFTED_RHO = 2.5, 2.0
"""Standard deviations at which the Geman-McClure function saturates, of rays and of the lifter's depths."""
_LIFTED = 0.3
"""Weight of the lifter's depths relative to that of the rays. Without them a long lens leaves the rotation free, which
was then 6 to 38 degrees off."""
_FRAMES = 300
"""Frames of the first clip that are used, at most."""
_LEAST = (8, 80)
"""Frames and keypoints that both views show, at least."""
_INDEPENDENT = 0.3
"""Seconds over which a detector's errors last: frames of that time count as one for the deviations."""
SHOWN = 0.1
"""Weight above which a smoothed keypoint counts as shown."""
_STEPS = (0.02, 0.02, 0.02, 0.02, 0.02, 0.01)
"""Of the solver: radians, and seconds."""
_LIMBS = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")
LIMB_BONES = np.array(
    [
        [kp.INDEX[f"{side}_{name}"] for name in bone]
        for side in ("left", "right")
        for limb in _LIMBS
        for bone in pairwise(limb)
    ]
)
"""Pairs of keypoints."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """Of the other camera."""

    rotation: Float[np.ndarray, "3 3"]
    direction: Float[np.ndarray, "3"]
    """Of the translation, a unit vector."""
    distance: float
    """Length of the translation in metres, if the person is as tall as the average adult."""
    likely_distance: float
    """The same by where the lifter places the person in either view."""
    offset: float
    """Seconds."""
    cost: float
    """Mean squared error in standard deviations."""
    deviations: Float[np.ndarray, "3"]
    """Of rotation and direction in degrees, and of the offset in seconds."""

    def apart_from(self, other: "Pose") -> tuple[float, float, float]:
        """Degrees between the rotations and between the directions, and seconds between the offsets."""
        turn = Rotation.from_matrix(self.rotation @ other.rotation.T).magnitude()
        way = np.arccos(np.clip(self.direction @ other.direction, -1.0, 1.0))
        return float(np.degrees(turn)), float(np.degrees(way)), abs(self.offset - other.offset)


def misses(
    first: Float[np.ndarray, "*n 3"],
    other: Float[np.ndarray, "*n 3"],
    rotation: Float[np.ndarray, "3 3"],
    direction: Float[np.ndarray, "3"],
    noise: tuple[float, float],
) -> Float[np.ndarray, "*n"]:
    """How far two rays of a point miss each other, in standard deviations (P. Sampson, CGIP 18, 1982).

    Rays d and d' of a point lie in a plane with the baseline t: d' . (t x R d) = 0.

    Args:
        first: Unit vectors in the first camera's axes.
        other: In the other's.
        rotation: R.
        direction: t, a unit vector.
        noise: Of the rays of either view, radians.
    """
    one, two = np.cross(direction, first @ rotation.T), np.cross(direction, other)
    spread = noise[1] ** 2 * (one * one).sum(-1) + noise[0] ** 2 * (two * two).sum(-1)
    return (other * one).sum(-1) / np.sqrt(spread + 1e-9 * noise[0] ** 2)


def meeting(
    first: Float[np.ndarray, "*n 3"], other: Float[np.ndarray, "*n 3"], place: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "*n 3"]:
    """Points halfway between two rays, where they are nearest to each other.

    Args:
        first: Unit vectors of rays from the origin.
        other: Of rays from `place`, in the same axes.
        place: Of the other camera.
    """
    along, p, q = (first * other).sum(-1), first @ place, other @ place
    apart = np.maximum(1 - along * along, 1e-4)
    one, two = (p - along * q) / apart, (along * p - q) / apart
    return (one[..., None] * first + two[..., None] * other + place) / 2


def bone_lengths(points: Float[np.ndarray, "T 25 3"]) -> Float[np.ndarray, "T bones"]:
    """Of LIMB_BONES."""
    return np.linalg.norm(points[:, LIMB_BONES[:, 0]] - points[:, LIMB_BONES[:, 1]], axis=-1)


class PairOfRays:
    """The rays of two views around an offset in time, with a relative pose to start from.

    Args:
        first: The first view.
        other: The other one.
        rotation: Of the first camera's axes into the other's.
        offset: Seconds.
    """

    def __init__(self, first: Track, other: Track, rotation: Float[np.ndarray, "3 3"], offset: float) -> None:
        self.first, self.other, self.rotation, self.offset = first, other, rotation, offset
        self.noise = (NOISE / first.distance, NOISE / other.distance)
        shown = np.flatnonzero((first.times + offset > 0) & (first.times + offset < other.duration))
        shown = shown[:: max(1, -(-len(shown) // _FRAMES))]
        self.times = first.times[shown]
        self.rays, self.weights = first.smoothed_at(self.times)
        self.points, self.spread = first.lifted_at(self.times)
        there, here = other.nearest(self.times + offset), first.nearest(self.times)
        moved = other.pelvis[there] - first.pelvis[here] @ rotation.T
        way = np.median(moved, axis=0) if len(moved) else np.array([1.0, 0.0, 0.0])
        self.distance = max(float(np.linalg.norm(way)), 1e-9)
        self.direction = way / self.distance
        self._across = np.linalg.svd(self.direction[None])[2][1:]

    @property
    def enough(self) -> bool:
        """Whether both views show enough at the same times."""
        both = np.minimum(self.weights, self.other.smoothed_at(self.times + self.offset)[1])
        return len(self.times) >= _LEAST[0] and int((both > SHOWN).sum()) >= _LEAST[1]

    def refined(self) -> Pose:
        """The pose in which rays meet best, and depths of keypoints are most like the lifter's in both views."""
        from scipy.optimize import least_squares  # the app need not wait for it

        found = least_squares(self._residuals, np.zeros(6), method="lm", x_scale=_STEPS, max_nfev=200)
        rotation, direction, offset = self._unpacked(found.x)
        step = float(np.median(np.diff(self.times)))
        independent = max(1.0, self.weights.shape[1] * len(self.times) * min(1.0, step / _INDEPENDENT))
        cost = 2 * float(found.cost)
        covariance = np.linalg.pinv(found.jac.T @ found.jac) * max(cost, 1.0) / independent
        turn, way, late = np.split(np.diag(covariance).clip(0), [3, 5])
        return Pose(
            rotation=rotation,
            direction=direction,
            distance=self._compared(found.x)[2],
            likely_distance=self.distance,
            offset=offset,
            cost=cost,
            deviations=np.array([*np.degrees(np.sqrt([turn.sum(), way.sum()])), np.sqrt(late[0])]),
        )

    def _unpacked(self, x: Float[np.ndarray, "6"]) -> tuple[np.ndarray, np.ndarray, float]:
        way = self.direction + x[3:5] @ self._across
        turn = Rotation.from_rotvec(x[:3]).as_matrix() @ self.rotation
        return turn, way / np.linalg.norm(way), float(self.offset + x[5])

    def _residuals(self, x: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n"]:
        miss, depth, _, weights = self._compared(x)
        share = np.sqrt(weights / max(float(weights.sum()), 1e-9))
        rays = share * _RHO * miss / np.sqrt(miss**2 + _RHO**2)
        depths = share[..., None] * _LIFTED_RHO * depth / np.sqrt(depth**2 + _LIFTED_RHO**2)
        return np.concatenate([rays.ravel(), np.sqrt(_LIFTED / 2) * depths.ravel()])

    def _compared(self, x: Float[np.ndarray, "6"]) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
        """By how many deviations rays miss and depths differ; metres per unit of the direction; weights."""
        rotation, direction, offset = self._unpacked(x)
        others, sure = self.other.smoothed_at(self.times + offset)
        points, spread = self.other.lifted_at(self.times + offset)
        weights = self.weights * sure
        met = meeting(self.rays, others @ rotation, -direction @ rotation)
        limbs = weights[:, LIMB_BONES].min(-1)
        lifted = (bone_lengths(self.points) + bone_lengths(points)) / 2
        metres = float((limbs * lifted).sum() / max(float((limbs * bone_lengths(met)).sum()), 1e-9))
        seen = metres * np.stack([met[..., 2], met @ rotation[2]], -1)
        expected = np.stack([self.points[..., 2], points[..., 2]], -1)
        deviation = np.stack([self.spread, spread], -1)
        trust = weights[..., None] / deviation**2
        middle = (trust * (seen - expected)).sum(1, keepdims=True) / np.maximum(trust.sum(1, keepdims=True), 1e-9)
        depths = (seen - expected - middle) / deviation
        return misses(self.rays, others, rotation, direction, self.noise), depths, metres, weights


def alike(first: Track, other: Track, pose: Pose) -> tuple[float, float, float]:
    """How alike both views move: the correlation of the angles of viewing rays about the baseline.

    They are the same in both views of one motion. Differences from each keypoint's mean and from each frame's count, so
    that neither how a person stands nor a walk through the picture does.

    Returns:
        The correlation; the standard deviations of both angles, in units of the rays' noise.
    """
    times = first.times
    rays, weights = first.smoothed_at(times)
    others, sure = other.smoothed_at(times + pose.offset)
    there = np.minimum(weights, sure) > SHOWN
    if there.sum() < _LEAST[1]:
        return 0.0, 0.0, 0.0
    across, about = np.linalg.svd(pose.direction[None])[2][1:], rays @ pose.rotation.T
    ahead = across @ about[there].mean(0) @ across
    ahead /= np.linalg.norm(ahead)
    aside = np.cross(pose.direction, ahead)
    found = [_moving(np.arctan2(r @ aside, r @ ahead), there) for r in (about, others)]
    one, two = (np.sqrt(np.mean(angle[there] ** 2)) for angle in found)
    product = float(np.mean(found[0][there] * found[1][there]))
    noise = np.array([NOISE / first.distance, NOISE / other.distance])
    return product / max(float(one * two), 1e-12), float(one / noise[0]), float(two / noise[1])


def _moving(angles: Float[np.ndarray, "T n"], there: Bool[np.ndarray, "T n"]) -> Float[np.ndarray, "T n"]:
    """Differences from the means of frames and of keypoints, where these are there."""
    found = np.where(there, angles, 0.0)
    for _ in range(5):
        for axis in (0, 1):
            mean = found.sum(axis, keepdims=True) / np.maximum(there.sum(axis, keepdims=True), 1)
            found = np.where(there, found - mean, 0.0)
    return found
