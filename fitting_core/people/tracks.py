"""People followed from frame to frame through what a detector saw of them, in no order and with gaps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np
from jaxtyping import Float

_VELOCITY_FRAMES = 5
"""A person who is not seen is taken to move on for so many frames, then to stand still."""


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
    """By frame, in their order."""
    velocity: Float[np.ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    """Pixels a frame."""
    score: float = 0.0
    """Sum of the sightings' prominence."""

    @property
    def frame(self) -> int:
        """Where the person was seen last."""
        return next(reversed(self.sightings))

    @property
    def seen(self) -> Seen:
        """How the person was seen last."""
        return self.sightings[self.frame]

    def shift(self, frame: int) -> Float[np.ndarray, "2"]:
        """How far the person should have moved by then, moving on as before."""
        return self.velocity * min(frame - self.frame, _VELOCITY_FRAMES)

    def add(self, frame: int, seen: Seen, offset: Callable[[Seen, Seen], Float[np.ndarray, "2"]]) -> None:
        """Take what a frame shows as this person."""
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
        prices: Of the people of a frame and the tracks so far, how unlikely it is that the one continues the other;
            infinite where it does not.
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
    """By row, the column that it goes with. The surest match comes first, and stays.

    Not the assignment of least total price: a false detection beside a person took over that person's track there, and
    the person went to an old one, as this made two matches out of one.
    """
    matches: dict[int, int] = {}
    rows, columns = np.nonzero(np.isfinite(prices))
    for at in np.argsort(prices[rows, columns], kind="stable"):
        row, column = int(rows[at]), int(columns[at])
        if row not in matches and column not in matches.values():
            matches[row] = column
    return matches
