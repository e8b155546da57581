"""A rig with fewer keys: the constrained points, the frames that keep their keys, and what is played between keys.

The points are all joints, and of the joints at which a chain ends, and of the head, the outermost vertices: finger
tips, toes, nose, crown. The weights of the shapes are one channel more. They get half of the bound for the whole
surface, and what they do to the outermost vertices is taken from what the joints may do there.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from fitting_core.animation.keys import Animation, along_arc, between, fewer_keys, frames_within, spans
from fitting_core.animation.morphs import Morphs
from fitting_core.animation.rig import Rig
from fitting_core.body.geometry import SIDES
from fitting_core.body.model import JOINT
from fitting_core.frame_runs import runs_where
from fitting_core.ground.contacts import Contacts
from fitting_core.motion import CHUNK, Motion, Progress

_OF_SHAPES = 0.5
"""Share of the bound for the morph weights."""
_TRIED = 24
"""Vertices of each shape, those that it moves most, on which keys of the weights are tried."""
_PASSES = 6


def with_fewer_keys(rig: Rig, motion: Motion, within: float, progress: Progress | None = None) -> Rig:
    """The rig with the keys that are needed for all points to stay within a bound, and with what is played of them.
    Raises InputError if the bound is invalid.

    Args:
        rig: With a key in each frame.
        motion: Whose rig it is.
        within: How far a joint, finger tip or toe may be off in any frame, metres.
        progress: See `Progress`.
    """
    joints = np.arange(len(rig.joints))
    vertices, ends = _outermost(rig)
    weights = _kept_weights(rig.morphs, _OF_SHAPES * within)
    off = np.zeros((len(motion), len(joints) + len(vertices)))
    off[:, len(joints) :] = _surface_off(rig.morphs, weights, vertices)
    offsets = rig.joints - np.where(rig.parents[:, None] < 0, 0.0, rig.joints[rig.parents])
    animation = Animation(
        parents=rig.parents,
        offsets=offsets,
        turns=rig.turns,
        places=rig.places,
        point_joints=np.concatenate([joints, ends]),
        points=np.concatenate([np.zeros_like(rig.joints), rig.vertices[vertices] - rig.joints[ends]]),
    )
    keys = fewer_keys(animation, within, already=off, held=feet_held(motion.contacts), progress=progress)
    keys = replace(keys, weights=weights if rig.morphs.names else None)
    return replace(
        rig,
        keys=keys,
        places=between(rig.places, keys.places),
        turns=np.stack([along_arc(rig.turns[:, j], kept) for j, kept in enumerate(keys.turns)], 1),
        morphs=replace(rig.morphs, weights=between(rig.morphs.weights, weights).astype(np.float32)),
    )


def feet_held(contacts: Contacts | None) -> dict[int, list[int]]:
    """The first and the last frame of each time that a foot stands, by its joint: what is above it keeps keys there."""
    if contacts is None:
        return {}
    held: dict[int, list[int]] = {}
    for foot, side in enumerate(SIDES):
        stands = runs_where(contacts.standing[:, foot])
        held[JOINT[f"{side}_foot"]] = sorted({frame for run in stands for frame in (run[0], run[-1])})
    return held


def _outermost(rig: Rig) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """The vertices farthest out along each axis, of those that follow the last joints of chains or the head."""
    strongest = np.take_along_axis(rig.bones, rig.weights.argmax(1)[:, None], 1)[:, 0]
    found = []
    for joint in sorted({*range(len(rig.joints))} - {*rig.parents.tolist()} | {JOINT["head"]}):
        own = np.flatnonzero(strongest == joint)
        if len(own):
            places = rig.vertices[own]
            outer = np.unique(own[np.concatenate([places.argmin(0), places.argmax(0)])])
            found.append((outer, np.full(len(outer), joint)))
    vertices, joints = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return vertices, joints


# --- weights of the shapes ---


def _kept_weights(morphs: Morphs, within: float) -> Int[np.ndarray, "n"]:
    """The frames at which the weights need keys for the surface at rest to stay within a bound, metres."""
    kept, held = np.ones(len(morphs.weights), bool), np.zeros(len(morphs.weights), bool)
    if not morphs.names:
        return np.flatnonzero(kept)
    moves = np.linalg.norm(morphs.directions, axis=-1)
    tried = np.unique(np.argpartition(-moves, min(_TRIED, moves.shape[1] - 1), axis=1)[:, :_TRIED])
    directions, weights = np.ascontiguousarray(morphs.directions[:, tried]), morphs.weights
    for _ in range(_PASSES):
        for middle, first, last in spans(kept, held):
            frames, owner, share = frames_within(first, last)
            played = (1 - share) * weights[first[owner]] + share * weights[last[owner]]
            off = _farthest(played - weights[frames], directions)
            goes = np.ones(len(middle), bool)
            goes[owner[off > within]] = False
            kept[middle[goes]] = False
    while True:
        beyond = _surface_off(morphs, np.flatnonzero(kept)).max(1) > within
        if not beyond.any():
            return np.flatnonzero(kept)
        kept |= beyond


def _surface_off(
    morphs: Morphs, kept: Int[np.ndarray, "n"], vertices: Int[np.ndarray, "m"] | None = None
) -> Float[np.ndarray, "T m"]:
    """How far these vertices, or the farthest of all, are off at rest where the weights have these keys, metres."""
    error = between(morphs.weights, kept) - morphs.weights
    if vertices is None:
        return _farthest(error, morphs.directions)[:, None]
    return np.linalg.norm(np.tensordot(error, morphs.directions[:, vertices], 1), axis=-1)


def _farthest(weights: Float[np.ndarray, "n K"], directions: Float[np.ndarray, "K V 3"]) -> Float[np.ndarray, "n"]:
    weights = weights.astype(np.float32)
    parts = [weights[start : start + CHUNK] for start in range(0, len(weights), CHUNK)]
    return np.concatenate([np.linalg.norm(np.tensordot(part, directions, 1), axis=-1).max(1) for part in parts])
