"""Everything that is measured of one fit: one function for each group of figures, and the MEASURES table."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.signal import butter, sosfiltfilt

from benchmarks.clips import Sample
from build_assets.pose_prior.dataset import matrices
from build_assets.pose_prior.skeleton import Contact, Skeleton
from fitting_core import keypoints as kp
from fitting_core import metrics
from fitting_core.body.joint_ranges import joint_ranges
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.fit.terms.limits import AngleTable

CONFIDENT = 0.3
"""Detections above it count as seen."""
_HIPS = [kp.LIMBS.index(kp.INDEX[f"{side}_hip"]) for side in ("left", "right")]
_BODY_JOINTS = 22

Figures = dict[str, float]
"""Measured values; each name ends with its unit."""


@dataclass(frozen=True, kw_only=True)
class Posed:
    """A fit's points in camera space (metres), evaluated once for all measures."""

    sample: Sample
    points: Float[np.ndarray, "T 137 3"]
    joints: Float[np.ndarray, "T 55 3"]
    body: BodyModel
    body_pose: Float[torch.Tensor, "T 63"]
    pixel_errors: Float[np.ndarray, "T 137"]
    """Distance to the detections; NaN where nothing confident was detected or the body has no such point."""

    @staticmethod
    def of(sample: Sample, body: BodyModel, params: BodyParams) -> "Posed":
        """Evaluates all frames of a fit."""
        points, known = keypoints_in_space(body, params)
        camera, detected = sample.clip.camera, sample.clip.keypoints
        depth = np.where(points[..., 2:] > 0, points[..., 2:], np.nan)
        distance = np.linalg.norm(points[..., :2] / depth * camera.focal + camera.center - detected.xy, axis=-1)
        seen = (detected.confidence > CONFIDENT) & known
        joints = Mesh(body, dtype=torch.float64).joints(params).numpy()
        errors = np.where(seen, distance, np.nan)
        pose = params.body_pose.double()
        return Posed(sample=sample, points=points, joints=joints, body=body, body_pose=pose, pixel_errors=errors)


def reprojection(posed: Posed) -> Figures:
    """Pixels between confident detections and the fit, over all points and over the hands."""
    errors = posed.pixel_errors
    hands = errors[:, kp.HANDS]
    figures = {"px median": float(np.nanmedian(errors)), "px p95": float(np.nanpercentile(errors, 95))}
    if np.isfinite(hands).any():
        figures["hands px median"] = float(np.nanmedian(hands))
    return figures


def smoothness(posed: Posed) -> Figures:
    """Second differences of the body's joints in time, in camera space and relative to the root."""
    joints = posed.joints[:, :_BODY_JOINTS]
    return {
        "jitter camera mm/f²": metrics.jitter(joints),
        "jitter root mm/f²": metrics.jitter(joints - joints[:, :1]),
    }


def accuracy(posed: Posed) -> Figures:
    """Distance of the 12 limb keypoints from the triangulated reference, where there is one."""
    if posed.sample.truth is None:
        return {}
    estimate, truth = posed.points[:, kp.LIMBS], posed.sample.truth[:, kp.LIMBS]
    aligned = metrics.pa_mpjpe(estimate, truth)
    around_root = truth - posed.sample.truth[:, [kp.INDEX["mid_hip"]]]
    return {
        "PA-MPJPE mm": float(aligned.mean()),
        "PA p90 mm": float(np.percentile(aligned, 90)),
        "MPJPE mm": float(metrics.mpjpe(estimate, truth, _HIPS).mean()),
        "depth error mm": float(abs(metrics.depth_error(estimate, truth)).mean()),
        "reference jitter root mm/f²": metrics.jitter(low_passed(around_root, posed.sample.clip.frame_rate)),
    }


def low_passed(points: Float[np.ndarray, "T N 3"], frame_rate: float) -> Float[np.ndarray, "T N 3"]:
    """A movement below 6 Hz, as usual for walking: the triangulation's noise alone has 50 mm/frame²."""
    return sosfiltfilt(butter(2, 6.0, fs=frame_rate, output="sos"), points, axis=0)


def wrists_in_front(joints: Float[np.ndarray, "T 55 3"]) -> Bool[np.ndarray, "T 2"]:
    """Whether the left and the right wrist are nearer to the camera than the chest (joint spine3).

    For people who face the camera and sign: hands inside or behind the trunk show a depth that the image did not hold.

    Args:
        joints: SMPL-X's joints in camera space (z away from the camera).
    """
    wrists = joints[:, [JOINT["left_wrist"], JOINT["right_wrist"]], 2]
    return wrists < joints[:, JOINT["spine3"], 2, None]


def uprightness(posed: Posed) -> Figures:
    """Where there is no reference and the person is known to sit or stand upright before the camera, hands in front."""
    if posed.sample.truth is not None:
        return {}
    lean, in_front = metrics.torso_lean(posed.joints), wrists_in_front(posed.joints)
    return {
        "lean °": float(lean.mean()),
        "worst lean °": float(lean.max()),
        "left wrist in front %": float(100 * in_front[:, 0].mean()),
        "right wrist in front %": float(100 * in_front[:, 1].mean()),
    }


def anatomy(posed: Posed) -> Figures:
    """What no body does: joints of trunk and limbs beyond their ranges, and parts of the body in each other."""
    ranges = {name: r for name, r in joint_ranges(posed.body).items() if JOINT[name] < _BODY_JOINTS}
    table = AngleTable.of(ranges, posed.body_pose)
    angles = table.named(table.angles(posed.body_pose.view(-1, 21, 3)[:, table.joint - 1])).rad2deg().numpy()
    low, high = np.moveaxis(np.array([r.bounds for r in ranges.values()]), -1, 0)
    beyond = abs(angles - angles.clip(low, high)).max((1, 2))
    overlaps = Contact(Skeleton(posed.body)).overlaps(matrices(posed.body_pose.numpy()))
    return {
        "worst joint beyond °": float(beyond.mean()),
        "frames beyond 10° %": float(100 * (beyond > 10).mean()),
        "frames overlapping %": float(100 * overlaps.double().mean()),
    }


MEASURES: list[Callable[[Posed], Figures]] = [accuracy, smoothness, reprojection, uprightness, anatomy]
"""All of them, in the order of the table's columns."""


def measure(sample: Sample, body: BodyModel, params: BodyParams) -> Figures:
    """Every figure that the clip can tell."""
    posed = Posed.of(sample, body, params)
    return {name: value for function in MEASURES for name, value in function(posed).items()}
