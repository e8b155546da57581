"""People in images without tracks, followed by position."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.people.tracks import Track, follow

_FARTHEST, _LONGEST = 0.35, 30
"""How far from the expected place a person may be, in body lengths in the image; and how many frames unseen."""
_DEEPER = 1.5
"""Allowed ratio of one person's distances in two estimates."""
_LENGTH = 1.7


@dataclass(frozen=True, eq=False)
class _Seen:
    place: int
    """Index in the list of the image's people."""
    at: Float[np.ndarray, "2"]
    """In the image at a focal length of 1."""
    depth: float

    @property
    def prominence(self) -> float:
        """The body's length in the image."""
        return _LENGTH / self.depth


def followed(frames: Sequence[Sequence[Float[np.ndarray, "3"]]]) -> dict[int, dict[int, int]]:
    """For each person by number, the frames with the index in that frame's list; the most prominent is number 0.

    Args:
        frames: Positions of each frame's people in camera space, any unit; depths above 0.
    """
    seen = [[_Seen(i, p[:2] / max(p[2], 1e-6), max(p[2], 1e-6)) for i, p in enumerate(people)] for people in frames]
    tracks = follow(seen, prices=_prices, offset=lambda one, other: other.at - one.at)
    return {n: {frame: found.place for frame, found in track.sightings.items()} for n, track in enumerate(tracks)}


def _prices(people: Sequence[_Seen], tracks: Sequence[Track[_Seen]], frame: int) -> Float[np.ndarray, "P T"]:
    return np.array([[_price(one, track, frame) for track in tracks] for one in people])


def _price(one: _Seen, track: Track[_Seen], frame: int) -> float:
    before = track.seen
    away = float(np.linalg.norm(one.at - before.at - track.shift(frame))) / before.prominence
    deeper = max(one.depth / before.depth, before.depth / one.depth)
    near = away <= _FARTHEST and deeper <= _DEEPER and frame - track.frame <= _LONGEST
    return away + np.log(deeper) if near else np.inf
