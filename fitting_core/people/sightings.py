"""People as detected in single frames, and distances between them, in sizes of a person."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.keypoints import BODY
from fitting_core.people.tracks import Track

_COMMON_POINTS = 3
"""With fewer keypoints in common, centres are compared instead."""


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
    """Everybody in a frame with any detection."""
    return [Sighting.of(entry, points) for entry, points in enumerate(frame) if (points[:, 2] > 0).any()]


def distances(people: Sequence[Sighting], tracks: Sequence[Track[Sighting]], frame: int) -> Float[np.ndarray, "P T"]:
    """Mean distance of common body points, or of the centres, in sizes of the larger of the two.

    Args:
        people: Of the frame.
        tracks: Candidates, moved on until this frame.
        frame: Its number.
    """
    shifts = np.array([track.shift(frame) for track in tracks])
    a = np.array([one.body for one in people])[:, None]
    b = np.array([track.seen.body for track in tracks])[None]
    weights = np.sqrt(a[..., 2] * b[..., 2])
    apart = np.linalg.norm(a[..., :2] - b[..., :2] - shifts[:, None], axis=-1)
    of_points = (weights * apart).sum(-1) / np.maximum(weights.sum(-1), 1e-9)
    centres = np.array([one.centre for one in people])[:, None] - [track.seen.centre for track in tracks]
    of_centres = np.linalg.norm(centres - shifts, axis=-1)
    sizes = np.maximum.outer([one.size for one in people], [track.seen.size for track in tracks])
    enough = (weights > 0).sum(-1) >= _COMMON_POINTS
    return np.where(enough, of_points, of_centres) / np.maximum(sizes, 1e-9)


def offset(before: Sighting, after: Sighting) -> Float[np.ndarray, "2"]:
    """Mean motion of common body points; (0, 0) if they are too few."""
    weights = np.sqrt(before.body[:, 2] * after.body[:, 2])
    if (weights > 0).sum() < _COMMON_POINTS:
        return np.zeros(2)
    return np.average(after.body[:, :2] - before.body[:, :2], axis=0, weights=weights)
