"""The feet and trunk of a fitted body: where their points are in space, and how high these are above the sole."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float

from fitting_core.body import rotations
from fitting_core.body.geometry import SIDES
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import Joint, keypoint_points
from fitting_core.ground.contacts import FOOT_POINTS

_CHUNK = 1024
"""Frames posed per batch."""
_OF_FOOT = 0.9
"""Combined skinning weight of ankle and toes above which a vertex belongs to the foot."""


def has_feet(body: BodyModel) -> bool:
    """Whether a body has all keypoints of its feet."""
    return all(keypoint_points(body)[i] is not None for i in FOOT_POINTS.ravel())


@dataclass(frozen=True, kw_only=True, eq=False)
class Stance:
    """The parts of a body that the ground is found from, in the space of its parameters, metres."""

    feet: Float[np.ndarray, "T 2 4 3"]
    """Ankle, heel, big and small toe of the left and the right foot."""
    trunk: Float[np.ndarray, "T 3"]
    """From pelvis to neck."""


def stance_of(body: BodyModel, params: BodyParams) -> Stance:
    """Feet and trunk of T frames."""
    points = _points(body)
    found = np.concatenate([_posed(points, body, params[part]) for part in torch.arange(len(params)).split(_CHUNK)])
    feet = found[:, : FOOT_POINTS.size].reshape(-1, *FOOT_POINTS.shape, 3)
    return Stance(feet=feet, trunk=found[:, -1] - found[:, -2])


def _posed(points: BodyPoints, body: BodyModel, params: BodyParams) -> Float[np.ndarray, "T N 3"]:
    params = params.to(dtype=points.dtype, device=points.device)
    local = full_pose(body, params)
    shape = torch.cat([params.betas, params.expression], 1)
    posed = points.forward(rotations.exp(local[:, 0]), local[:, 1:], shape, None).points
    return (posed + params.camera_translation[:, None]).numpy()


@lru_cache(maxsize=2)
def _points(body: BodyModel) -> BodyPoints:
    known = keypoint_points(body)
    feet = [point for i in FOOT_POINTS.ravel() if (point := known[i]) is not None]
    return BodyPoints(body, [*feet, Joint(JOINT["pelvis"]), Joint(JOINT["neck"])])


def sole_heights(body: BodyModel, betas: Float[np.ndarray, "10"]) -> Float[np.ndarray, "2 4"]:
    """Height of each of these points above its foot's sole in the rest pose, metres."""
    rest = replace(BodyParams.neutral(1), betas=torch.as_tensor(betas, dtype=torch.float64)[None])
    heights, shaped = stance_of(body, rest).feet[0, :, :, 1], body.with_shape(betas)
    return np.stack([heights[k] - _lowest(shaped, side) for k, side in enumerate(SIDES)])


def _lowest(shaped: BodyModel, side: str) -> float:
    joints = [JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]]
    foot = shaped.skinning_weights[:, joints].sum(1) > _OF_FOOT
    return float(shaped.template[foot, 1].min())
