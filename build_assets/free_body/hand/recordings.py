"""Recorded hands of a Leap Motion sensor as anatomical angles of a free body's left hand (see hand_skeleton.py)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from build_assets.free_body.hand.hand_skeleton import FLEXION, SPREAD, TWIST, HandSkeleton
from fitting_core.body import rotations
from fitting_core.body.geometry import unit
from fitting_core.errors import InputError
from fitting_core.files.npz import read_npz
from fitting_core.keypoints import FINGERS

_LEAP_FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_CONFIDENT = 0.6
_DIRECTION = 0.05
"""Radians (3 degrees): how far a bone may miss its direction for the sake of the other residuals."""
_TOO_FAR = np.radians(8.0)
"""A bone that misses its direction by more was tracked senselessly, or cannot be expressed."""
_TOO_TWISTED = np.radians(45.0)
"""No knuckle twists so far: then a bone lies beside the plane in which its finger bends."""
_ROUNDS = 25


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Left hands of one recording; right ones are mirrored."""

    name: str
    directions: Float[np.ndarray, "N 5 3 3"]
    """Unit vectors along the bones of FINGERS from the knuckle outward; x along the palm, y out of its back, z to the
    thumb's side."""


def read_recording(path: Path) -> Recording:
    """The confident frames of a recording: an npz file with joints in the sensor's coordinates and the palm's axes.

    The sensor's hand model has rigid metacarpals, and bends the two outer joints of a finger alike. Its first joint of
    the thumb is the carpometacarpal one, as in SMPL-X.

    Raises:
        InputError: the file is damaged or something else.
    """
    try:
        arrays = read_npz(path, ("joints_mm", "palm_pos_normal_dir", "is_right", "confidence"))
        joints, palm = arrays["joints_mm"].astype(float), arrays["palm_pos_normal_dir"].astype(float)
        right, confidence = arrays["is_right"], arrays["confidence"]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"{path} is no hand recording ({error}); expected an npz file with joints_mm, palm_pos_normal_dir, "
            "is_right and confidence."
        ) from error
    if joints.shape[1:] != (5, 4, 3) or palm.shape != (len(joints), 3, 3):
        raise InputError(f"{path} holds joints of shape {joints.shape}, expected (frames, 5, 4, 3).")
    along, back = palm[:, 2], -palm[:, 1]
    across = np.cross(along, back) * np.where(right, -1.0, 1.0)[:, None]
    bones = np.diff(joints, axis=2)[:, [_LEAP_FINGERS.index(finger) for finger in FINGERS]]
    axes = np.stack([along, back, across], axis=1)
    directions = unit(np.einsum("nab,nfkb->nfka", axes, bones))
    return Recording(name=path.stem, directions=directions[confidence > _CONFIDENT])


def aligned(recordings: list[Recording]) -> list[Recording]:
    """The palm's axes turned about its normal so that a middle finger points straight ahead in the median.

    The sensor's palm direction lies 9 degrees off the middle finger's own.
    """
    middle = np.concatenate([r.directions for r in recordings])[:, FINGERS.index("middle"), 0]
    middle = middle[middle[:, 0] > 0.8]
    angle = float(np.median(np.arctan2(middle[:, 2], middle[:, 0])))
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    return [Recording(name=r.name, directions=r.directions @ turn.T) for r in recordings]


def joint_angles(directions: Float[np.ndarray, "N 5 3 3"], hand: HandSkeleton) -> Float[np.ndarray, "n 45"]:
    """Angles (radians) that turn the hand's bones into these directions, of the frames where that is possible.

    Damped least squares, every finger by itself. Long fingers flex in all joints and spread and twist a little at the
    knuckle; the thumb also twists at its root and spreads at its second joint.
    """
    frames = len(directions)
    target = torch.as_tensor(directions).flatten(0, 1)
    constants = [
        torch.as_tensor(a).repeat(frames, *[1] * (a.ndim - 1))
        for a in (hand.axes, unit(np.diff(hand.points, axis=1)), 1 / _tolerance())
    ]
    x = _minimised(torch.as_tensor(_start(directions)).flatten(0, 1).flatten(1), target, *constants)
    miss = _DIRECTION * torch.func.vmap(_residual)(x, target, *constants)[:, :9].reshape(frames, 15, 3).norm(dim=-1)
    twist = x.view(frames, len(FINGERS), 9)[..., TWIST].abs().amax(1)
    return x.view(frames, 45)[(miss.amax(1) < _TOO_FAR) & (twist < _TOO_TWISTED)].numpy()


def _tolerance() -> Float[np.ndarray, "5 3 3"]:
    """Radians by which each angle may leave zero: wide for what a joint can do, none for what it cannot."""
    tolerance = np.full((len(FINGERS), 3, 3), 1e-3)
    tolerance[..., FLEXION] = 2.0
    tolerance[:, 0, SPREAD] = 1.0
    tolerance[:, 0, TWIST] = 0.2
    thumb = FINGERS.index("thumb")
    tolerance[thumb, 0] = [2.0, 2.0, 0.4]
    tolerance[thumb, 1, SPREAD] = 0.15
    return tolerance


def _start(directions: Float[np.ndarray, "N 5 3 3"]) -> Float[np.ndarray, "N 5 3 3"]:
    """Flexion as the bones of the long fingers bend against each other: from zero some went the long way round."""
    start = np.zeros((*directions.shape[:2], 3, 3))
    long = slice(0, FINGERS.index("thumb"))
    first = directions[:, long, 0]
    start[:, long, 0, FLEXION] = np.arctan2(-first[..., 1], first[..., 0])
    cosine = (directions[:, long, 1:] * directions[:, long, :-1]).sum(-1)
    start[:, long, 1:, FLEXION] = np.arccos(np.clip(cosine, -1, 1))
    return start


def _residual(x: Tensor, target: Tensor, axes: Tensor, bones: Tensor, stiffness: Tensor) -> Float[Tensor, "18"]:
    """Of one finger: bones against directions, then angles against zero."""
    turns = rotations.exp(x.view(3, 3) @ axes)
    second = turns[0] @ turns[1]
    posed = torch.stack([turns[0] @ bones[0], second @ bones[1], second @ turns[2] @ bones[2]])
    return torch.cat([((posed - target) / _DIRECTION).flatten(), x * stiffness.flatten()])


def _minimised(x: Float[Tensor, "n 9"], *constants: Tensor) -> Float[Tensor, "n 9"]:
    """Levenberg-Marquardt of all fingers at once."""
    residual, jacobian = torch.func.vmap(_residual), torch.func.vmap(torch.func.jacfwd(_residual))
    damping = x.new_full((len(x), 1), 1e-2)
    r = residual(x, *constants)
    for _ in range(_ROUNDS):
        j = jacobian(x, *constants)
        gradient = (j.mT @ r[..., None])[..., 0]
        trial = x - torch.linalg.solve(j.mT @ j + torch.diag_embed(damping.expand_as(x)), gradient)
        new = residual(trial, *constants)
        better = (new.square().sum(1) < r.square().sum(1))[:, None]
        x, r = torch.where(better, trial, x), torch.where(better, new, r)
        damping = torch.where(better, damping / 4, damping * 8)
    return x
