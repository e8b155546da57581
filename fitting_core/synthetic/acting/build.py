"""Measures of a body that a script is fitted to, so that large, small and heavy people all stand, sit and reach."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting_core.body.model import JOINT, BodyModel

_LEG, _ARM, _HALF_WIDTH = 0.820, 0.496, 0.195
"""Of the free neutral body's mean shape, for which scripts are written, metres."""


@dataclass(frozen=True, kw_only=True)
class Build:
    """A body's measures against those of the free neutral body's mean shape."""

    leg: float
    """Ratio of the lengths from hip to ankle."""
    arm: float
    """Ratio of the lengths from shoulder to wrist."""
    stout: float
    """How much wider half the hips are, metres."""

    @staticmethod
    def of(body: BodyModel, betas: Sequence[float]) -> "Build":
        """Measures of a shape in the rest pose."""
        shaped = body.with_shape(betas)
        joints = shaped.rest_joints
        bone = [np.linalg.norm(joints[JOINT[a]] - joints[JOINT[b]]) for a, b in _BONES]
        hips = shaped.template[abs(shaped.template[:, 1] - joints[JOINT["left_hip"], 1]) < 0.05]
        return Build(
            leg=float(bone[0] + bone[1]) / _LEG,
            arm=float(bone[2] + bone[3]) / _ARM,
            stout=float(abs(hips[:, 0]).max()) - _HALF_WIDTH,
        )


_BONES = (
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
)
