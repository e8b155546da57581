"""From the normal equations' deviations to error bars, calibrated on errors of the motion suite and of real clips.

    error bar = sqrt((factor x deviation)^2 + least^2 + lasting^2 + lens^2)

for each part of the body and each direction. The factor makes up for persistent errors (a detector's and the lifter's
do not average out over frames, as J^T J assumes), the least error for what the deviations do not include: the shape,
and a person's true joint positions. Both are the motion suite's. The lasting error is what real clips have beyond that
for all their frames: proportions, where detectors see a joint, the lifter's own.

The lens counts where its focal length is estimated: a person at the angle a from the camera's axis is seen from the
same side whatever it is, and so turns by sin(a) cos(a) times the deviation of its logarithm.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.temporal import JointPositions
from fitting_core.fit.uncertainty.deviations import deviations
from fitting_core.fit.uncertainty.measured import LASTING, LIKE, OF_ANGLES, OF_JOINTS
from fitting_core.fit.variables.state import State
from fitting_core.results.error_bars import ANGLES, JOINTS, ErrorBars

_EXACT = ((1.0, 0.0), (1.0, 0.0))
"""Of the pelvis, to which all others are relative."""


def error_bars(stages: Stages, state: State) -> ErrorBars | None:
    """Error bars of a state found by phase 3; None if the lifter is not used, for which none were measured.

    Takes the arguments of `deviations`.
    """
    if not any(stages.config.weights.relative_position):
        return None
    bars, deviation = calibrated(deviations(stages, state)), stages.camera.focal_deviation
    if deviation is None:
        return bars
    joints = JointPositions(stages.body, stages.parametrisation, in_camera=True).estimate(state).in_camera
    turned = by_lens(joints[:, : len(JOINTS)].double().cpu().numpy(), deviation)
    return replace(bars, joints=np.hypot(bars.joints, turned).astype(np.float32))


def calibrated(found: ErrorBars) -> ErrorBars:
    """Error bars from the normal equations' deviations."""
    of_joints = np.array([OF_JOINTS.get(part_of(name), _EXACT) for name in JOINTS])
    of_angles = np.array([OF_ANGLES[part_of(name)] for name in ANGLES])
    lasting = np.array([LASTING.get(LIKE.get(part_of(name), part_of(name)), (0.0, 0.0)) for name in JOINTS])
    joints = np.hypot(_widened(found.joints, of_joints), lasting).astype(np.float32)
    return ErrorBars(joints=joints, angles=_widened(found.angles, of_angles))


def by_lens(joints: Float[np.ndarray, "T J 3"], deviation: float) -> Float[np.ndarray, "T J 2"]:
    """Metres by which joints relative to the first are off along and across the ray for a lens that is off.

    Args:
        joints: camera space, metres; the first is the pelvis.
        deviation: of the logarithm of the focal length.
    """
    ray = joints[:, 0] / np.linalg.norm(joints[:, 0], axis=-1, keepdims=True)
    # The axis of the turn, as long as sin(a) cos(a), times the position from the pelvis.
    axis = deviation * ray[:, 2:] * np.cross(ray, [0.0, 0.0, 1.0])
    off = np.cross(axis[:, None], joints - joints[:, :1])
    along = (off * ray[:, None]).sum(-1)
    return np.stack([abs(along), np.sqrt((np.square(off).sum(-1) - along**2) / 2)], -1)


def _widened(values: np.ndarray, table: np.ndarray) -> np.ndarray:
    return np.hypot(table[..., 0] * values, table[..., 1]).astype(np.float32)


def part_of(name: str) -> str:
    """Of a joint or an angle, without its side: knee_flexion of left_knee_flexion, spine of spine2."""
    return name.removeprefix("left_").removeprefix("right_").rstrip("123")
