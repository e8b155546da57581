"""How right a fit is in the third dimension: curves over a clip of the motion suite, and figures."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from evaluation.synthetic.motion_suite.clips import MotionClipMade
from evaluation.synthetic.motion_suite.windows import speeds
from fitting_core import keypoints as kp
from fitting_core import metrics
from fitting_core.body.model import JOINT
from fitting_core.measure.limbs import HIPS

LIMB_JOINTS = [JOINT[kp.NAMES[i]] for i in kp.LIMBS]
"""SMPL-X's joints of the same names as `keypoints.LIMBS`."""
LIMB_PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_ANKLES = [JOINT["left_ankle"], JOINT["right_ankle"]]
_FEWEST = 4
"""Joints in the image without which a frame is not aligned on these."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthPair:
    """A fit's joints beside the true ones, camera space, metres."""

    made: MotionClipMade
    joints: Float[np.ndarray, "T 55 3"]

    @property
    def limbs(self) -> tuple[Float[np.ndarray, "T 12 3"], Float[np.ndarray, "T 12 3"]]:
        """The fit's and the true limb joints."""
        return self.joints[:, LIMB_JOINTS], self.made.truth.joints[:, LIMB_JOINTS]


@dataclass(frozen=True, kw_only=True)
class DepthCurve:
    """Something that is measured in every frame; NaN where it cannot be."""

    title: str
    unit: str
    values: Callable[[DepthPair], Float[np.ndarray, "T"]]
    statistics: tuple[Literal["mean", "p90"], ...] = ("mean",)
    digits: int = 1


def _pa_in_image(pair: DepthPair) -> Float[np.ndarray, "T"]:
    """Aligned and measured on those limb joints alone that lie in the image."""
    (found, true), inside = pair.limbs, pair.made.inside[:, LIMB_JOINTS]
    values = np.full(len(found), np.nan)
    for pattern in np.unique(inside, axis=0):
        if pattern.sum() >= _FEWEST:
            frames = (inside == pattern).all(1)
            values[frames] = metrics.pa_mpjpe(found[frames][:, pattern], true[frames][:, pattern])
    return values


def _trunk(joints: Float[np.ndarray, "T 55 3"]) -> Float[np.ndarray, "T 3"]:
    """Unit vector from pelvis to neck."""
    up = joints[:, JOINT["neck"]] - joints[:, JOINT["pelvis"]]
    return up / np.linalg.norm(up, axis=-1, keepdims=True)


def _lean(pair: DepthPair) -> Float[np.ndarray, "T"]:
    cosine = (_trunk(pair.joints) * _trunk(pair.made.truth.joints)).sum(1)
    return np.degrees(np.arccos(cosine.clip(-1, 1)))


def _nearer(pair: DepthPair) -> Float[np.ndarray, "T"]:
    """Degrees by which the fit's neck leans out of the image plane towards the camera more than the true one."""
    found, true = (np.degrees(np.arcsin(-_trunk(j)[:, 2].clip(-1, 1))) for j in (pair.joints, pair.made.truth.joints))
    return found - true


def _depth_error(pair: DepthPair) -> Float[np.ndarray, "T"]:
    """Of the pelvis, metres."""
    return abs(pair.joints - pair.made.truth.joints)[:, JOINT["pelvis"], 2]


def _acceleration(pair: DepthPair) -> Float[np.ndarray, "T"]:
    found, true = (metrics.rooted(points, HIPS) for points in pair.limbs)
    return metrics.acceleration_error(found, true, pair.made.clip.frame_rate)


def _slip(joints: Float[np.ndarray, "T 55 3"], pair: DepthPair) -> Float[np.ndarray, "T"]:
    """Mean speed of the feet that truly rest and are in the image; a camera that stands leaves speeds as they are."""
    still = pair.made.window.standing & pair.made.inside[:, _ANKLES]
    moved = np.where(still, 1e3 * speeds(joints[:, _ANKLES], pair.made.clip.frame_rate), 0).sum(1)
    return np.where(still.any(1), moved / np.maximum(still.sum(1), 1), np.nan)


def _of_part(part: str) -> Callable[[DepthPair], Float[np.ndarray, "T"]]:
    """Error of a part's joints that are in the image, the middle of the hips aligned, millimetres."""
    columns = [LIMB_JOINTS.index(JOINT[f"{side}_{part}"]) for side in ("left", "right")]

    def values(pair: DepthPair) -> Float[np.ndarray, "T"]:
        found, true = (metrics.rooted(points, HIPS)[:, columns] for points in pair.limbs)
        errors, inside = 1e3 * np.linalg.norm(found - true, axis=-1), pair.made.inside[:, LIMB_JOINTS][:, columns]
        total = np.where(inside, errors, 0).sum(1)
        return np.where(inside.any(1), total / np.maximum(inside.sum(1), 1), np.nan)

    return values


