"""Where feet that stand are held: from a fit without that, the middle of where they were, on one floor."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera
from fitting_core.frame_runs import runs_where
from fitting_core.ground.contacts import FOOT_POINTS
from fitting_core.ground.grounding import Grounding
from fitting_core.ground.plane import Ground, lowest
from fitting_core.keypoints import COUNT

ACCURACY = 0.01
"""Metres (standard deviation): a standing foot moves so much."""
_DEPTH_ERROR, _SIDEWAYS_ERROR = 0.03, 0.01
"""Standard deviations of where a fit has a standing foot: along the line of sight as a share of its distance, and
across it in metres. So a foot is moved onto the floor mostly along the line of sight, which the image does not see."""
_ON_FLOOR = 0.01
"""Metres: standard deviation of a sole's height above the floor."""
_NEAR = 0.25
"""Metres above or below the floor up to which a standing foot is taken to stand on it, and on nothing else."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stances:
    """Keypoints that are held in still space (see `CameraPath`), as the camera has that in each frame."""

    position: Float[np.ndarray, "T 137 3"]
    """Metres."""
    deviation: Float[np.ndarray, "T 137"]
    """Metres; infinite where nothing is held."""


def stances(
    grounding: Grounding, feet: Float[np.ndarray, "T 2 4 3"], soles: Float[np.ndarray, "2 4"], camera: Camera
) -> Stances:
    """Of every contact of a foot.

    Args:
        grounding: contacts, gravity and floor.
        feet: still space, metres: ankle, heel, big and small toe of the left and the right foot.
        soles: how high these are above the sole of a flat foot, metres.
        camera: of the clip.
    """
    seen_from = np.zeros((len(feet), 3)) if camera.path is None else camera.path.places
    position = np.zeros((len(feet), COUNT, 3))
    deviation = np.full((len(feet), COUNT), np.inf)
    standing = grounding.contacts.standing
    middle = feet[standing].mean((0, 1)) if standing.any() else np.zeros(3)
    for foot, points in enumerate(FOOT_POINTS):
        for run in runs_where(grounding.contacts.standing[:, foot]):
            held = np.median(feet[run, foot], axis=0)
            if grounding.ground is not None:
                tilted = np.radians(grounding.gravity.deviation) * float(np.linalg.norm(held.mean(0) - middle))
                held += _onto(grounding.ground, held, soles[foot], tilted, seen_from[run].mean(0))
            position[run.start : run.stop, points] = held
            deviation[run.start : run.stop, points] = ACCURACY
    return Stances(position=camera.from_still(position), deviation=deviation)


def _onto(
    ground: Ground,
    held: Float[np.ndarray, "4 3"],
    soles: Float[np.ndarray, "4"],
    tilted: float,
    seen_from: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "3"]:
    """How a foot is to be moved onto the floor, which is off by `tilted` metres there: least against what the foot may
    be off itself."""
    up = ground.normal
    height = float(lowest(held[None, None], soles[None], up)[0, 0] + ground.offset)
    if abs(height) > _NEAR:
        return np.zeros(3)
    sight = held.mean(0) - seen_from
    ahead = sight / np.linalg.norm(sight)
    along = (_DEPTH_ERROR * np.linalg.norm(sight)) ** 2 - _SIDEWAYS_ERROR**2
    covariance = _SIDEWAYS_ERROR**2 * np.eye(3) + along * np.outer(ahead, ahead)
    variance = up @ covariance @ up + _ON_FLOOR**2 + ground.deviation**2 + tilted**2
    return -covariance @ up * height / variance
