"""A moving standard rig with the person's surface, from which its files are written."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from fitting_core.animation.morphs import Morphs, corrective_morphs, expression_morphs, joined_morphs
from fitting_core.animation.retargeting import PosedSkeleton, RigMotion, turned
from fitting_core.animation.rig import Deviation, four_weights
from fitting_core.animation.standard import Standard, bent, standard_target
from fitting_core.body.model import JOINTS
from fitting_core.motion import CHUNK, Motion, Progress

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
    """The person's surface on a standard rig.

    Where joints are bent from one rest pose to the other, skinning twice is not skinning once: see `surface_deviation`.
    """
    shaped = motion.in_axes("y-up").one_shape
    body, target = shaped.shaped_body, moving.target
    bones, weights = four_weights(body.skinning_weights)
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


def surface_deviation(
    motion: Motion, moving: RigMotion, surface: RigSurface, progress: Progress | None = None
) -> Deviation:
    """How far the skinned surface is from the fit's, over at most 64 frames, evenly over the motion."""
    upright = motion.in_axes("y-up")
    frames = np.unique(np.linspace(0, len(motion) - 1, min(_LOOKED_AT, len(motion))).round().astype(int)).tolist()
    largest, total, frame = -1.0, 0.0, 0
    for done, start in enumerate(range(0, len(frames), CHUNK)):
        for t in frames[start : start + CHUNK]:
            shown = surface.at(moving, slice(t, t + 1))[0]
            off = np.linalg.norm(shown - upright.mesh(upright.params[t : t + 1]).numpy()[0], axis=-1)
            total += float(off.mean())
            if off.max() > largest:
                largest, frame = float(off.max()), t
        if progress:
            progress(min(1.0, (done + 1) * CHUNK / len(frames)))
    return Deviation(largest=largest, mean=total / len(frames), frame=frame)
