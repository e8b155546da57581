"""A fit paired with its reference, frame by frame: the input of all measures."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from fitting_core import keypoints as kp
from fitting_core.body.markers.joint_centres import joint_centres_in_space
from fitting_core.body.markers.marker_set import marker_places
from fitting_core.body.model import JOINT, JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space, keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.measure.mesh.errors import MeshErrors
from fitting_core.measure.references.reference import Reference

_NEAR = 0.01
"""Metres: points nearer to the camera's plane, or behind it, are in no image."""
BODY_JOINTS = list(range(JOINT["right_wrist"] + 1))
"""The 22 joints of trunk and limbs."""
_FINE = set(JOINTS[JOINT["right_wrist"] + 1 :])
"""Joints of fingers and face, which are left out of comparisons of joints."""
_HIPS = [kp.INDEX["left_hip"], kp.INDEX["right_hip"]]
_PELVIS = (
    ("pelvis",),
    ("LHJC", "RHJC"),
    ("left_hip", "right_hip"),
    ("LASI", "RASI", "LPSI", "RPSI"),
    ("LASI", "RASI", "SACR"),
)
"""What stands for the root where a reference has no keypoints of the hips: the first of these that it has."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedMotion:
    """T frames of a fit."""

    body: BodyModel
    params: BodyParams
    camera: Camera | None
    """None: it is not known, and nothing is projected."""
    frame_rate: float
    first_frame: int = 0
    """Number of its first frame in the video."""
    clip: Clip | None = None
    """Clip with the detections, if available."""

    @cached_property
    def joints(self) -> Float[np.ndarray, "T 55 3"]:
        """Camera space, metres."""
        return joints_in_space(self.body, self.params)

    def still(self, points: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T K 3"]:
        """Points of camera space in still space, in which a camera that moves does not move them (see `CameraPath`)."""
        return points if self.camera is None else self.camera.to_still(points)

    @property
    def view(self) -> Float[np.ndarray, "T 3"]:
        """Where the camera looks in each frame, unit vectors in still space."""
        ahead = np.tile([0.0, 0.0, 1.0], (len(self.params), 1))
        return ahead if self.camera is None else self.camera.turned_to_still(ahead)

    @cached_property
    def keypoints(self) -> tuple[Float[np.ndarray, "T 137 3"], Bool[np.ndarray, "137"]]:
        """In camera space, metres, and which of them the body has."""
        return keypoints_in_space(self.body, self.params)

    def points_beside(self, reference: Reference) -> tuple[Float[np.ndarray, "T 137 3"], Bool[np.ndarray, "137"]]:
        """The keypoints, which a detector's reference has; beside other systems' results the limbs' joint centres."""
        points, exists = self.keypoints
        if reference.others:
            points, exists = points.copy(), exists.copy()
            points[:, kp.LIMBS], exists[kp.LIMBS] = joint_centres_in_space(self.body, self.params), True
        return points, exists

    @cached_property
    def pixels(self) -> Float[np.ndarray, "T 137 2"]:
        """Projected keypoints; NaN for those that the body lacks, and behind the camera."""
        assert self.camera is not None
        points, exists = self.keypoints
        return pixels_of(self.camera, np.where(exists[:, None], points, np.nan))


def pixels_of(camera: Camera, points: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T K 2"]:
    """Projected points; NaN for those that are not known, and behind the camera."""
    shown = points[..., 2] > _NEAR
    there = np.where(shown[..., None], points, 1.0)
    return np.where(shown[..., None], project(camera, torch.as_tensor(there)).numpy(), np.nan)


def comparable(
    estimate: PosedMotion, reference: Reference
) -> tuple[Float[np.ndarray, "T K 3"], Float[np.ndarray, "R K 3"], list[int]]:
    """The points that both have, each at its own moments, and which of them are the root.

    Joints of trunk and limbs of a reference that is a body; else the limbs' points, such joints, and markers.
    """
    if reference.joints is not None:
        return estimate.joints[:, BODY_JOINTS], reference.joints[:, BODY_JOINTS], [JOINT["pelvis"]]
    points, exists = estimate.points_beside(reference)
    known = np.isfinite(reference.points).all(-1).any(0) & exists
    chosen = [i for i in kp.LIMBS if known[i]]
    estimated, true = points[:, chosen], reference.points[:, chosen]
    roots = [chosen.index(i) for i in _HIPS if i in chosen]
    if reference.markers is not None and reference.marker_places is not None:
        counted = [i for i, target in enumerate(reference.markers.targets.values()) if target not in _FINE]
        markers = reference.markers.only(tuple(reference.markers.names[i] for i in counted))
        on = list(markers.targets.values())
        places = marker_places(estimate.body, estimate.params, markers)
        estimated = np.concatenate([estimated, places], 1)
        true = np.concatenate([true, reference.marker_places[:, counted]], 1)
        for pelvis in _PELVIS:
            roots = roots or [len(chosen) + on.index(name) for name in pelvis if set(pelvis) <= set(on)]
    return estimated, true, roots or list(range(true.shape[1]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """A fit and, where there is one, its reference; positions are evaluated when asked for."""

    estimate: PosedMotion
    reference: Reference | None
    truth_body: BodyModel | None
    """Of the reference, if that is a body."""
    volumes: Float[np.ndarray, "T"]
    true_volumes: Float[np.ndarray, "T"] | None = None
    meshes: MeshErrors | None = None

    @cached_property
    def frames(self) -> Int[np.ndarray, "T"]:
        """The reference's frame for each of the fit's, -1 if missing."""
        fit = self.estimate
        count = len(fit.params)
        if self.reference is None:
            return np.full(count, -1)
        return self.reference.frames_of(count, fit.first_frame, fit.frame_rate)

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray, list[int]] | None:
        """Estimated and true points (T, K, 3), NaN where none are known, and which of them are the root."""
        if self.reference is None:
            return None
        estimated, true, roots = comparable(self.estimate, self.reference)
        return estimated, self.matched(true), roots

    def matched(self, values: np.ndarray) -> np.ndarray:
        """The reference's values at the fit's frames; NaN if missing."""
        found = values[self.frames].astype(np.float64)
        found[self.frames < 0] = np.nan
        return found

    @property
    def even(self) -> bool:
        """Whether the reference's values at the fit's frames may be differentiated over time (`Reference.is_even`)."""
        return self.reference is not None and self.reference.is_even(self.estimate.frame_rate)

    @property
    def in_camera(self) -> bool:
        """Whether the reference stands where the fit should stand."""
        return self.reference is not None and self.reference.in_camera
