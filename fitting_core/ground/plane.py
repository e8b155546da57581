"""The floor of a clip: one plane perpendicular to gravity under the standing feet."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.frame_runs import runs_where
from fitting_core.ground.contacts import Contacts
from fitting_core.ground.gravity import Gravity

_LEAST = 0.2
"""Seconds of standing, both feet summed, needed for a floor; in shorter clips and photographs, one foot throughout."""
_LEAST_SEEN = 0.05
"""Share of frames in which a foot must be in the image to conclude that none stands."""
_LOWEST = 10
"""Percentile of the standing feet's heights taken as a first floor: people who climb stand higher, too."""
_NEAR = 0.15
"""Metres from there within which a foot stands on the floor, and not on something else."""
_OWN = 0.015
"""Metres: error of the soles of a body that is not quite the person's."""
_OF_STRETCH = 0.03
"""Minimum error of one contact's height, metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ground:
    """A plane in still space (see `CameraPath`): points x of the floor have normal · x + offset = 0."""

    normal: Float[np.ndarray, "3"]
    """Up, a unit vector in camera axes (x right, y down, z away)."""
    offset: float
    """Height in metres of the camera above it."""
    deviation: float
    """Standard deviation of its height where the person stands, metres."""

    def height(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Height in metres of points of still space above it."""
        return points @ self.normal + self.offset


def ground_under(
    feet: Float[np.ndarray, "T 2 4 3"],
    soles: Float[np.ndarray, "2 4"],
    contacts: Contacts,
    gravity: Gravity,
    frame_rate: float,
) -> Ground | str:
    """The floor, or why it is missing.

    Args:
        feet: Still space, metres: ankle, heel, big and small toe of the left and the right foot.
        soles: How high these are above the sole of a flat foot, metres.
        contacts: Which feet stand.
        gravity: Of the clip.
        frame_rate: Frames per second.
    """
    if not gravity.sure:
        return "the up direction is uncertain"
    if contacts.seen.any(1).mean() < _LEAST_SEEN:
        return "the feet are not in the image"
    if contacts.standing.sum() < min(_LEAST * frame_rate, len(contacts.standing)):
        return "no foot stands still in the image"
    # Heights along `up` from the camera, which is above the floor: negative for feet.
    heights = lowest(feet, soles, gravity.up)
    first = np.percentile(heights[contacts.standing], _LOWEST)
    on_it = contacts.standing & (abs(heights - first) < _NEAR)
    middle, found = float(np.median(heights[on_it])), _of_stretches(heights, on_it)
    # Contacts are independent, frames of one contact are not: the mean's error falls with the root of their number.
    spread = max(_OF_STRETCH, float(np.sqrt(np.mean((found - middle) ** 2))))
    deviation = float(np.hypot(_OWN, spread / np.sqrt(len(found))))
    return Ground(normal=gravity.up, offset=-middle, deviation=deviation)


def lowest(
    feet: Float[np.ndarray, "T 2 4 3"], soles: Float[np.ndarray, "2 4"], up: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "T 2"]:
    """The lowest position along `up` of each foot's sole, under heel or toes, metres from the camera."""
    return (feet @ up - soles)[..., 1:].min(-1)


def _of_stretches(heights: Float[np.ndarray, "T 2"], on_it: Bool[np.ndarray, "T 2"]) -> Float[np.ndarray, "n"]:
    """Each contact separately: its frames share an error."""
    return np.array(
        [np.median(heights[run, foot]) for foot in range(on_it.shape[1]) for run in runs_where(on_it[:, foot])]
    )
