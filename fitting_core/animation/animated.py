"""A moving rig, SMPL-X's own skeleton or a standard one, with the person's surface: the content of its files."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from fitting_core.animation.morphs import Morphs, corrective_morphs, expression_morphs, joined_morphs
from fitting_core.animation.retargeting import PosedSkeleton, RigMotion, own_skeleton, turned
from fitting_core.animation.standard import Standard, bent, standard_target
from fitting_core.body.model import JOINTS
from fitting_core.motion import Motion, Progress

_WEIGHTS = 4
"""Maximum number of joints that a vertex follows: the limit of real-time graphics."""
_LOOKED_AT = 64
"""Frames, evenly over the motion, in which the surface is compared with the fit's."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RigSurface:
    """The body in the rig's rest pose, skinned to the rig's joints."""

    vertices: Float[np.ndarray, "V 3"]
    """Metres, single precision."""
    faces: Int[np.ndarray, "F 3"]
    bones: Int[np.ndarray, "V 4"]
    """Of the rig's joints, those that each vertex follows."""
    weights: Float[np.ndarray, "V 4"]
    morphs: Morphs

    def at(self, moving: RigMotion, frames: slice) -> Float[np.ndarray, "T V 3"]:
        """How a program with linear skinning shows it, metres."""
        moved, places = moving.moved[frames], moving.places[frames]
        offsets = places - np.einsum("tkab,kb->tka", moved, moving.target.places)
        shapes = np.tensordot(self.morphs.weights[frames], self.morphs.directions, 1) + self.vertices
        blend = np.concatenate([moved, offsets[..., None]], -1)[:, self.bones]
        transform = (self.weights[None, ..., None, None] * blend).sum(2)
        return (transform[..., :3] @ shapes[..., None])[..., 0] + transform[..., 3]


def on_own_skeleton(motion: Motion) -> RigMotion:
    """A motion on SMPL-X's joints, in the y-up world; betas that differ by frame become their mean."""
    return turned(PosedSkeleton.of(motion), own_skeleton(motion.in_axes("y-up").shaped_body))


def on_standard(motion: Motion, standard: Standard) -> RigMotion:
    """A motion on a standard rig with the person's bones, in the y-up world."""
    upright = motion.in_axes("y-up").one_shape
    moving = turned(PosedSkeleton.of(upright), standard_target(standard, upright.shaped_body))
    root = moving.target.root
    if moving.target.parents[root] < 0:
        return moving
    return replace(moving, base=below(upright, moving))


def below(motion: Motion, moving: RigMotion) -> Float[np.ndarray, "3"]:
    """The place on the floor below the pelvis in the first frame, metres."""
    return moving.root[0] * (1, 0, 1) + (0, _floor(motion.in_axes("y-up")), 0)


def _floor(upright: Motion) -> float:
    """Height of the floor: 0 if known, otherwise that of the lowest joint in the first frame."""
    if upright.level is not None and upright.level.height is not None:
        return 0.0
    return float(upright[:1].joints()[0, :, 1].min())


def surface_on(motion: Motion, moving: RigMotion) -> RigSurface:
    """The person's surface on a rig.

    Where joints are bent from one rest pose to the other, skinning twice is not skinning once: see `surface_deviation`.
    """
    shaped = motion.in_axes("y-up").one_shape
    body, target = shaped.shaped_body, moving.target
    bones, weights = _four_weights(body.skinning_weights)
    where = np.array([target.of_joint[name] for name in JOINTS])
    morphs = joined_morphs(expression_morphs(shaped), corrective_morphs(shaped))
    turns = np.einsum("vk,vkab->vab", weights, target.rest[bones])
    directions = np.einsum("vab,kvb->kva", turns, morphs.directions).astype(np.float32)
    return RigSurface(
        vertices=bent(body, target.rest, target.places[where]).astype(np.float32),
        faces=body.faces,
        bones=np.where(weights > 0, where[bones], 0),  # glTF: 0 where nothing is followed
        weights=weights,
        morphs=replace(morphs, directions=directions),
    )


def _four_weights(weights: Float[np.ndarray, "V 55"]) -> tuple[Int[np.ndarray, "V 4"], Float[np.ndarray, "V 4"]]:
    """The four largest weights of each vertex, made to sum up to 1, and their joints."""
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :_WEIGHTS]
    kept = np.take_along_axis(weights, bones, 1)
    return bones, (kept / kept.sum(1, keepdims=True)).astype(np.float32)


def surface_deviation(
    motion: Motion, moving: RigMotion, surface: RigSurface, progress: Progress | None = None
) -> dict[str, Any]:
    """How far the skinned surface is from the fit's, over at most 64 frames, evenly over the motion; for a file."""
    upright = motion.in_axes("y-up")
    frames = np.unique(np.linspace(0, len(motion) - 1, min(_LOOKED_AT, len(motion))).round().astype(int)).tolist()
    largest, total = 0.0, 0.0
    for done, t in enumerate(frames, 1):
        shown = surface.at(moving, slice(t, t + 1))[0]
        off = np.linalg.norm(shown - upright.mesh(upright.params[t : t + 1]).numpy()[0], axis=-1)
        largest, total = max(largest, float(off.max())), total + float(off.mean())
        if progress:
            progress(done / len(frames))
    return {
        "largest_deviation_m": round(largest, 7),
        "mean_deviation_m": round(total / len(frames), 7),
        "deviation": "of the skinned vertices from the fit's, over at most 64 frames",
    }
