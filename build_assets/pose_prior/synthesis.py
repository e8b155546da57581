"""Limbs in poses that people can take but the captured ones seldom do: seats, crossed legs, hands all around the body.

Drawn from anatomical ranges, in SMPL-X's rest frame (T-pose; x to the body's left, y up, z forward). Left limbs are
drawn, right ones are their mirror images.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.retarget import collar_rotation
from fitting_core.body.geometry import MIRROR_ROTATION, shortest_rotation
from fitting_core.body.model import JOINT

GROUPS: dict[str, tuple[str, ...]] = {
    "spine": ("spine1", "spine2", "spine3"),
    "head": ("neck", "head"),
    **{f"{s}_arm": tuple(f"{s}_{j}" for j in ("collar", "shoulder", "elbow", "wrist")) for s in ("left", "right")},
    **{f"{s}_leg": tuple(f"{s}_{j}" for j in ("hip", "knee", "ankle", "foot")) for s in ("left", "right")},
}
"""Joints that are exchanged together; all 21 are in one of them."""


def group_rows(group: str) -> list[int]:
    """Rows of the 21 body joints that belong to a group."""
    return [JOINT[name] - 1 for name in GROUPS[group]]


@dataclass(frozen=True)
class _Range:
    """Degrees; drawn from a normal distribution that is cut off at both ends."""

    low: float
    high: float
    mean: float
    deviation: float

    def draw(self, rng: np.random.Generator, count: int) -> Float[np.ndarray, "n"]:
        value = rng.normal(self.mean, self.deviation, count)
        outside = (value < self.low) | (value > self.high)
        return np.radians(np.where(outside, rng.uniform(self.low, self.high, count), value))


def legs(rng: np.random.Generator, count: int) -> tuple[Float[np.ndarray, "n 4 3"], Float[np.ndarray, "n 4 3"]]:
    """Left and right legs; in half of the poses both do about the same, as on a chair or on the knees."""
    left, right = _leg_angles(rng, count), _leg_angles(rng, count)
    alike = rng.random(count) < 0.5
    right = np.where(alike[:, None], left + rng.normal(0, np.radians(8), left.shape), right)
    return _leg(left), _leg(right) * MIRROR_ROTATION


_HIP_FLEXION, _HIP_ABDUCTION = _Range(-20, 130, 60, 45), _Range(-25, 55, 8, 20)
_HIP_TWIST, _KNEE_FLEXION = _Range(-35, 60, 5, 25), _Range(0, 155, 70, 50)
_ANKLE_FLEXION, _ANKLE_TILT = _Range(-35, 60, 8, 20), _Range(-25, 25, 0, 8)


def _leg_angles(rng: np.random.Generator, count: int) -> Float[np.ndarray, "n 6"]:
    ranges = (_HIP_FLEXION, _HIP_ABDUCTION, _HIP_TWIST, _KNEE_FLEXION, _ANKLE_FLEXION, _ANKLE_TILT)
    return np.stack([r.draw(rng, count) for r in ranges], 1)


def _leg(angles: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 4 3"]:
    flexion, abduction, twist, knee, ankle, tilt = angles.T
    # The thigh's direction, then its turn about itself: Euler angles would tie the two together at a right angle.
    direction = np.stack(
        [np.sin(abduction), -np.cos(abduction) * np.cos(flexion), np.cos(abduction) * np.sin(flexion)], 1
    )
    swing = Rotation.from_matrix(shortest_rotation(np.array([0.0, -1.0, 0.0]), direction))
    hip = swing * Rotation.from_euler("y", twist[:, None])
    zero = np.zeros_like(knee)
    return np.stack(
        [hip.as_rotvec(), np.stack([np.clip(knee, 0, None), zero, zero], 1), np.stack([ankle, zero, tilt], 1),
         np.stack([zero, zero, zero], 1)], 1,
    )  # fmt: skip


def arms(rng: np.random.Generator, count: int) -> tuple[Float[np.ndarray, "n 4 3"], Float[np.ndarray, "n 4 3"]]:
    """Left and right arms; in a third of the poses both do about the same."""
    left, right = _arm_angles(rng, count), _arm_angles(rng, count)
    alike = rng.random(count) < 0.35
    right = np.where(alike[:, None], left + rng.normal(0, np.radians(10), left.shape), right)
    return _arm(left), _arm(right) * MIRROR_ROTATION


@dataclass(frozen=True, kw_only=True)
class _Reach:
    """Where an arm goes: its upper bone's elevation and azimuth (0: sideways, 90: forward), its twist, the elbow."""

    share: float
    elevation: _Range
    azimuth: _Range
    twist: _Range
    elbow: _Range


