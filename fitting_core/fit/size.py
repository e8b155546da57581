"""The size of a person, which no single camera tells from the distance.

Phases 1 and 2 choose the size that agrees with the only lengths in metres that they have, the lifter's, and thereby
absorb the lifter's error in scale. A height as evidence of those phases would leave that error to the pose. So the body
takes its height after them, the given one or a likely one: it is scaled about the camera, with its distance and with
the lifter's depths. Its picture and its pose stay the same.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float

from fitting_core.body.model import N_BETAS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.motion import rest_joints

_BODY_JOINTS = 22
_UNLIKELY = 0.003
"""Metres by which all joints together must come nearer for one standard deviation of a beta."""
_PEOPLE, _LIFTER = 0.03, 0.045
"""Deviations of heights, as shares: of people from the body's mean, and of what the lifter's lengths tell. People came
out too short in 34 of 36 fits."""


def height_of(body: BodyModel, betas: Float[np.ndarray, "*n 10"]) -> Float[np.ndarray, "*n"]:
    """Standing height of a shape in metres."""
    mean, by_betas = body.height
    return mean + betas @ by_betas


def likely_height(body: BodyModel, betas: Float[np.ndarray, "10"]) -> float:
    """Between the body's mean and the height of a shape that the lifter's lengths tell, by their variances; metres."""
    mean = body.height[0]
    return float(mean + _PEOPLE**2 / (_PEOPLE**2 + _LIFTER**2) * (height_of(body, betas) - mean))


def resized(body: BodyModel, betas: Float[np.ndarray, "10"], metres: float) -> Float[np.ndarray, "10"]:
    """The shape of another height whose joints come nearest to the scaled shape's."""
    joints, by_betas = _from_pelvis(body)
    before, by_height = height_of(body, betas), body.height[1]
    # Least squares at a fixed height, by Lagrange's multiplier.
    system = np.block(
        [[by_betas.T @ by_betas + _UNLIKELY**2 * np.eye(N_BETAS), by_height[:, None]], [by_height, np.zeros(1)]]
    )
    wanted = [*(metres / before - 1) * ((joints + by_betas @ betas) @ by_betas), metres - before]
    return betas + np.linalg.solve(system, wanted)[:N_BETAS]


@lru_cache(maxsize=2)
def _from_pelvis(body: BodyModel) -> tuple[Float[np.ndarray, "66"], Float[np.ndarray, "66 10"]]:
    """Joints of the mean shape relative to the pelvis, and how each beta moves them."""
    directions = np.einsum("jv,vak->jak", body.joint_regressor[:_BODY_JOINTS], body.shape_directions)
    joints = body.rest_joints[:_BODY_JOINTS]
    return (joints - joints[0]).ravel(), (directions - directions[0]).reshape(-1, N_BETAS)


def with_shape(body: BodyModel, params: BodyParams, betas: Float[np.ndarray, "T 10"]) -> BodyParams:
    """The same poses of bodies of another shape, as much farther from the camera as they are taller."""
    ratio = height_of(body, betas) / height_of(body, params.betas.double().numpy())
    shaped = replace(params, betas=torch.as_tensor(betas).to(params.betas))
    before, after = (rest_joints(body, each)[:, 0] for each in (params, shaped))
    place = torch.as_tensor(ratio)[:, None] * (before + params.camera_translation.double()) - after
    return replace(shaped, camera_translation=place.to(params.camera_translation))
