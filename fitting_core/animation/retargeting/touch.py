"""Touching hands on a rig whose lengths are not the person's.

A hand touches where the fit's surface of it is near the surface of something else: the other arm, the head, the trunk,
a leg. There its wrist is moved until the same points are as near on the rig, whose surface is taken for the person's,
scaled, around each joint.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree

from fitting_core.animation.retargeting.limbs import limb_of, reached
from fitting_core.animation.retargeting.retarget import Posed, RigMotion
from fitting_core.body.geometry import SIDES
from fitting_core.body.model import JOINT, JOINTS
from fitting_core.motion import CHUNK, Motion

_NEAR, _FAR = 0.015, 0.06
"""Skin distances in metres up to which a hand touches, and from which it does not."""
_SOFT = 0.004
"""Metres: of several near points of a hand, each counts by exp of minus its distance over this."""
_EACH, _OTHERS = 150, 2500
"""Points of a hand, and of everything else, that are compared."""
_ROUNDS = 6
"""Iterations in which wrists are moved: each of two hands goes half of the way to the other."""
_SMOOTH = 0.03
"""Seconds over which the way of a wrist to what it touches is smoothed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Touch:
    """Where one hand is near something else, over T frames: P of its points, and what each is nearest to."""

    share: Float[np.ndarray, "T"]
    """1 where it touches, 0 where it does not, between where it nearly does."""
    counts: Float[np.ndarray, "T P"]
    """How much each point counts; they sum up to 1."""
    hand: Int[np.ndarray, "P"]
    """The joint of SMPL-X that a point moves with."""
    hand_points: Float[np.ndarray, "T P 3"]
    """In the y-up world, metres."""
    other: Int[np.ndarray, "T P"]
    """The joint that the point moves with that it is nearest to."""
    other_points: Float[np.ndarray, "T P 3"]

    @property
    def distance(self) -> Float[np.ndarray, "T"]:
        """Metres from skin to skin, where the hand is nearest."""
        return np.linalg.norm(self.hand_points - self.other_points, axis=-1).min(1)


def touches(motion: Motion) -> dict[str, Touch]:
    """Where each hand of a fit touches, by side."""
    upright = motion.in_axes("y-up")
    owner = motion.body.skinning_weights.argmax(1)
    found = {}
    for side in SIDES:
        hand, others = _points(motion, owner, side)
        parts = [_near(part, owner, hand, others) for part in _chunks(upright)]
        nearest, mine, theirs = (np.concatenate(values) for values in zip(*parts, strict=True))
        distances = np.linalg.norm(mine - theirs, axis=-1)
        least = distances.min(1)
        counts = np.exp(-(distances - least[:, None]) / _SOFT)
        share = np.clip((_FAR - least) / (_FAR - _NEAR), 0.0, 1.0)
        found[side] = Touch(
            share=share * share * (3 - 2 * share),
            counts=counts / counts.sum(1, keepdims=True),
            hand=owner[hand],
            hand_points=mine,
            other=nearest,
            other_points=theirs,
        )
    return found


def _chunks(upright: Motion) -> list[Float[np.ndarray, "t V 3"]]:
    starts = range(0, len(upright), CHUNK)
    return [upright.mesh(upright.params[start : start + CHUNK]).numpy() for start in starts]


def _points(motion: Motion, owner: np.ndarray, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of a hand, evenly taken, and of all that is not the same arm."""
    fingers = {JOINT[name] for name in JOINTS if name.startswith(f"{side}_") and name[-1].isdigit()}
    hand = np.flatnonzero(np.isin(owner, [*fingers, JOINT[f"{side}_wrist"]]))
    arm = [JOINT[f"{side}_{part}"] for part in ("collar", "shoulder", "elbow", "wrist")]
    others = np.flatnonzero(~np.isin(owner, [*fingers, *arm]))
    return hand[:: 1 + len(hand) // _EACH], others[:: 1 + len(others) // _OTHERS]


def _near(
    vertices: np.ndarray, owner: np.ndarray, hand: np.ndarray, others: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    nearest = np.stack([KDTree(v[others]).query(v[hand])[1] for v in vertices])
    theirs = np.take_along_axis(vertices[:, others], nearest[..., None], 1)
    return owner[others][nearest], vertices[:, hand], theirs


def touching(
    moving: RigMotion, posed: Posed, found: dict[str, Touch], parents: np.ndarray, frame_rate: float
) -> RigMotion:
    """Hands to where they touch; see the module's text."""
    start, by = moving, {side: np.zeros_like(moving.root) for side in found}
    for _ in range(_ROUNDS):
        for side, touch in found.items():
            way = touch.share[:, None] * (by[side] + _way(moving, posed, side, touch, parents))
            by[side] = gaussian_filter1d(way, max(0.3, _SMOOTH * frame_rate), axis=0)
        moving = start
        for side in found:
            limb = limb_of(moving.target, side, "arm")
            moving = reached(moving, limb, moving.places[:, limb.end] + by[side])
    return moving


def gaps(moving: RigMotion, posed: Posed, side: str, touch: Touch, parents: np.ndarray) -> Float[np.ndarray, "T P 3"]:
    """The ways from where the hand's points are on the rig to where they would be as near as in the fit."""
    target, places = moving.target, moving.places
    scale = target.scale

    def on_rig(joints: np.ndarray, points: np.ndarray) -> np.ndarray:
        anchors = np.array([target.anchor(name, parents) for name in JOINTS])[joints]  # (..., 2)
        k, j = np.broadcast_to(anchors[..., 0], points.shape[:2]), np.broadcast_to(anchors[..., 1], points.shape[:2])
        rows = np.arange(len(points))[:, None]
        return places[rows, k] + scale * (points - posed.places[rows, j]) @ target.upright.T

    apart = scale * (touch.hand_points - touch.other_points) @ target.upright.T
    return on_rig(touch.other, touch.other_points) + apart - on_rig(touch.hand, touch.hand_points)


def _way(moving: RigMotion, posed: Posed, side: str, touch: Touch, parents: np.ndarray) -> Float[np.ndarray, "T 3"]:
    """By how much a wrist is still off; of two hands each goes half of it."""
    other_arm = [JOINT[n] for n in JOINTS if n.startswith({"left": "right_", "right": "left_"}[side])]
    arm = [j for j in other_arm if JOINTS[j].split("_")[1][:3] not in ("hip", "kne", "ank", "foo", "eye")]
    half = np.where(np.isin(touch.other, arm), 0.5, 1.0)
    ways = gaps(moving, posed, side, touch, parents) * (half * touch.counts)[..., None]
    return ways.sum(1)
