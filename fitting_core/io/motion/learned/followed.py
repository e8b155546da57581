"""People of images that tell no tracks, followed by where they are."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.people.tracks import Track, follow

_FARTHEST, _LONGEST = 0.35, 30
"""Of a body's length in the image, how far one may be from where the person should be; and frames unseen."""
_DEEPER = 1.5
"""By so much the distances of one person may differ, in two estimates."""
_LENGTH = 1.7


@dataclass(frozen=True, eq=False)
class _Seen:
    place: int
    """In the list of the image's people."""
    at: Float[np.ndarray, "2"]
    """In the image, for a focal length of 1."""
    depth: float

    @property
    def prominence(self) -> float:
        """The body's length in the image."""
        return _LENGTH / self.depth


def followed(frames: Sequence[Sequence[Float[np.ndarray, "3"]]]) -> dict[int, dict[int, int]]:
    """Of each person by number, the frames with the place in that frame's list; the most prominent is number 0.

    Args:
        frames: Where the people of each frame are, camera space. Units may be any; depths above 0.
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
