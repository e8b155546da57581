"""Where a limb goes when it is flipped in depth about its root, with the same image: the values of `SetDepth`.

Depths are metres behind the pelvis along the camera's z, as everywhere in edits.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from fitting_core.body.geometry import unit
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.fit.evidence.sides import other_side
from fitting_core.keypoints import INDEX, Keypoints

Way = Literal["mirror", "front", "behind"]
"""Mirrored, or on the side nearer to or farther from the camera."""
LimbPoints = tuple[int, int, int]
"""Keypoints of an arm or a leg: its root (shoulder or hip), its elbow or knee, its wrist or ankle."""

_PARTS = {"arm": ("shoulder", "elbow", "wrist"), "leg": ("hip", "knee", "ankle")}
_LIMBS: tuple[LimbPoints, ...] = tuple(
    (INDEX[f"{side}_{root}"], INDEX[f"{side}_{middle}"], INDEX[f"{side}_{end}"])
    for side in ("left", "right")
    for root, middle, end in _PARTS.values()
)
_ROOT = {middle: root for root, middle, _ in _LIMBS}
_FEET = {
    INDEX[f"{side}_{part}"]: INDEX[f"{side}_ankle"]
    for side in ("left", "right")
    for part in ("big_toe", "small_toe", "heel")
}
_IN_PLANE = 0.05
"""Metres of depth from its root below which a keypoint is on neither side of it: there the fit does not determine the
limb's depth, only its length in the image does."""


def limbs_of(joints: Collection[int]) -> tuple[LimbPoints, ...]:
    """The arms and legs with any keypoint but the root among these. Raises InputError without any."""
    chosen = {_FEET.get(joint, joint) for joint in joints}
    found = tuple(limb for limb in _LIMBS if chosen & set(limb[1:]))
    if not found:
        raise InputError("Depth is set for arms and legs: select an elbow, a wrist, a knee, an ankle or a foot first.")
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenBody:
    """A fitted body in some frames, with the keypoints it was fitted to."""

    points: Float[np.ndarray, "F 137 3"]
    """The body's keypoints in camera space, metres."""
    pelvis: Float[np.ndarray, "F"]
    """z of the pelvis in camera space, metres."""
    keypoints: Keypoints
    """As corrected, in the same frames."""
    camera: Camera
    swapped: Sequence[Collection[str]]
    """For each frame the pairs of limbs whose sides the fit unswapped (names of `sides.PAIRED`)."""

    def sent(self, limb: LimbPoints, way: Way) -> Float[np.ndarray, "F 2"]:
        """Depths of elbow and wrist, or of knee and ankle, that keep the length of each bone and the pixels.

        Each bone then has two solutions, nearer or farther. "mirror" takes the other one of both; the other ways take,
        among the poses on the requested side, the one closest to the current distances of elbow and wrist from the
        root; keypoints still on the wrong side are put at the root's depth.
        """
        ends = [[other_side(joint, pairs) for joint in limb[1:]] for pairs in self.swapped]
        roots = np.array([[_ROOT[middle]] for middle, _ in ends])
        every = np.arange(len(ends))[:, None]
        points = self.points[every, np.hstack([roots, ends])]
        off = points[:, 1:, 2] - points[:, :1, 2]
        flat = (abs(off) < _IN_PLANE) & (self.keypoints.confidence[every, limb[1:]] > 0) & (way != "mirror")
        rays = unit(np.where(flat[..., None], self._rays(limb), points[:, 1:]))
        poses, was = _poses(points, rays)
        if way == "mirror":
            return poses[np.arange(len(poses)), 3 - was] - self.pelvis[:, None]
        side = 1 if way == "behind" else -1
        reached = side * (poses - points[:, None, :1, 2])
        longest = np.linalg.norm(np.diff(points, axis=1), axis=-1).cumsum(1)
        missed = abs(reached - np.where(abs(off) < _IN_PLANE, longest, abs(off))[:, None]).sum(2)
        wrong = (reached < -_IN_PLANE).sum(2)
        chosen = np.where(wrong == wrong.min(1, keepdims=True), missed, np.inf).argmin(1)
        # Away from the image's middle both ends of a bone across the view can be nearer than its start.
        found = np.maximum(reached[np.arange(len(poses)), chosen], 0)
        return points[:, :1, 2] + side * found - self.pelvis[:, None]

    def _rays(self, limb: LimbPoints) -> Float[np.ndarray, "F 2 3"]:
        """Viewing rays through the keypoints of elbow and wrist, at z = 1."""
        xy = (self.keypoints.xy[:, limb[1:]] - self.camera.center) / self.camera.focal
        return np.concatenate([xy, np.ones((*xy.shape[:2], 1))], 2)


def _poses(
    points: Float[np.ndarray, "F 3 3"], rays: Float[np.ndarray, "F 2 3"]
) -> tuple[Float[np.ndarray, "F 4 2"], Int[np.ndarray, "F"]]:
    """z of elbow and wrist in the four poses of a limb on two rays, and which of them is the current one.

    The poses by number: 0 both bones nearer, 1 the upper one nearer, 2 the lower one nearer, 3 both farther.
    """
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=-1)
    poses = []
    for middle in _ends(points[:, 0], lengths[:, 0], rays[:, 0]):
        poses += [np.stack([middle[:, 2], end[:, 2]], 1) for end in _ends(middle, lengths[:, 1], rays[:, 1])]
    farther = (np.diff(points, axis=1) * rays).sum(2) > 0
    return np.stack(poses, 1), farther @ [2, 1]


def _ends(
    start: Float[np.ndarray, "F 3"], length: Float[np.ndarray, "F"], ray: Float[np.ndarray, "F 3"]
) -> tuple[Float[np.ndarray, "F 3"], Float[np.ndarray, "F 3"]]:
    """Where bones of given lengths can end on unit rays, nearer and farther; the closest point if out of reach."""
    along = (start * ray).sum(1)
    half = np.sqrt(np.maximum(length**2 - (start**2).sum(1) + along**2, 0))
    return (along - half)[:, None] * ray, (along + half)[:, None] * ray
