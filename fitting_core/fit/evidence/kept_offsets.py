"""Offsets that last over a clip, from what a person stated in a few of its frames: depths, and places in the picture.

Half of the error of the lifter's points, and part of the detector's, is the same in all frames, in the body's own axes:
it turns with the person.
"""

from collections.abc import Collection

import numpy as np
from jaxtyping import Float, Int

from fitting_core import keypoints as kp
from fitting_core.body.geometry import unit
from fitting_core.keypoints import KeptOffset, Keypoints

STATED = 0.02
"""Standard deviation in metres of a depth set by a person, the precision of a view from the side; and of a place."""
_LASTING = 2 / 3
"""Share of the lifter's variance that is the same in all frames."""
_DETECTED, _DETECTED_LASTING = 0.02, 0.015
"""Standard deviations in metres of a detection's error in one frame, and of the part that is the same in all frames."""
_FARTHEST = 0.08
"""Metres beyond which a detection is wrong in its frame alone."""
_NEAR = 15
"""Frames at most this far apart have the same error, and count as one."""
_EXPECTED = 2.0
"""Number of frames for which the spread that the deviation lets expect counts beside the one found."""
_NECK, _MIDDLE, _LEFT, _RIGHT = (kp.INDEX[name] for name in ("neck", "mid_hip", "left_hip", "right_hip"))


def with_kept(
    kept: Collection[KeptOffset], points: Float[np.ndarray, "T 25 3"], deviation: Float[np.ndarray, "T 25"]
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
        deviation: standard deviation of their z, metres; infinite where unknown.
    """
    moved, deviations = points.copy(), np.repeat(deviation[..., None], 3, axis=-1)
    axes = _trunk_axes(points) if kept else None
    for one in kept:
        if axes is None or not one.depths:
            continue
        k, frames = one.keypoint, np.array(one.frames)
        at = np.array([frame for frame in sorted(one.depths) if np.isfinite(deviation[frame, k])], int)
        if not len(at):
            continue
        gap = np.array([one.depths[frame] for frame in at.tolist()]) - points[at, k, 2]
        variance = deviation[at, k] ** 2
        noise = (1 - _LASTING) * variance + STATED**2
        offset, covariance = _offset(axes[at, 2:], gap[:, None], noise, _LASTING * variance.mean(), at)
        turned = axes[frames]
        moved[frames, k] = points[frames, k] + turned @ offset
        own = np.einsum("tij,jk,tik->ti", turned, covariance, turned)
        deviations[frames, k] = np.sqrt(own + (1 - _LASTING) * deviation[frames, k, None] ** 2)
    return moved, deviations


def kept_places(keypoints: Keypoints, points: Float[np.ndarray, "T 25 3"]) -> Float[np.ndarray, "T 137 2"]:
    """Pixels by which detections move for the offsets of their places that a person keeps.

    As `with_kept` does for depths, from x and y; a place counts in metres by the size of the lifter's points in the
    picture. Keypoints that a person placed stay there.

    Args:
        keypoints: unswapped.
        points: the lifter's, relative to the pelvis, metres in camera axes.
    """
    moved = np.zeros(keypoints.xy.shape)
    if not any(one.shifts for one in keypoints.kept):
        return moved
    axes, scale = _trunk_axes(points), _pixels_per_metre(keypoints, points)
    for one in keypoints.kept:
        at = np.array(sorted(one.shifts), int)
        gap = np.array([one.shifts[frame] for frame in at.tolist()]).reshape(-1, 2) / scale[at, None]
        near = np.linalg.norm(gap, axis=1) < _FARTHEST
        if near.any():
            noise = np.full(near.sum(), _DETECTED**2 + STATED**2)
            offset, _ = _offset(axes[at[near], :2], gap[near], noise, _DETECTED_LASTING**2, at[near])
            frames = list(one.frames)
            moved[frames, one.keypoint] = axes[frames, :2] @ offset * scale[frames, None]
    return np.where(keypoints.placed[..., None], 0.0, moved)


def _offset(
    axes: Float[np.ndarray, "n axes 3"],
    gap: Float[np.ndarray, "n axes"],
    noise: Float[np.ndarray, "n"],
    lasting: float,
    frames: Int[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """The offset and its covariance.

    Args:
        axes: some of the camera's axes in the trunk's, for each frame in which something is stated.
        gap: metres along these from the estimate to what is stated.
        noise: variance of an estimate in one frame.
        lasting: variance of the offset along each axis.
        frames: which ones these are.
    """
    count = axes.shape[1]
    same = (abs(frames[:, None] - frames) <= _NEAR).sum(1)
    variance = np.repeat(same * noise, count)
    rows, apart = axes.reshape(-1, 3), gap.ravel()

    def solved(variance: Float[np.ndarray, "m"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        covariance = np.linalg.inv(np.eye(3) / lasting + (rows.T / variance) @ rows)
        return covariance @ (rows.T / variance) @ apart, covariance

    spread = ((apart - rows @ solved(variance)[0]) ** 2 / variance).sum()
    return solved(variance * (_EXPECTED + spread) / (_EXPECTED + count * (1 / same).sum()))


def _pixels_per_metre(keypoints: Keypoints, points: Float[np.ndarray, "T 25 3"]) -> Float[np.ndarray, "T"]:
    """Scale of the lifter's points in the picture, fitted to the detected keypoints; 1e-6 without any."""
    detected = (keypoints.confidence[:, kp.BODY, None] > 0).astype(float)
    count = np.maximum(detected.sum(1, keepdims=True), 1)
    xy, across = (
        detected * (a - (detected * a).sum(1, keepdims=True) / count)
        for a in (keypoints.xy[:, kp.BODY], points[..., :2])
    )
    return np.maximum((xy * across).sum((1, 2)), 1e-6) / np.maximum((across**2).sum((1, 2)), 1e-6)


def _trunk_axes(points: Float[np.ndarray, "T 25 3"]) -> Float[np.ndarray, "T 3 3"]:
    """Camera axes from the body's: to its left, up the trunk, ahead."""
    up = unit(points[:, _NECK] - points[:, _MIDDLE])
    left = points[:, _LEFT] - points[:, _RIGHT]
    left = unit(left - (left * up).sum(1, keepdims=True) * up)
    return np.stack([left, up, np.cross(left, up)], axis=-1)
