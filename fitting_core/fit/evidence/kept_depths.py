"""Offsets of the lifter's points that last over a clip, from depths that a person stated in a few of its frames.

Half of the lifter's error is the same in all frames, in the body's own axes: it turns with the person.
"""

from collections.abc import Collection

import numpy as np
from jaxtyping import Float, Int

from fitting_core import keypoints as kp
from fitting_core.body.geometry import unit
from fitting_core.keypoints import KeptDepth

STATED = 0.02
"""Standard deviation in metres of a depth set by a person: the precision of a view from the side."""
_LASTING = 2 / 3
"""Share of the lifter's variance that is the same in all frames."""
_NEAR = 15
"""Frames at most this far apart have the same error, and count as one."""
_EXPECTED = 2.0
"""Number of frames for which the spread that the lifter's deviation lets expect counts beside the one found."""
_NECK, _MIDDLE, _LEFT, _RIGHT = (kp.INDEX[name] for name in ("neck", "mid_hip", "left_hip", "right_hip"))


def with_kept(
    kept: Collection[KeptDepth], points: Float[np.ndarray, "T 25 3"], deviation: Float[np.ndarray, "T 25"]
) -> tuple[Float[np.ndarray, "T 25 3"], Float[np.ndarray, "T 25 3"]]:
    """The lifter's points with the offsets that a person keeps, and their standard deviations along each axis.

    The depth z of a point at p is stated in frames s: z_s - p_z = (B_s d)_z + noise, with the trunk's axes B and the
    offset d. Before, d has the lasting part of the lifter's variance v along each axis, and the noise has the rest of
    v, scaled by the spread that is found. The normal equations give d and its covariance C; in every frame the point is
    p + B d, and its covariance B C B^T and the rest of v. One frame thus counts for less than several, and along axes
    that no stated depth constrains, nothing changes.

    Args:
        kept: the later of two holds where both do.
        points: relative to the pelvis, metres in camera axes.
        deviation: standard deviation of their z, metres.
    """
    moved, deviations = points.copy(), np.repeat(deviation[..., None], 3, axis=-1)
    if not kept:
        return moved, deviations
    axes = _trunk_axes(points)
    for one in kept:
        k, frames, at = one.keypoint, np.array(one.frames), np.array(sorted(one.depths))
        gap = np.array([one.depths[frame] for frame in at.tolist()]) - points[at, k, 2]
        offset, covariance = _offset(axes[at, 2], gap, deviation[at, k] ** 2, at)
        turned = axes[frames]
        moved[frames, k] = points[frames, k] + turned @ offset
        own = np.einsum("tij,jk,tik->ti", turned, covariance, turned)
        deviations[frames, k] = np.sqrt(own + (1 - _LASTING) * deviation[frames, k, None] ** 2)
    return moved, deviations


def _offset(
    ahead: Float[np.ndarray, "n 3"],
    gap: Float[np.ndarray, "n"],
    variance: Float[np.ndarray, "n"],
    frames: Int[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """The offset and its covariance.

    Args:
        ahead: the camera's z in the trunk's axes, for each frame in which a depth is stated.
        gap: metres by which it is behind the lifter's.
        variance: of the lifter's.
        frames: which ones these are.
    """
    same = (abs(frames[:, None] - frames) <= _NEAR).sum(1)
    noise = same * ((1 - _LASTING) * variance + STATED**2)
    before = np.eye(3) / (_LASTING * variance.mean())

    def solved(noise: Float[np.ndarray, "n"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        covariance = np.linalg.inv(before + (ahead.T / noise) @ ahead)
        return covariance @ (ahead.T / noise) @ gap, covariance

    spread = ((gap - ahead @ solved(noise)[0]) ** 2 / noise).sum()
    return solved(noise * (_EXPECTED + spread) / (_EXPECTED + (1 / same).sum()))


def _trunk_axes(points: Float[np.ndarray, "T 25 3"]) -> Float[np.ndarray, "T 3 3"]:
    """Camera axes from the body's: to its left, up the trunk, ahead."""
    up = unit(points[:, _NECK] - points[:, _MIDDLE])
    left = points[:, _LEFT] - points[:, _RIGHT]
    left = unit(left - (left * up).sum(1, keepdims=True) * up)
    return np.stack([left, up, np.cross(left, up)], axis=-1)
