"""Where standing feet are held: at the median of their positions in a fit without holding."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera
from fitting_core.frame_runs import runs_where
from fitting_core.ground.contacts import FOOT_POINTS, Contacts
from fitting_core.keypoints import COUNT

ACCURACY = 0.01
"""Standard deviation in metres of a standing foot's motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stances:
    """Keypoints held in still space (see `CameraPath`), relative to the camera of each frame."""

    position: Float[np.ndarray, "T 137 3"]
    """Metres."""
    deviation: Float[np.ndarray, "T 137"]
    """Metres; infinite where nothing is held."""


def stances(contacts: Contacts, feet: Float[np.ndarray, "T 2 4 3"], camera: Camera) -> Stances:
    """For every contact of a foot.

    They are not moved onto a common floor: the fit of a tilted floor, which a clip determines to a median of 7 degrees,
    moves feet along the viewing ray, and legs with them.

    Args:
        contacts: Of the clip.
        feet: Still space, metres: ankle, heel, big and small toe of the left and the right foot.
        camera: Of the clip.
    """
    position = np.zeros((len(feet), COUNT, 3))
    deviation = np.full((len(feet), COUNT), np.inf)
    for foot, points in enumerate(FOOT_POINTS):
        for run in runs_where(contacts.standing[:, foot]):
            position[run.start : run.stop, points] = np.median(feet[run, foot], axis=0)
            deviation[run.start : run.stop, points] = ACCURACY
    return Stances(position=camera.from_still(position), deviation=deviation)
