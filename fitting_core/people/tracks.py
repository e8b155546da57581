"""People followed from frame to frame through detections, which have no order and have gaps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np
from jaxtyping import Float

_VELOCITY_FRAMES = 5
"""Frames for which an unseen person is assumed to keep moving, then to stand still."""


class Sighting(Protocol):
    """One person as seen in one frame."""

    @property
    def prominence(self) -> float:
        """Size times confidence."""
        ...


Seen = TypeVar("Seen", bound=Sighting)


@dataclass(eq=False)
class Track(Generic[Seen]):
    """One person as followed so far."""

    sightings: dict[int, Seen] = field(default_factory=dict)
    """By frame, in order."""
    velocity: Float[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    """Pixels per frame."""
    score: float = 0.0
    """Sum of the sightings' prominence."""

    @property
    def frame(self) -> int:
        """The last sighting's frame."""
        return next(reversed(self.sightings))

    @property
    def seen(self) -> Seen:
        """The last sighting."""
        return self.sightings[self.frame]

    def shift(self, frame: int) -> Float[np.ndarray, "2"]:
        """Expected motion by then at the same velocity."""
        return self.velocity * min(frame - self.frame, _VELOCITY_FRAMES)

    def add(self, frame: int, seen: Seen, offset: Callable[[Seen, Seen], Float[np.ndarray, "2"]]) -> None:
        """Add what a frame shows of this person."""
        if self.sightings:
            self.velocity = 0.5 * (self.velocity + offset(self.seen, seen) / (frame - self.frame))
        self.sightings[frame] = seen
        self.score += seen.prominence


def follow(
    frames: Sequence[Sequence[Seen]],
    *,
    prices: Callable[[Sequence[Seen], Sequence[Track[Seen]], int], Float[np.ndarray, "P T"]],
    offset: Callable[[Seen, Seen], Float[np.ndarray, "2"]],
) -> list[Track[Seen]]:
    """Everybody in a clip, the most prominent first.

    Args:
        frames: Who is seen in each frame.
        prices: Of the people of a frame and the tracks so far, how unlikely it is that one continues the other;
            infinite if it does not.
        offset: How far a person moved from one sighting to the next, in pixels.
    """
    tracks: list[Track[Seen]] = []
    for frame, people in enumerate(frames):
        matches = surest(prices(people, tracks, frame)) if people and tracks else {}
        for k, seen in enumerate(people):
            if k not in matches:
                tracks.append(Track())
            (tracks[matches[k]] if k in matches else tracks[-1]).add(frame, seen, offset)
    return sorted(tracks, key=lambda track: track.score, reverse=True)


def surest(prices: Float[np.ndarray, "P T"]) -> dict[int, int]:
    """For each row, the matching column. The surest match comes first, and stays.

    Not the assignment of least total cost: there, a false detection beside a person took over that person's track and
    the person an old one, as this made two matches out of one.
    """
    matches: dict[int, int] = {}
    rows, columns = np.nonzero(np.isfinite(prices))
    for at in np.argsort(prices[rows, columns], kind="stable"):
        row, column = int(rows[at]), int(columns[at])
        if row not in matches and column not in matches.values():
            matches[row] = column
    return matches
