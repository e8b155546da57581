"""Values over the frames of a clip: the timeline's curves by name, and the distance between two runs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32

from fitting_core.body.model import JOINT, N_JOINTS
from fitting_core.errors import InputError
from fitting_core.fit.terms.temporal import off_mean
from fitting_core.keypoints import COUNT, GROUPS, INDEX, SIDES, Side
from fitting_core.measure.angles.joint_angles import joint_angle
from fitting_core.measure.hands.phases import wrist_speed
from fitting_core.results.error_bars import ANGLES
from tcfit_app.analysis.body_regions import REGIONS
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.seen import evident, seen_joints


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A number for each frame of a clip."""

    name: str
    title: str
    unit: str
    values: Float[np.ndarray, "T"]
    """NaN where missing."""
    error_bars: Float[np.ndarray, "T"] | None = None
    """Error bars: 68 % of errors lie within; None if unknown."""
    unseen: Bool[np.ndarray, "T"] | None = None
    """Frames in which keypoints do not show what it measures; None: in no frame."""


@dataclass(frozen=True, kw_only=True)
class CurveKind:
    """How a curve is computed."""

    title: str
    group: Literal["Errors", "Motion", "Height and depth", "Joint angles"]
    """Its place in menus."""
    unit: str
    values: Callable[[PosedFit], Float[np.ndarray, "T"]]
    """A frame's value may depend on its neighbours, and on no other frames."""
    angle: int | None = None
    """The error bars it uses, one of `error_bars.ANGLES`."""
    moved_by: tuple[str, ...] = ()
    """The joints whose parts must be seen; empty: any part of the body."""

    def unseen(self, fit: PosedFit) -> Bool[np.ndarray, "T"]:
        """Frames in which keypoints do not show what it measures."""
        seen = seen_joints(evident(fit.clip.keypoints))
        seen = seen[:, [JOINT[name] for name in self.moved_by]].all(1) if self.moved_by else seen.any(1)
        return np.asarray(~seen)


def curve(name: str, fit: PosedFit) -> Curve:
    """A whole curve by its name in CURVES, over all frames of a clip."""
    kind = CURVES[name]
    values = kind.values(fit) if fit.there is None else np.where(fit.there, kind.values(fit), np.nan)
    bars = None if fit.error_bars is None or kind.angle is None else fit.error_bars.angles[:, kind.angle]
    unseen = kind.unseen(fit) if fit.tracked.any() else None
    return Curve(name=name, title=kind.title, unit=kind.unit, values=values, error_bars=bars, unseen=unseen)


def weighted_mean(values: Float[np.ndarray, "T K"], weights: Float[np.ndarray, "T K"]) -> Float[np.ndarray, "T"]:
    """Mean over K ignoring NaN; NaN if all are."""
    weights = np.where(np.isfinite(values), weights, 0)
    total = weights.sum(1)
    mean = (np.nan_to_num(values) * weights).sum(1) / np.where(total > 0, total, 1)
    return np.where(total > 0, mean, np.nan)


def _reprojection(*groups: slice) -> Callable[[PosedFit], Float[np.ndarray, "T"]]:
    """The mean in the worst region: over all keypoints, an arm that is off would not show. Neck and mid hip are the
    middle of other keypoints, and the body's are elsewhere: off in every frame, they would hide everything else."""
    judged = {joint for group in groups for joint in range(COUNT)[group]} - {INDEX["neck"], INDEX["mid_hip"]}
    regions = [own for joints in REGIONS.values() if (own := [joint for joint in joints if joint in judged])]

    def worst(fit: PosedFit) -> Float[np.ndarray, "T"]:
        confidence = fit.clip.keypoints.confidence
        means = np.stack([weighted_mean(fit.errors[:, own], confidence[:, own]) for own in regions])
        return np.fmax.reduce(means)  # NaN where all are

    return worst


def _confidence(fit: PosedFit) -> Float[np.ndarray, "T"]:
    if not fit.tracked.any():
        return np.full(len(fit), np.nan)
    return fit.clip.keypoints.confidence[:, fit.tracked].mean(1)


def _temporal_residual(fit: PosedFit) -> Float[np.ndarray, "T"]:
    uneven = off_mean(torch.tensor(fit.compared_joints.reshape(len(fit), -1)))
    residual = np.full(len(fit), np.nan)
    residual[1:-1] = 1e3 * uneven.norm(dim=1).numpy() / np.sqrt(N_JOINTS)
    return residual


def _speed(side: Side) -> Callable[[PosedFit], Float[np.ndarray, "T"]]:
    return lambda fit: wrist_speed(fit.joints, side, fit.clip.frame_rate)


