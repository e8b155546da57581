"""When a hand moves, is held and rests, by the speed of its wrist against the trunk.

What linguists call phases of movement (Kita, van Gijn and van der Hulst, "Movement phases in signs and co-speech
gestures, and their transcription by human coders", 1998) are distinguished by meaning: preparation, stroke, retraction.
A speed shows only movement and hold, as in Liddell and Johnson's "American Sign Language: The phonological
base" (1989), and a position shows rest. Only these three are distinguished.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from fitting_core.body.geometry import unit
from fitting_core.body.model import JOINT
from fitting_core.frame_runs import runs_where
from fitting_core.keypoints import Side

REST, MOVEMENT, HOLD = ("rest", "movement", "hold")


_FAST, _SLOW = 0.25, 0.14
"""Metres per second: a movement reaches the first somewhere, and lasts as long as the wrist is faster than the second.
One value alone would make ten movements of a speed that wavers about it. `evaluation/RESULTS/hands.md` has what these
values give."""
_MOVEMENT, _HOLD = 0.08, 0.10
"""Seconds: anything shorter does not count as a movement, and shorter stops between two movements are part of them,
such as where a movement turns back."""
_LOW = 0.3
"""An unmoved hand rests if its wrist is lower than this share of the way from the hips up to the neck."""
_BLUR = 0.02
"""Seconds: standard deviation of the Gaussian by which the path is smoothed before it is derived."""


@dataclass(frozen=True, kw_only=True)
class Span:
    """Consecutive frames with a label."""

    frames: range
    """Counted from the clip's first (0)."""
    label: str


def spans_of(labels: Sequence[str]) -> list[Span]:
    """The longest stretches of one label each, in order; frames with an empty label are in none."""
    changes = [t for t in range(1, len(labels)) if labels[t] != labels[t - 1]]
    starts, stops = [0, *changes], [*changes, len(labels)]
    found = (Span(frames=range(a, b), label=labels[a]) for a, b in zip(starts, stops, strict=True) if a < b)
    return [span for span in found if span.label]


def without_short(where: Bool[np.ndarray, "T"], shortest: int) -> Bool[np.ndarray, "T"]:
    """The same without stretches of fewer frames than `shortest`."""
    kept = where.copy()
    for run in runs_where(where):
        if len(run) < shortest:
            kept[run] = False
    return kept


def wrist_in_chest(joints: Float[np.ndarray, "T 55 3"], side: Side) -> Float[np.ndarray, "T 3"]:
    """Where a wrist is for the chest: metres from it, x to the person's left, y up the spine, z forward.

    Args:
        joints: Kinematic joints in any space, metres.
        side: Of the hand.
    """
    chest, neck = joints[:, JOINT["spine3"]], joints[:, JOINT["neck"]]
    # The collars hang on the chest's joint, so shrugs do not move them; shoulders would.
    across = unit(joints[:, JOINT["left_collar"]] - joints[:, JOINT["right_collar"]])
    forward = unit(np.cross(across, neck - chest))
    axes = np.stack([across, np.cross(forward, across), forward], 1)
    return np.einsum("tad,td->ta", axes, joints[:, JOINT[f"{side}_wrist"]] - chest)


def wrist_speed(
    joints: Float[np.ndarray, "T 55 3"], side: Side, frame_rate: float, *, blur: float = 0.0
) -> Float[np.ndarray, "T"]:
    """Speed of a wrist against the chest, metres per second, by central differences; 0 in a clip of one frame.

    Args:
        joints: Kinematic joints in any space, metres.
        side: Of the hand.
        frame_rate: Frames per second.
        blur: Seconds: standard deviation of the Gaussian by which the path is smoothed before.
    """
    path = wrist_in_chest(joints, side)
    if len(path) < 2:
        return np.zeros(len(path))
    if blur > 0:
        path = gaussian_filter1d(path, blur * frame_rate, axis=0, mode="nearest")
    return np.linalg.norm(np.gradient(path, 1 / frame_rate, axis=0), axis=1)


def wrist_height(joints: Float[np.ndarray, "T 55 3"], side: Side) -> Float[np.ndarray, "T"]:
    """How high a wrist is along the trunk: 0 at the hips, 1 at the neck."""
    hips = (joints[:, JOINT["left_hip"]] + joints[:, JOINT["right_hip"]]) / 2
    trunk = joints[:, JOINT["neck"]] - hips
    return ((joints[:, JOINT[f"{side}_wrist"]] - hips) * trunk).sum(1) / (trunk**2).sum(1)


def hand_phases(joints: Float[np.ndarray, "T 55 3"], side: Side, frame_rate: float) -> list[Span]:
    """What a hand does: every frame is in one span, which is called "movement", "hold" or "rest".

    Args:
        joints: Kinematic joints of all frames in any space, metres.
        side: Of the hand.
        frame_rate: Frames per second.
    """
    speed = wrist_speed(joints, side, frame_rate, blur=_BLUR)
    moving = _moving(speed, frame_rate)
    height = wrist_height(joints, side)
    found = []
    for span in spans_of([MOVEMENT if moves else HOLD for moves in moving]):
        rests = span.label == HOLD and np.median(height[span.frames]) < _LOW
        found.append(Span(frames=span.frames, label=REST if rests else span.label))
    return found


def _moving(speed: Float[np.ndarray, "T"], frame_rate: float) -> Bool[np.ndarray, "T"]:
    """Hysteresis: frames above _SLOW in a stretch that reaches _FAST; short stretches are dropped."""
    faster = speed > _SLOW
    reached = np.zeros(len(speed), bool)
    for run in runs_where(faster):
        reached[run] = speed[run].max() >= _FAST
    still = without_short(~reached, math.ceil(_HOLD * frame_rate))
    for run in runs_where(~reached):
        # A stop at the clip's first or last frame continues outside the clip.
        still[run] |= run.start == 0 or run.stop == len(still)
    return without_short(~still, math.ceil(_MOVEMENT * frame_rate))
