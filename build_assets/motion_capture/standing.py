"""Knees of people who stand, where a skeleton was laid into all subjects' markers whose legs are longer than theirs.

Retargeting stretches the legs of each clip until the straightest moments are straight. Standing knees of CMU's subjects
are then still bent by 18 to 35 degrees in the median, where ten people with markers of their own have 4 (UI-PRMD).
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.retarget import MotionClip
from build_assets.motion_capture.rigs import RIGS
from fitting_core.body.model import JOINT

_STILL, _UPRIGHT, _MOST_BENT = 0.2, 20.0, 45.0
"""Metres per second of a foot, degrees of the pelvis' lean and of the knee up to which a leg counts as standing."""
_STRAIGHTER = 75.0
"""Per cent of a subject's standing legs that are bent by more than what is taken for a straight one."""
_STANDING_KNEE = 5.0
"""Degrees that this one is bent by."""
_LONGEST = 1.03
"""Factor by which bones are taken to be too long at most."""
_FEWEST = 60
"""Standing legs by which a subject is judged; else all subjects together."""


def standing_straight(clips: Sequence[MotionClip]) -> list[MotionClip]:
    """The clips with legs of the length that each subject has; those of rigs whose bones fit stay as they are.

    The ankle keeps its direction from the hip, and the foot its rotation: hip and ankle move apart.
    """
    reaches: dict[str, list[np.ndarray]] = defaultdict(list)
    for clip in clips:
        if RIGS[clip.source].legs_too_long:
            reaches[clip.subject].append(_reach(_knees(clip))[_stands(clip)])
    own = {subject: np.concatenate(values) for subject, values in reaches.items()}
    everybody = np.concatenate([*own.values(), np.ones(1)])
    enough = {subject: values if len(values) >= _FEWEST else everybody for subject, values in own.items()}
    straight = float(np.cos(np.radians(_STANDING_KNEE) / 2))
    factors = {
        subject: float(np.clip(straight / np.percentile(values, _STRAIGHTER), 1, _LONGEST))
        for subject, values in enough.items()
    }
    return [_stretched(clip, factors.get(clip.subject, 1.0), straight) for clip in clips]


def _knees(clip: MotionClip) -> Float[np.ndarray, "T 2"]:
    """Radians that the left and the right knee are bent by."""
    joints = clip.body_pose.reshape(len(clip.body_pose), -1, 3)
    return joints[:, [JOINT[f"{side}_knee"] - 1 for side in ("left", "right")], 0]


def _reach(bent: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """From hip to ankle, as a part of the leg's length; thigh and shank are taken to be alike."""
    return np.cos(bent / 2)


def _stands(clip: MotionClip) -> Bool[np.ndarray, "T 2"]:
    if len(clip.feet) < 2:
        return np.zeros((len(clip.feet), 2), bool)
    speed = np.linalg.norm(np.gradient(clip.feet, axis=0), axis=2) * clip.fps
    upright = clip.orient[:, 1, 1] > np.cos(np.radians(_UPRIGHT))
    return (speed < _STILL) & upright[:, None] & (np.degrees(_knees(clip)) < _MOST_BENT)


def _stretched(clip: MotionClip, factor: float, straight: float) -> MotionClip:
    if factor == 1:
        return clip
    joints = clip.body_pose.reshape(len(clip.body_pose), -1, 3).copy()
    for side, bent in zip(("left", "right"), _knees(clip).T, strict=True):
        reach = _reach(bent)
        farther = np.maximum(reach, np.minimum(factor * reach, straight))
        half = bent / 2 - np.arccos(farther)
        turn = Rotation.from_rotvec(half[:, None] * (1.0, 0.0, 0.0))
        for name, turned in (
            ("hip", lambda now, turn=turn: now * turn),
            ("knee", lambda now, turn=turn: turn.inv() * now * turn.inv()),
            ("ankle", lambda now, turn=turn: turn * now),
        ):
            column = JOINT[f"{side}_{name}"] - 1
            joints[:, column] = turned(Rotation.from_rotvec(joints[:, column])).as_rotvec()
    return replace(clip, body_pose=joints.reshape(len(joints), -1))
