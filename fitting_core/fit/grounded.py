"""Gravity, contacts and floor of a fitted clip, and where its feet are held."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.fit.evidence.observations import lifted_keypoints
from fitting_core.fit.evidence.sides import unswapped
from fitting_core.fit.evidence.stances import stances
from fitting_core.fit.stages import Stages
from fitting_core.ground.feet import has_feet, sole_heights, stance_of
from fitting_core.ground.gravity import rolled_views, told_gravity
from fitting_core.ground.grounding import Grounding, grounding_of
from fitting_core.image_border import seen_confidence
from fitting_core.results.fit_result import FitResult


def grounded(fit: FitResult, clip: Clip, body: BodyModel) -> FitResult:
    """A fit with the grounding of its last phase; to be repeated whenever frames of it change.

    It takes 0.2 ms per frame, and the lifter another 1 ms for new frames, plus 0.3 s for the rotations.

    Args:
        fit: all frames.
        clip: what was fitted.
        body: the body model.
    """
    return replace(fit, grounding=grounding_of_params(clip, body, fit.last.params, unswap=fit.config.unswap_sides))


def grounding_of_params(clip: Clip, body: BodyModel, params: BodyParams, *, unswap: bool) -> Grounding | None:
    """The grounding of a moving body; None for a body whose feet have no keypoints.

    Args:
        clip: keypoints and camera.
        body: the body model.
        params: all frames, camera space.
        unswap: whether swapped sides are swapped back.
    """
    if not has_feet(body):
        return None
    keypoints = unswapped(clip.keypoints)[0] if unswap else clip.keypoints
    stance, confidence = stance_of(body, params), seen_confidence(keypoints, clip.camera)
    told = told_gravity(clip.camera) is not None
    return grounding_of(
        keypoints.xy,
        confidence,
        lifted_keypoints(keypoints, clip.camera, clip.frame_rate),
        clip.camera,
        clip.frame_rate,
        feet=clip.camera.to_still(stance.feet),
        soles=_soles(body, params),
        trunk=clip.camera.turned_to_still(stance.trunk),
        rolled=() if told else rolled_views(keypoints.xy, confidence, clip.camera, clip.frame_rate),
    )


def holding_feet(stages: Stages, clip: Clip, params: BodyParams, grounding: Grounding | None) -> Stages | None:
    """The stages with feet held where they stand; None if there is nothing to hold.

    Args:
        stages: of the whole clip.
        clip: what is fitted.
        params: all frames, in which the feet stand.
        grounding: of these.
    """
    if not any(stages.config.weights.held_position) or grounding is None or not grounding.contacts.standing.any():
        return None
    feet = clip.camera.to_still(stance_of(stages.body, params).feet)
    return stages.holding(stances(grounding.contacts, feet, clip.camera))


def _soles(body: BodyModel, params: BodyParams) -> Float[np.ndarray, "2 4"]:
    return sole_heights(body, params.betas.mean(0).double().numpy())
