"""The feet and trunk of a fitted body: where their points are in space, and how high these are above the sole."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float

from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import Joint, keypoint_points
from fitting_core.body.points.positions import posed_points
from fitting_core.ground.contacts import FOOT_POINTS
from fitting_core.keypoints import SIDES

_CHUNK = 1024
"""Frames posed per batch."""
_SEATED = 60.0
"""Degrees of knee flexion."""
_SEGMENTS = (
    ("head", "head", 0.068, 0.0),
    ("shoulder", "hip", 0.430, 0.405),
    ("shoulder", "elbow", 0.053, 0.576),
    ("elbow", "wrist", 0.030, 0.457),
    ("wrist", "wrist", 0.012, 0.0),
    ("hip", "knee", 0.289, 0.385),
    ("knee", "ankle", 0.091, 0.441),
)
"""Head, trunk, and both arms, hands, thighs and shanks: between which joints, share of the body's mass, and where their
centre of mass lies between these (de Leva, Journal of Biomechanics 29, 1996; mean of men and women)."""
_FEET = 0.027
_PAIRED = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_JOINTS = ("pelvis", "neck", "head", *(f"{side}_{part}" for side in SIDES for part in _PAIRED))
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
    centre: Float[np.ndarray, "T 3"]
    """The body's centre of mass."""
    upright: Bool[np.ndarray, "T 2"]
    """Whether the left and the right knee is bent by less than _SEATED: whose foot may carry the body."""


def stance_of(body: BodyModel, params: BodyParams) -> Stance:
    """Feet and trunk of T frames."""
    found = posed_points(_points(body), body, params, together=_CHUNK)
    feet = found[:, : FOOT_POINTS.size].reshape(-1, *FOOT_POINTS.shape, 3)
    at = dict(zip(_JOINTS, found[:, FOOT_POINTS.size :].swapaxes(0, 1), strict=True))
    parts = [share * ((1 - way) * _middle(at, one) + way * _middle(at, other)) for one, other, share, way in _SEGMENTS]
    centre = np.sum([*parts, _FEET * feet.mean((1, 2))], 0)
    thighs, shanks = (
        np.stack([at[f"{side}_{lower}"] - at[f"{side}_{upper}"] for side in SIDES], 1)
        for upper, lower in (("hip", "knee"), ("knee", "ankle"))
    )
    bent = np.degrees(np.arctan2(np.linalg.norm(np.cross(thighs, shanks), axis=-1), (thighs * shanks).sum(-1)))
    return Stance(feet=feet, trunk=at["neck"] - at["pelvis"], centre=centre, upright=bent < _SEATED)


def _middle(at: dict[str, np.ndarray], part: str) -> Float[np.ndarray, "T 3"]:
    """A joint's place, or the middle between the left and the right one."""
    return at[part] if part in at else (at[f"left_{part}"] + at[f"right_{part}"]) / 2


@lru_cache(maxsize=2)
def _points(body: BodyModel) -> BodyPoints:
    known = keypoint_points(body)
    feet = [point for i in FOOT_POINTS.ravel() if (point := known[i]) is not None]
    return BodyPoints(body, [*feet, *(Joint(JOINT[name]) for name in _JOINTS)])


def sole_heights(body: BodyModel, betas: Float[np.ndarray, "10"]) -> Float[np.ndarray, "2 4"]:
    """Height of each of these points above its foot's sole in the rest pose, metres."""
    rest = replace(BodyParams.neutral(1), betas=torch.as_tensor(betas, dtype=torch.float64)[None])
    heights, shaped = stance_of(body, rest).feet[0, :, :, 1], body.with_shape(betas)
    return np.stack([heights[k] - _lowest(shaped, side) for k, side in enumerate(SIDES)])


def _lowest(shaped: BodyModel, side: str) -> float:
    joints = [JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]]
    foot = shaped.skinning_weights[:, joints].sum(1) > _OF_FOOT
    return float(shaped.template[foot, 1].min())
