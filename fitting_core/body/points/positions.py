"""Where joints and keypoints of given parameters lie, without the mesh."""

from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.kinematics import contour_bins
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import Joint, keypoint_points

_CHUNK = 64
"""Frames evaluated together if nothing else is said: the face contour's tables of each frame take 0.4 MB."""


def joints_in_space(body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T 55 3"]:
    """The kinematic joints of posed bodies in camera space, metres."""
    return posed_points(_joints(body), body, params)


def keypoints_in_space(
    body: BodyModel, params: BodyParams
) -> tuple[Float[np.ndarray, "T 137 3"], Bool[np.ndarray, "137"]]:
    """The 137 keypoints of posed bodies in camera space (metres), and which of them the body has; others are 0."""
    points, exists = _keypoints(body, kp.COUNT)
    found = np.zeros((len(params), len(exists), 3))
    found[:, exists] = posed_points(points, body, params)
    return found, exists


def body_keypoints_in_space(body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T 25 3"]:
    """The BODY_25 keypoints of posed bodies in camera space (metres), NaN for those that the body has not."""
    points, exists = _keypoints(body, len(kp.BODY_25))
    found = np.full((len(params), len(exists), 3), np.nan)
    found[:, exists] = posed_points(points, body, params)
    return found


@lru_cache(maxsize=2)
def _joints(body: BodyModel) -> BodyPoints:
    return BodyPoints(body, [Joint(i) for i in range(N_JOINTS)])


@lru_cache(maxsize=4)  # the face contour's 79 tables take 0.5 s to compile; of a fit beside its truth
def _keypoints(body: BodyModel, count: int) -> tuple[BodyPoints, Bool[np.ndarray, "count"]]:
    """The first keypoints as far as the body has them, and which it has."""
    wanted = keypoint_points(body)[:count]
    found = [point for point in wanted if point is not None]
    return BodyPoints(body, found), np.array([point is not None for point in wanted])


def posed_points(
    points: BodyPoints, body: BodyModel, params: BodyParams, *, together: int = _CHUNK
) -> Float[np.ndarray, "T N 3"]:
    """Points of posed bodies in camera space, metres; contour landmarks by the yaw of each frame's head.

    Evaluates `together` frames at a time."""
    params = params.to(dtype=points.dtype, device=points.device)
    chunks = torch.arange(len(params)).split(together)
    return np.concatenate([_posed_chunk(points, body, params[frames]) for frames in chunks])


def _posed_chunk(points: BodyPoints, body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T N 3"]:
    local = full_pose(body, params)
    orient, pose = rotations.exp(local[:, 0]), local[:, 1:]
    bins = contour_bins(points.world_rotations(orient, pose)) if points.has_contour else None
    posed = points.forward(orient, pose, torch.cat([params.betas, params.expression], 1), bins)
    return (posed.points + params.camera_translation[:, None]).numpy()
