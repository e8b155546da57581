"""Inputs of the terms: the constants of a fit, and the keypoints that an objective uses."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core.body.model import BodyModel
from fitting_core.camera import Camera
from fitting_core.config.schema import FitConfig
from fitting_core.fit.collision.colliding_body import CollidingBody
from fitting_core.fit.evidence.observations import Observations
from fitting_core.fit.variables.state import Parametrisation


@dataclass(frozen=True, kw_only=True, eq=False)
class TermContext:
    """The constants of a fit that terms depend on."""

    config: FitConfig
    """Weights and all other settings."""
    body: BodyModel
    """The fitted body."""
    parametrisation: Parametrisation
    """How a solver's numbers become the body's pose."""
    observations: Observations
    """Evidence of each frame."""
    camera: Camera
    pelvis: Float[Tensor, "3"]
    """Of the mean shape at rest, metres: the root rotates about it."""
    near_start: Bool[Tensor, "T"]
    """Frames that are held near a given start, which determines the root's rotation and the legs."""
    hands_shown: bool
    """Whether the clip shows any keypoint of the hands."""
    turned: Bool[np.ndarray, "T 55"]
    """Joints whose rotation the image, or known relative positions, determine."""
    temporal_weight: float
    """w_T for this clip."""
    colliding: Callable[[], CollidingBody]
    """Creates the whole mesh on first use."""


@dataclass(frozen=True)
class UsedKeypoints:
    """Keypoints that one objective uses."""

    indices: Int[Tensor, "N"]
    weight: Float[Tensor, "T N"]
    """In the image: confidence x joint weight x IMAGE_SCALE / image height."""