def _height(joint: str) -> Callable[[PosedFit], Float[np.ndarray, "T"]]:
    """Above the floor; NaN without a floor."""

    def values(fit: PosedFit) -> Float[np.ndarray, "T"]:
        if fit.grounding is None or fit.grounding.ground is None:
            return np.full(len(fit), np.nan)
        return fit.grounding.ground.height(fit.still_joints[:, JOINT[joint]])

    return values


def _angle(name: str) -> Callable[[PosedFit], Float[np.ndarray, "T"]]:
    return lambda fit: joint_angle(fit.motion, name)


def _angle_title(name: str) -> str:
    *joint, angle = name.replace("lumbar", "lumbar_spine").split("_")
    return f"{angle.capitalize()} of the {' '.join(joint)}"


_BONES = {"hip": ("pelvis", "hip"), "knee": ("hip", "knee"), "ankle": ("knee", "ankle"), "lumbar": ("pelvis",)} | {
    "shoulder": ("pelvis", "shoulder"),
    "elbow": ("shoulder", "elbow"),
}
"""By joint, what moves the two segments between which its angles are."""


def _bones(angle: str) -> tuple[str, ...]:
    *side, joint, _ = angle.split("_")
    return tuple("_".join((*side, bone)) if bone != "pelvis" else bone for bone in _BONES[joint])


_HEIGHTS = {"pelvis": "pelvis"} | {
    f"{side}_{end}": f"{side}_{by}" for end, by in (("wrist", "elbow"), ("ankle", "knee")) for side in SIDES
}
"""Joints with a curve of their height, and what moves them."""

CURVES: dict[str, CurveKind] = {
    "reprojection": CurveKind(
        title="Reprojection error", group="Errors", unit="px", values=_reprojection(*GROUPS.values())
    ),
    **{
        f"reprojection_{name}": CurveKind(
            title=f"Reprojection error, {name.replace('_', ' ')}", group="Errors", unit="px", values=_reprojection(part)
        )
        for name, part in GROUPS.items()
    },
    "confidence": CurveKind(title="Mean confidence", group="Errors", unit="", values=_confidence),
    "jitter": CurveKind(title="Jitter", group="Motion", unit="mm/frame²", values=lambda fit: fit.jumps.mean(1)),
    "temporal": CurveKind(title="Temporal residual", group="Motion", unit="mm", values=_temporal_residual),
    **{
        f"{side}_wrist": CurveKind(
            title=f"Speed of the {side} wrist",
            group="Motion",
            unit="m/s",
            values=_speed(side),
            moved_by=(f"{side}_elbow",),
        )
        for side in SIDES
    },
    "depth": CurveKind(
        title="Depth of the pelvis", group="Height and depth", unit="m", values=lambda fit: fit.root[:, 2]
    ),
    **{
        f"{joint}_height": CurveKind(
            title=f"Height of the {joint.replace('_', ' ')}",
            group="Height and depth",
            unit="m",
            values=_height(joint),
            moved_by=(by,),
        )
        for joint, by in _HEIGHTS.items()
    },
    **{
        name: CurveKind(
            title=_angle_title(name),
            group="Joint angles",
            unit="°",
            values=_angle(name),
            angle=i,
            moved_by=_bones(name),
        )
        for i, name in enumerate(ANGLES)
    },
}
"""By name. Reprojection errors are confidence-weighted means over the counted keypoints of a region (an arm, a hand,
the face), and the largest of these; the mean confidence is over keypoints detected in any frame; the temporal residual
is the root mean square over joints of what E_T penalises, in the space in which the fit compares joints; wrist speeds
are relative to the chest.
"""


# --- two runs ---

BETWEEN = "between_runs"
"""Name of the curve."""


def vertex_distances(one: Float32[np.ndarray, "V 3"], other: Float32[np.ndarray, "V 3"]) -> Float32[np.ndarray, "V"]:
    """Distance between the same vertex of two runs in one frame, in millimetres, for colouring a mesh.

    Both are from `Meshes.vertices`, in metres. Raises InputError if the bodies have different meshes.
    """
    if len(one) != len(other):
        raise InputError(
            f"The bodies cannot be compared vertex by vertex: they have {len(one)} and {len(other)} vertices. Compare "
            "runs of one body model."
        )
    return 1e3 * np.linalg.norm(other - one, axis=-1)


def between_runs(a: PosedFit, b: PosedFit) -> Curve:
    """Mean distance of the 55 joints of two runs of one clip by frame, in millimetres; their bodies may differ."""
    values = 1e3 * np.linalg.norm(b.joints - a.joints, axis=-1).mean(1)
    return Curve(name=BETWEEN, title="Distance between the fits", unit="mm", values=values)
