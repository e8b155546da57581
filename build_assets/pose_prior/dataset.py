"""From captured clips to the poses that a prior is trained on: split, balanced, mirrored, recombined."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.cluster.vq import kmeans2, vq
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.retarget import MotionClip, mirrored
from build_assets.pose_prior.skeleton import Contact, Skeleton
from build_assets.pose_prior.synthesis import SYNTHESIS, group_rows
from fitting_core.body import rotations
from fitting_core.body.model import JOINT

_CLUSTERS = 256
_MOST_CLUSTERED = 5000
_FLATTENED = 0.8
"""Clusters are drawn with probability size^(1 - this): 0 as captured, 1 all alike."""
_OWN, _OTHER = 0.4, 0.65
"""In recombined poses 40 % of the limbs stay, 25 % come from another captured pose, 35 % from synthesis."""
_MOST_OF_COLLAR = 1.2
_NOISE = {
    ("left_wrist", "right_wrist"): (0.0, 8.0, 12.0),  # captured wrists never bend
    ("neck", "head"): (8.0, 0.0, 0.0),  # captured ones share every turn alike; people push their chin forward
    ("spine1", "spine2", "spine3"): (4.0, 0.0, 0.0),  # the same
    ("left_collar", "right_collar"): (0.0, 0.0, 4.0),  # captured ones follow from the arm's direction; people shrug
    ("left_hip", "right_hip", "left_shoulder", "right_shoulder"): (4.0, 4.0, 4.0),
    ("left_ankle", "right_ankle"): (4.0, 0.0, 4.0),
}
"""Degrees about x, y and z in recombined poses, by joints. Only where people differ: each freedom takes a share of the
32 numbers. With 4 to 12 degrees about all axes of these joints held-out poses came back to 2.0
degrees after 6000 steps, with these to 1.1 after 8000."""


@dataclass(frozen=True)
class Poses:
    """Captured poses, left and right mirrored ones included."""

    body_pose: Float[np.ndarray, "N 63"]
    weight: Float[np.ndarray, "N"]
    """Probability of being drawn."""


def balanced(clips: Sequence[MotionClip], skeleton: Skeleton, rng: np.random.Generator) -> Poses:
    """All poses and their mirror images, drawn nearly alike from each cluster of joint positions.

    Without it more than half of the poses walk or stand.
    """
    pose = np.concatenate([clip.body_pose for clip in clips])
    pose = np.concatenate([pose, mirrored(pose)])
    points = skeleton.points(matrices(pose)).flatten(1).numpy()
    some = points[rng.choice(len(points), min(len(points), _MOST_CLUSTERED), replace=False)]
    centres, _ = kmeans2(some, min(_CLUSTERS, len(some) // 2), iter=15, minit="++", rng=rng)  # "++": spread out
    label, _ = vq(points, centres)
    size = np.bincount(label, minlength=len(centres)).astype(float)
    weight = size[label] ** -_FLATTENED
    return Poses(pose, weight / weight.sum())


def matrices(body_pose: Float[np.ndarray, "N 63"]) -> Float[torch.Tensor, "N 21 3 3"]:
    """Rotation matrices, float32."""
    return rotations.exp(torch.as_tensor(body_pose, dtype=torch.float32).view(-1, 21, 3))


def pool(
    captured: Poses, contact: Contact, count: int, rng: np.random.Generator, *, as_captured: float = 0.3
) -> Float[np.ndarray, "n 63"]:
    """Poses to train on.

    A share `as_captured` is drawn from the captured poses as they are. In the others each group of joints may come from
    another captured pose or from synthesis, with a little noise; what collides with itself is drawn again.
    """
    whole = round(count * as_captured)
    parts = [captured.body_pose[rng.choice(len(captured.weight), whole, p=captured.weight)]]
    missing = count - whole
    while missing > 0:
        mixed = _mixed(captured, min(missing, 20000), rng)
        good = ~contact.overlaps(matrices(mixed)).numpy()
        parts.append(mixed[good])
        missing -= int(good.sum())
    return np.concatenate(parts).astype(np.float32)


def _mixed(captured: Poses, count: int, rng: np.random.Generator) -> Float[np.ndarray, "n 63"]:
    def draw() -> Float[np.ndarray, "n 21 3"]:
        return captured.body_pose[rng.choice(len(captured.weight), count, p=captured.weight)].reshape(-1, 21, 3)

    pose = draw().copy()
    for groups, make in SYNTHESIS.items():
        other, choice = draw(), rng.random((count, 1, 1))
        for group, limb in zip(groups, make(rng, count), strict=True):
            rows = group_rows(group)
            pose[:, rows] = np.where(choice < _OWN, pose[:, rows], np.where(choice < _OTHER, other[:, rows], limb))
    _loosen_collars(pose, rng)
    for joints, deviations in _NOISE.items():
        rows = [JOINT[name] - 1 for name in joints]
        noise = Rotation.from_rotvec(rng.normal(0, 1, (count * len(rows), 3)) * np.radians(deviations))
        turned = Rotation.from_rotvec(pose[:, rows].reshape(-1, 3)) * noise
        pose[:, rows] = turned.as_rotvec().reshape(count, -1, 3)
    return pose.reshape(count, 63)


def _loosen_collars(pose: Float[np.ndarray, "n 21 3"], rng: np.random.Generator) -> None:
    """Give collars any part of their rotation; the upper arms stay as they are against the chest.

    All captured and synthesised collars follow one rule from the arm's direction, but people (and those who pose
    figures by hand) do not: with that rule alone a hanging arm on an unturned collar could not be encoded at all.
    """
    for side in ("left", "right"):
        collar, shoulder = JOINT[f"{side}_collar"] - 1, JOINT[f"{side}_shoulder"] - 1
        before = Rotation.from_rotvec(pose[:, collar])
        pose[:, collar] *= rng.uniform(0, _MOST_OF_COLLAR, (len(pose), 1))
        after = Rotation.from_rotvec(pose[:, collar])
        pose[:, shoulder] = (after.inv() * before * Rotation.from_rotvec(pose[:, shoulder])).as_rotvec()
