"""Gravity, contacts and floor of a fitted clip, and where its feet are held."""

from fitting_core.body.params import BodyParams
from fitting_core.fit.evidence.observations import ACCURACY, stances
from fitting_core.fit.stages import Stages
from fitting_core.ground.feet import has_feet, sole_heights, stance_of
from fitting_core.ground.grounding import Grounding, grounding_of


def grounding_of_params(stages: Stages, params: BodyParams) -> Grounding | None:
    """Gravity, contacts and floor of a moving body; None for a body whose feet have no keypoints.

    It takes 0.2 ms per frame, and once per stages 1 ms per frame and 0.3 s for the lifter.

    Args:
        stages: of the whole clip.
        params: all frames, camera space.
    """
    body, lifter, camera = stages.body, stages.lifter, stages.camera
    if not has_feet(body):
        return None
    stance = stance_of(body, params)
    return grounding_of(
        lifter.keypoints.xy,
        lifter.confidence,
        lifter.lifted,
        camera,
        lifter.frame_rate,
        feet=camera.to_still(stance.feet),
        soles=sole_heights(body, params.betas.mean(0).double().numpy()),
        trunk=camera.turned_to_still(stance.trunk),
        centre=camera.to_still(stance.centre),
        upright=stance.upright,
        rolled=lifter.rolled,
    )


def holding_feet(
    stages: Stages, params: BodyParams, grounding: Grounding | None = None, *, firmness: float = 1.0
) -> Stages | None:
    """The stages with feet held where they stand; None if there is nothing to hold.

    Args:
        stages: of the whole clip.
        params: all frames, in which the feet stand.
        grounding: of these; None: it is computed.
        firmness: share of the weight of held feet.
    """
    if not any(stages.config.weights.held_position):
        return None
    grounding = grounding or grounding_of_params(stages, params)
    if grounding is None or not grounding.contacts.standing.any():
        return None
    feet = stages.camera.to_still(stance_of(stages.body, params).feet)
    return stages.holding(stances(grounding.contacts, feet, stages.camera, accuracy=ACCURACY / firmness))