_REACHES = (
    # Hands before the body, where people use them and signers sign.
    _Reach(share=0.5, elevation=_Range(-90, 30, -50, 25), azimuth=_Range(-20, 120, 50, 35),
           twist=_Range(-60, 90, 25, 35), elbow=_Range(30, 145, 95, 28)),
    # Anywhere.
    _Reach(share=0.35, elevation=_Range(-90, 90, -15, 50), azimuth=_Range(-50, 125, 30, 45),
           twist=_Range(-75, 105, 10, 45), elbow=_Range(0, 145, 65, 45)),
    # Behind the back.
    _Reach(share=0.15, elevation=_Range(-80, -35, -57, 12), azimuth=_Range(-120, -40, -80, 20),
           twist=_Range(40, 110, 85, 18), elbow=_Range(30, 125, 80, 25)),
)  # fmt: skip
_PRONATION, _WRIST_FLEXION, _WRIST_DEVIATION = _Range(-80, 80, 0, 40), _Range(-65, 65, 0, 25), _Range(-35, 35, 0, 14)


def _arm_angles(rng: np.random.Generator, count: int) -> Float[np.ndarray, "n 7"]:
    """Elevation, azimuth, twist, elbow, pronation, wrist flexion, wrist deviation."""
    which = rng.choice(len(_REACHES), count, p=[r.share for r in _REACHES])
    each = [
        np.stack([r.draw(rng, count) for r in (reach.elevation, reach.azimuth, reach.twist, reach.elbow)], 1)
        for reach in _REACHES
    ]
    reach = np.stack(each)[which, np.arange(count)]
    hand = np.stack([r.draw(rng, count) for r in (_PRONATION, _WRIST_FLEXION, _WRIST_DEVIATION)], 1)
    return np.concatenate([reach, hand], 1)


def _arm(angles: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "n 4 3"]:
    elevation, azimuth, twist, elbow, pronation, flexion, deviation = angles.T
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.sin(elevation), np.cos(elevation) * np.sin(azimuth)], 1
    )
    swing = Rotation.from_matrix(shortest_rotation(np.array([1.0, 0.0, 0.0]), direction))
    upper = swing * Rotation.from_euler("x", twist[:, None])
    collar = Rotation.from_matrix(collar_rotation(direction, "left"))
    shoulder = collar.inv() * upper
    fore = Rotation.from_euler("y", (-np.clip(elbow, 0, None))[:, None]) * Rotation.from_euler(
        "x", 0.5 * pronation[:, None]
    )
    hand = Rotation.from_euler("XZY", np.stack([0.5 * pronation, flexion, deviation], 1))
    return np.stack([r.as_rotvec() for r in (collar, shoulder, fore, hand)], 1)


_BEND, _TURN, _SIDE_BEND = _Range(-20, 75, 15, 25), _Range(-40, 40, 0, 15), _Range(-30, 30, 0, 10)


def spine(rng: np.random.Generator, count: int) -> tuple[Float[np.ndarray, "n 3 3"]]:
    """Bend, twist and side bend, shared by three joints, not quite evenly."""
    whole = np.stack([r.draw(rng, count) for r in (_BEND, _TURN, _SIDE_BEND)], 1)
    share = rng.dirichlet([8, 8, 8], count)
    return (whole[:, None] * share[:, :, None],)


_NOD, _SHAKE, _TILT = _Range(-45, 50, 5, 20), _Range(-75, 75, 0, 30), _Range(-35, 35, 0, 12)


def head(rng: np.random.Generator, count: int) -> tuple[Float[np.ndarray, "n 2 3"]]:
    """Neck and head, each about half of the way."""
    whole = np.stack([r.draw(rng, count) for r in (_NOD, _SHAKE, _TILT)], 1)
    share = rng.beta(8, 8, count)
    return (whole[:, None] * np.stack([share, 1 - share], 1)[:, :, None],)


SYNTHESIS: dict[tuple[str, ...], Callable[[np.random.Generator, int], tuple[np.ndarray, ...]]] = {
    ("left_leg", "right_leg"): legs,
    ("left_arm", "right_arm"): arms,
    ("spine",): spine,
    ("head",): head,
}
"""What draws limbs for which groups."""