DEPTH_CURVES: dict[str, DepthCurve] = {
    "pa_mpjpe": DepthCurve(
        title="PA-MPJPE", unit="mm", values=lambda p: metrics.pa_mpjpe(*p.limbs), statistics=("mean", "p90")
    ),
    "mpjpe": DepthCurve(title="MPJPE", unit="mm", values=lambda p: metrics.mpjpe(*p.limbs, HIPS)),
    "pa_in_image": DepthCurve(title="PA-MPJPE in image", unit="mm", values=_pa_in_image),
    "lean": DepthCurve(title="Lean", unit="°", values=_lean),
    "nearer": DepthCurve(title="Neck nearer", unit="°", values=_nearer),
    "depth": DepthCurve(title="Depth", unit="mm", values=lambda p: 1e3 * _depth_error(p), digits=0),
    "depth_share": DepthCurve(
        title="Depth", unit="%", values=lambda p: 100 * _depth_error(p) / p.made.truth.joints[:, JOINT["pelvis"], 2]
    ),
    "acceleration": DepthCurve(title="Acceleration", unit="m/s²", values=_acceleration),
    "slip": DepthCurve(title="Slip", unit="mm/s", values=lambda p: _slip(p.joints, p), digits=0),
    "true_slip": DepthCurve(title="True slip", unit="mm/s", values=lambda p: _slip(p.made.truth.joints, p), digits=0),
}
"""Columns of the tables, by name. Lean: angle between pelvis to neck and the same of the truth."""
PART_CURVES: dict[str, DepthCurve] = {
    part: DepthCurve(title=part.capitalize(), unit="mm", values=_of_part(part)) for part in LIMB_PARTS
}


@dataclass(frozen=True, kw_only=True)
class DepthRecord:
    """One phase of one fit of one sequence, measured."""

    sequence: str
    method: str
    """"tcfit", "tcfit, phase 1"."""
    kind: str
    cut: str
    directions: tuple[str, ...]
    """For each frame."""
    seconds: float
    """What the fit took up to this phase."""
    curves: dict[str, tuple[float | None, ...]]
    """By name in CURVES and PART_CURVES, a number for each frame."""

    def curve(self, name: str) -> Float[np.ndarray, "T"]:
        """A curve with NaN where there is nothing."""
        return np.array([np.nan if value is None else value for value in self.curves[name]])


def measured(made: MotionClipMade, joints: Float[np.ndarray, "T 55 3"], *, method: str, seconds: float) -> DepthRecord:
    """Measure one phase of a fit, by its joints in camera space (metres)."""
    pair = DepthPair(made=made, joints=joints)
    found = {name: curve.values(pair) for name, curve in (DEPTH_CURVES | PART_CURVES).items()}
    return DepthRecord(
        sequence=made.sequence.name,
        method=method,
        kind=made.sequence.kind,
        cut=made.sequence.shot.cut,
        directions=tuple(made.directions),
        seconds=seconds,
        curves={name: tuple(float(v) if np.isfinite(v) else None for v in values) for name, values in found.items()},
    )


GROUPINGS: dict[str, Callable[[DepthRecord], Sequence[str]]] = {
    "": lambda record: ("all",) * len(record.directions),
    "view": lambda record: record.directions,
    "cut": lambda record: (record.cut,) * len(record.directions),
    "motion": lambda record: (record.kind,) * len(record.directions),
}
"""Groups of the frames: a label for each."""


def depth_figures(
    records: Iterable[DepthRecord], grouping: str, curves: dict[str, DepthCurve] = DEPTH_CURVES
) -> dict[str, dict[str, float | None]]:
    """Figures over all frames, by label and then by title with statistic and unit; None where nothing was measured."""
    pools: dict[str, dict[str, list[np.ndarray]]] = {}
    for record in records:
        labels = np.array(GROUPINGS[grouping](record))
        for label in dict.fromkeys(labels.tolist()):
            own = pools.setdefault(label, {name: [] for name in curves})
            for name in curves:
                own[name].append(record.curve(name)[labels == label])
    return {
        label: {
            titled(curve, statistic): _statistic(np.concatenate(own[name]), statistic)
            for name, curve in curves.items()
            for statistic in curve.statistics
        }
        for label, own in pools.items()
    }


def titled(curve: DepthCurve, statistic: str) -> str:
    """ "PA-MPJPE p90, mm"."""
    return f"{curve.title}{'' if statistic == 'mean' else ' ' + statistic}, {curve.unit}"


def _statistic(values: Float[np.ndarray, "n"], statistic: str) -> float | None:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    return float(finite.mean() if statistic == "mean" else np.percentile(finite, 90))
