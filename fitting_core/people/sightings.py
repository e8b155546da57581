"""People as detected in single frames."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.keypoints import BODY


@dataclass(frozen=True, kw_only=True, eq=False)
class Sighting:
    """A detection, with its centre and size."""

    entry: int
    """Its index in the frame's list of people."""
    body: Float[np.ndarray, "25 3"]
    centre: Float[np.ndarray, "2"]
    size: float
    """The weighted root mean square distance of the keypoints from their centre: about a quarter of the body height of
    an upright person. Distances are in units of it."""
    confidence: float

    @classmethod
    def of(cls, entry: int, points: Float[np.ndarray, "137 3"]) -> "Sighting":
        """The detection at an index of a frame's list."""
        # The body's points, or all where only hands or face were detected: 112 of 137 would outvote the body.
        used = points[BODY] if (points[BODY, 2] > 0).any() else points
        centre = np.average(used[:, :2], axis=0, weights=used[:, 2])
        squares = ((used[:, :2] - centre) ** 2).sum(1)
        size = float(np.sqrt(np.average(squares, weights=used[:, 2])))
        return cls(entry=entry, body=points[BODY], centre=centre, size=size, confidence=float(used[:, 2].mean()))

    @property
    def prominence(self) -> float:
        """Size times confidence."""
        return self.size * self.confidence


def sightings(frame: Float[np.ndarray, "P 137 3"]) -> list[Sighting]:
    """All people of a frame with any detection."""
    return [Sighting.of(entry, points) for entry, points in enumerate(frame) if (points[:, 2] > 0).any()]
