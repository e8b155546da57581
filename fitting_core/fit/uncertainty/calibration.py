"""From the normal equations' deviations to error bars, calibrated on the motion suite's errors.

    error bar = sqrt((factor x deviation)^2 + least^2)

for each part of the body and each direction. The factor makes up for persistent errors (a detector's and the lifter's
do not average out over frames, as J^T J assumes), the least error for what the deviations do not include: the shape,
and a person's true joint positions.
"""

import numpy as np

from fitting_core.fit.stages import Stages
from fitting_core.fit.uncertainty.deviations import deviations
from fitting_core.fit.uncertainty.measured import OF_ANGLES, OF_JOINTS
from fitting_core.fit.variables.state import State
from fitting_core.results.error_bars import ANGLES, JOINTS, ErrorBars

_EXACT = ((1.0, 0.0), (1.0, 0.0))
"""Of the pelvis, to which all others are relative."""


def error_bars(stages: Stages, state: State) -> ErrorBars | None:
    """Error bars of a state found by phase 3; None if the lifter is not used, for which none were measured.

    Takes the arguments of `deviations`.
    """
    return calibrated(deviations(stages, state)) if any(stages.config.weights.relative_position) else None


def calibrated(found: ErrorBars) -> ErrorBars:
    """Error bars from the normal equations' deviations."""
    of_joints = np.array([OF_JOINTS.get(part_of(name), _EXACT) for name in JOINTS])
    of_angles = np.array([OF_ANGLES[part_of(name)] for name in ANGLES])
    return ErrorBars(joints=_widened(found.joints, of_joints), angles=_widened(found.angles, of_angles))


def _widened(values: np.ndarray, table: np.ndarray) -> np.ndarray:
    return np.hypot(table[..., 0] * values, table[..., 1]).astype(np.float32)


def part_of(name: str) -> str:
    """Of a joint or an angle, without its side: knee_flexion of left_knee_flexion, spine of spine2."""
    return name.removeprefix("left_").removeprefix("right_").rstrip("123")
