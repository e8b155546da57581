"""The basis of hand poses: anatomical synergies first, all 45 degrees of freedom in the end.

Finger joints turn about the world's axes of the rest pose, as in SMPL-X, which has no frames along the bones. So each
finger's hinge is found from where its joints lie.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.body.free.geometry import MIRROR_ROTATION, unit
from fitting_core.body.model import JOINT

_FINGERS = ("index", "middle", "pinky", "ring", "thumb")  # the order of SMPL-X's joints
_LONG = ("index", "middle", "ring", "pinky")
_SIZE = 45
_FLEX, _SPREAD, _TWIST = 0, 1, 2
_CURL = {1: 0.75, 2: 1.0, 3: 0.6}
"""How much each joint of a finger takes part in bending it."""
_HOOK = {1: 1.0, 2: -0.65, 3: -0.4}
"""The knuckle bent against the two other joints."""
_OPPOSED = np.array([0, -0.035, 0])  # metres from the ring finger's knuckle: where the thumb's tip goes

Move = tuple[str, int, int, float]
"""Finger, joint of it (1 is the knuckle), axis, amount."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HandBasis:
    """Hand poses: mean + coefficients @ components, as axis-angle of the 15 finger joints in SMPL-X's order."""

    components: Float[np.ndarray, "45 45"]
    """Orthonormal rows; the first 12 span what hands do most."""
    mean: Float[np.ndarray, "45"]
    """A relaxed hand, relative to the rest pose's flat one."""

    def mirrored(self) -> "HandBasis":
        """The basis of the other hand."""
        return HandBasis(components=_mirror(self.components), mean=_mirror(self.mean))


def left_hand_basis(joints: Float[np.ndarray, "55 3"]) -> HandBasis:
    """The left hand's basis, from the joints of a typical body in the rest pose (metres)."""
    axes = _axes(joints)
    moves = [*_synergies(), *_single_freedoms()]
    vectors = np.concatenate([[_vector(move, axes) for move in moves], np.eye(_SIZE)])
    return HandBasis(components=_orthonormal(vectors), mean=_vector(_relaxed(), axes))


def _synergies() -> list[list[Move]]:
    """Twelve joint movements of the fingers, the commonest first."""
    one_by_one = {"index": 1.0, "middle": 0.3, "ring": -0.5, "pinky": -0.8}
    outer_inner = {"index": 0.6, "middle": -0.9, "ring": -0.6, "pinky": 0.9}
    middle_ring = {"index": -0.3, "middle": 0.9, "ring": -0.9, "pinky": 0.3}
    together: dict[str, float] = {finger: 1.0 for finger in _LONG}
    fan = {"index": -1.0, "middle": -0.2, "ring": 0.5, "pinky": 1.0}
    thumb_follows: list[Move] = [("thumb", 1, _FLEX, 0.25), ("thumb", 2, _FLEX, 0.35), ("thumb", 3, _FLEX, 0.45)]
    return [
        _bend(together, _CURL) + thumb_follows,  # grasp
        _bend(together, _HOOK),
        [("thumb", 1, _FLEX, 1.0), ("thumb", 1, _SPREAD, 0.35), ("thumb", 2, _FLEX, 0.2)],  # opposition
        [("thumb", 2, _FLEX, 0.8), ("thumb", 3, _FLEX, 1.0)],
        _bend(one_by_one, _CURL),  # pointing
        [(finger, 1, _SPREAD, amount) for finger, amount in fan.items()],
        [("thumb", 1, _SPREAD, 1.0)],
        _bend(outer_inner, _CURL),
        _bend(middle_ring, _CURL),
        _bend(one_by_one, _HOOK),
        [("index", 1, _SPREAD, 1.0)],
        [("pinky", 1, _SPREAD, 1.0)],
    ]


def _single_freedoms() -> list[list[Move]]:
    """Every joint by itself: first what fingers can do, then what they cannot."""
    possible: list[Move] = [(finger, k, _FLEX, 1.0) for k in (1, 2, 3) for finger in _LONG]
    possible += [(finger, 1, _SPREAD, 1.0) for finger in ("middle", "ring")]
    possible += [("thumb", k, axis, 1.0) for k in (1, 2, 3) for axis in (_FLEX, _SPREAD)]
    rest: list[Move] = [(f, k, axis, 1.0) for axis in (_SPREAD, _TWIST) for f in _FINGERS for k in (1, 2, 3)]
    return [[move] for move in possible + rest]


def _relaxed() -> list[Move]:
    fingers = {"index": 0.8, "middle": 1.0, "ring": 1.1, "pinky": 1.1}
    thumb: list[Move] = [("thumb", 1, _FLEX, 0.15), ("thumb", 2, _FLEX, 0.15), ("thumb", 3, _FLEX, 0.2)]
    return _bend(fingers, {1: 0.28, 2: 0.42, 3: 0.25}) + thumb


def _bend(fingers: dict[str, float], joints: dict[int, float]) -> list[Move]:
    return [(finger, k, _FLEX, share * amount) for finger, amount in fingers.items() for k, share in joints.items()]


def _axes(joints: Float[np.ndarray, "55 3"]) -> dict[str, Float[np.ndarray, "3 3"]]:
    """Axes of each left finger as rows: turning about them by positive angles flexes, spreads, twists.

    Positive spreading turns about the upward axis, so it takes the left index finger away from the thumb.
    """
    axes = {}
    for finger in _FINGERS:
        first, _, third = (joints[JOINT[f"left_{finger}{k}"]] for k in (1, 2, 3))
        along = unit(third - first)
        palm = np.array([0, -1.0, 0])
        if finger == "thumb":  # it flexes across the palm
            palm = unit(joints[JOINT["left_ring1"]] + _OPPOSED - first)
        flex = unit(np.cross(along, palm))
        spread = unit(np.cross(flex, along))
        upward = finger == "thumb" or spread[1] > 0
        axes[finger] = np.stack([flex, spread if upward else -spread, along])
    return axes


def _vector(moves: list[Move], axes: dict[str, Float[np.ndarray, "3 3"]]) -> Float[np.ndarray, "45"]:
    vector = np.zeros((len(_FINGERS), 3, 3))
    for finger, k, axis, amount in moves:
        vector[_FINGERS.index(finger), k - 1] += amount * axes[finger][axis]
    return vector.ravel()


def _orthonormal(vectors: Float[np.ndarray, "n 45"]) -> Float[np.ndarray, "45 45"]:
    """Gram-Schmidt, leaving out what earlier vectors span."""
    basis = np.zeros((0, _SIZE))
    for vector in vectors:
        rest = vector / np.linalg.norm(vector)
        for _ in range(2):  # the second pass removes the first one's rounding
            rest = rest - basis.T @ (basis @ rest)
        if np.linalg.norm(rest) > 1e-6:
            basis = np.concatenate([basis, rest[None] / np.linalg.norm(rest)])
    return basis


def _mirror(vectors: Float[np.ndarray, "*n 45"]) -> Float[np.ndarray, "*n 45"]:
    return (vectors.reshape(*vectors.shape[:-1], -1, 3) * MIRROR_ROTATION).reshape(vectors.shape)
