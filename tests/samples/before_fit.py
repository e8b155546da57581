"""Contacts, gravity and floor before a fit: of keypoints and the lifter's body, where its keypoints put it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera
from fitting_core.ground.contacts import FOOT_POINTS, Contacts, contacts_of
from fitting_core.ground.gravity import Gravity, RolledView
from fitting_core.ground.grounding import Grounding, grounding_of
from fitting_core.ground.placing import pelvis_positions
from fitting_core.lifting.clip_lifting import LiftedClip

USUAL_SOLES = np.tile([0.09, 0.025, 0.015, 0.015], (2, 1))
"""Metres of a foot's keypoints above its sole, of the free body."""


def contacts_before_fit(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    lifted: LiftedClip,
    gravity: Gravity,
    camera: Camera,
    frame_rate: float,
) -> Contacts:
    """Contacts from keypoints and the lifter alone; arguments as for `grounding_before_fit`."""
    feet = _feet(xy, confidence, lifted, camera, frame_rate)
    return contacts_of(xy, confidence, lifted, gravity, camera, frame_rate, feet)


def grounding_before_fit(
    xy: Float[np.ndarray, "T K 2"],
    confidence: Float[np.ndarray, "T K"],
    lifted: LiftedClip,
    camera: Camera,
    frame_rate: float,
    *,
    rolled: Sequence[RolledView] = (),
) -> Grounding:
    """From keypoints and the lifter alone, with a floor under the lifter's body where its keypoints put it.

    Args:
        xy: Pixels, the first 25 of K are BODY_25.
        confidence: 0 for what is not seen or cut off by the image.
        lifted: What the lifter says of them.
        camera: Of the clip.
        frame_rate: Frames per second.
        rolled: As for `grounding_of`.
    """
    feet = _feet(xy, confidence, lifted, camera, frame_rate)
    return grounding_of(xy, confidence, lifted, camera, frame_rate, feet=feet, soles=USUAL_SOLES, rolled=rolled)


def _feet(xy: np.ndarray, confidence: np.ndarray, lifted: LiftedClip, camera: Camera, frame_rate: float) -> np.ndarray:
    middle = pelvis_positions(xy, confidence, lifted, camera, frame_rate)[:, None]
    return camera.to_still(lifted.points + middle)[:, FOOT_POINTS]
