"""A motion as a rig: a skeleton, a mesh with four weights a vertex and with morphs, and a pose for each frame."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from fitting_core.animation.morphs import Morphs, corrective_morphs, expression_morphs, joined_morphs
from fitting_core.body.kinematics import Tree, pose_joints
from fitting_core.body.model import N_JOINTS
from fitting_core.motion import CHUNK, Motion, Progress

WEIGHTS = 4
"""Maximum number of joints that a vertex follows: the limit of real-time graphics."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """The content of a file with skinned animation of T frames."""

    vertices: Float[np.ndarray, "V 3"]
    """The rest pose with the motion's shape, metres, single precision."""
    faces: Int[np.ndarray, "F 3"]
    joints: Float[np.ndarray, "55 3"]
    """At rest, metres."""
    parents: Int[np.ndarray, "55"]
    bones: Int[np.ndarray, "V 4"]
    """The joints that each vertex follows."""
    weights: Float[np.ndarray, "V 4"]
    """How much; they sum up to 1."""
    turns: Float[np.ndarray, "T 55 4"]
    """Quaternions x, y, z, w of each joint against its parent, of the root in the world; without sudden signs."""
    places: Float[np.ndarray, "T 3"]
    """Of the root joint in the world, metres."""
    morphs: Morphs

    def vertices_of(self, frames: slice) -> Float[np.ndarray, "T V 3"]:
        """How a program with linear skinning shows it, metres."""
        local = torch.as_tensor(Rotation.from_quat(self.turns[frames].reshape(-1, 4)).as_matrix())
        local = local.reshape(-1, N_JOINTS, 3, 3)
        rest = torch.as_tensor(self.joints, dtype=local.dtype)
        world, joints = pose_joints(Tree.of(self.parents), local, rest.expand(len(local), -1, -1))
        joints = joints + torch.as_tensor(self.places[frames, None]) - rest[0]
        offset = joints - (world @ rest[:, :, None])[..., 0]
        moved = np.tensordot(self.morphs.weights[frames], self.morphs.directions, 1) + self.vertices
        blend = self.weights[None, ..., None, None] * torch.cat([world, offset[..., None]], -1).numpy()[:, self.bones]
        transform = blend.sum(2)
        return (transform[..., :3] @ moved[..., None])[..., 0] + transform[..., 3]


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """How far a rig's vertices are from the fit's."""

    largest: float
    """Metres."""
    mean: float
    """Metres."""
    frame: int
    """Where the largest is, from the motion's first."""


def rig_of(motion: Motion) -> Rig:
    """The rig of a motion; betas that differ by frame become their mean."""
    shaped = motion.one_shape
    body = shaped.shaped_body
    bones, weights = four_weights(body.skinning_weights)
    turns = Rotation.from_rotvec(shaped.pose.numpy().reshape(-1, 3)).as_quat().reshape(-1, N_JOINTS, 4)
    return Rig(
        vertices=body.template.astype(np.float32),
        faces=body.faces,
        joints=body.rest_joints,
        parents=body.parents,
        bones=bones,
        weights=weights,
        turns=same_hemisphere(turns),
        places=shaped.pelvis,
        morphs=joined_morphs(expression_morphs(shaped), corrective_morphs(shaped)),
    )


def four_weights(weights: Float[np.ndarray, "V 55"]) -> tuple[Int[np.ndarray, "V 4"], Float[np.ndarray, "V 4"]]:
    """The four largest weights of each vertex, made to sum up to 1, and their joints; joint 0 where there are fewer."""
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :WEIGHTS]
    kept = np.take_along_axis(weights, bones, 1)
    bones = np.where(kept > 0, bones, 0)
    return bones, (kept / kept.sum(1, keepdims=True)).astype(np.float32)


def same_hemisphere(turns: Float[np.ndarray, "T J 4"]) -> Float[np.ndarray, "T J 4"]:
    """The same rotations with signs by which each is near the one before: q and -q turn alike, what is between not."""
    flips = np.where((turns[1:] * turns[:-1]).sum(-1) < 0, -1.0, 1.0)
    return turns * np.concatenate([np.ones_like(turns[:1, :, 0]), flips.cumprod(0)])[..., None]


def deviation(rig: Rig, motion: Motion, progress: Progress | None = None) -> Deviation:
    """Compare a rig with the fit in all frames."""
    largest, total, frame = -1.0, 0.0, 0
    for t, distances in enumerate(_distances(rig, motion)):
        total += float(distances.mean())
        if distances.max() > largest:
            largest, frame = float(distances.max()), t
        if progress:
            progress((t + 1) / len(motion))
    return Deviation(largest=largest, mean=total / len(motion), frame=frame)


def _distances(rig: Rig, motion: Motion) -> Iterator[Float[np.ndarray, "V"]]:
    for start in range(0, len(motion), CHUNK):
        part = slice(start, start + CHUNK)
        yield from np.linalg.norm(rig.vertices_of(part) - motion.mesh(motion.params[part]).numpy(), axis=-1)
