"""All motion capture that something is trained on, and what is kept apart."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from build_assets.motion_capture.retarget import MotionClip, load
from fitting_core.body.model import JOINT

_FRAMES = 30
_SAME = 5.0
"""Degrees: root mean square of how elbows and knees differ over a second, up to which two captures are one. Copies
differ by 0.1 to 1.1 degrees, other people's motion of the same kind by 8 or more; what lies between is left out."""
_BENT = [JOINT[f"{side}_{name}"] - 1 for name in ("knee", "elbow") for side in ("left", "right")]
_MIRRORED = [1, 0, 3, 2]


def unlike(clips: Sequence[MotionClip], held: Sequence[MotionClip]) -> list[MotionClip]:
    """Those of the clips of which no second is in `held`, as captured or mirrored; all at about 30 frames a second."""
    others = [_bent(clip) for clip in held]
    windows = [np.lib.stride_tricks.sliding_window_view(b, _FRAMES, axis=0) for b in others if len(b) >= _FRAMES]
    return [clip for clip in clips if not any(_among(second, windows) for second in _seconds(_bent(clip)))]


def _bent(clip: MotionClip) -> Float[np.ndarray, "T 4"]:
    """Degrees of knees and elbows."""
    return np.degrees(np.linalg.norm(clip.body_pose.reshape(len(clip.body_pose), -1, 3)[:, _BENT], axis=2))


def _seconds(bent: Float[np.ndarray, "T 4"]) -> list[Float[np.ndarray, "30 4"]]:
    return [bent[start : start + _FRAMES] for start in range(0, len(bent) - _FRAMES + 1, _FRAMES)]


def _among(second: Float[np.ndarray, "30 4"], windows: Sequence[Float[np.ndarray, "n 4 30"]]) -> bool:
    sides = second.T, second.T[_MIRRORED]
    return any(
        float(np.sqrt(((window - side) ** 2).mean((1, 2)).min())) < _SAME for window in windows for side in sides
    )


HELD_OUT = ("cmu05", "cmu13", "cmu14")
"""Subjects that training never sees."""


def captured_motion(folder: Path) -> list[MotionClip]:
    """All clips that a folder holds.

    Raises:
        InputError: A file is missing or broken.
    """
    clips = load(folder)
    if (folder / "cmu_expmap").is_dir():
        clips += unlike(load(folder, ("cmu_expmap",)), split(clips)[1])
    return clips


def split(clips: Sequence[MotionClip]) -> tuple[list[MotionClip], list[MotionClip]]:
    """Clips to train on, and those of the subjects held out."""
    held = [clip for clip in clips if clip.subject in HELD_OUT]
    return [clip for clip in clips if clip.subject not in HELD_OUT], held
