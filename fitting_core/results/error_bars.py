"""Error bars of a fit: within them lie 68 % of the errors."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from fitting_core.body import model

JOINTS = model.JOINTS[:22]
"""Joints with error bars: the body's, without hands and face."""
_OF_SIDES = ("hip_flexion", "knee_flexion", "elbow_flexion", "shoulder_elevation", "ankle_dorsiflexion")
ANGLES = (
    *(f"{side}_{angle}" for angle in _OF_SIDES for side in ("left", "right")),
    *(f"lumbar_{angle}" for angle in ("extension", "bending", "rotation")),
)
"""Angles with error bars, named and measured as in `measure.angles`. Only ever added to: files have the first alone."""
DIRECTIONS = ("along", "across")
"""The camera's ray through the joint: along it, and across it in any direction."""
WIDER = 2.2
"""Factor from an error bar (68 %) to the bound of 95 % of the errors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorBars:
    """Of T frames; NaN where they are not known. Errors of a clip last: they do not average out over its frames."""

    joints: Float32[np.ndarray, "T 22 2"]
    """Of JOINTS relative to the pelvis, metres, along the camera's ray and across it; 0 of the pelvis itself."""
    angles: Float32[np.ndarray, "T 13"]
    """Of ANGLES, degrees."""

    @staticmethod
    def unknown(frames: int) -> "ErrorBars":
        """Nothing is known of any frame."""
        joints, angles = ((frames, len(JOINTS), len(DIRECTIONS)), (frames, len(ANGLES)))
        return ErrorBars(joints=np.full(joints, np.nan, np.float32), angles=np.full(angles, np.nan, np.float32))

    def __len__(self) -> int:
        return len(self.joints)

    def __getitem__(self, frames: slice | list[int]) -> "ErrorBars":
        return ErrorBars(joints=self.joints[frames], angles=self.angles[frames])

    def with_frames(self, frames: range, other: "ErrorBars") -> "ErrorBars":
        """A copy in which `frames` are as `other` has them, one after the other."""
        joints, angles = self.joints.copy(), self.angles.copy()
        joints[frames.start : frames.stop], angles[frames.start : frames.stop] = other.joints, other.angles
        return ErrorBars(joints=joints, angles=angles)


_FIRST = 6
"""Of ANGLES, those that files of earlier versions have."""
_NAMES = ("joint_error_bars", "angle_error_bars")


def error_bar_arrays(bars: ErrorBars | None) -> dict[str, np.ndarray]:
    """As arrays of npz files; none of them without error bars."""
    return {} if bars is None else dict(zip(_NAMES, (bars.joints, bars.angles), strict=True))


def error_bars_from(arrays: Mapping[str, np.ndarray], frames: int) -> ErrorBars | None:
    """What `error_bar_arrays` made; None where there is nothing of it, as in files of earlier versions.

    Raises:
        KeyError: Only a part of it is there.
        ValueError: An array has another shape than it should, or holds what cannot be.
    """
    if not any(name in arrays for name in _NAMES):
        return None
    found = ErrorBars.unknown(frames)
    for name, like in error_bar_arrays(found).items():
        array, known = arrays[name], like
        if name == _NAMES[1] and array.shape == (frames, _FIRST):  # of an earlier version
            known = like[:, :_FIRST]
        if array.shape != known.shape:
            raise ValueError(f"{name} has the shape {array.shape}, expected {like.shape}")
        if (array < 0).any():
            raise ValueError(f"{name} has values below 0")
        known[:] = array
    return found
