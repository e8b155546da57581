"""The people that a running detection has found so far, and which of them is meant."""

import threading
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from fitting_core.detect.detecting import FramesDetected
from fitting_core.keypoints import BODY, COUNT, Keypoints

_FEWEST = 5
"""Frames in which somebody is found before they count as one of the people."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundInFrame:
    """Who is in a frame."""

    points: Float[np.ndarray, "P 137 3"]
    """x, y in pixels of the image as it was filmed, and confidence."""
    numbers: Int[np.ndarray, "P"]
    """Who they are."""
    chosen: int | None
    """The place of the one who is meant; None: that one is not here."""
    others: tuple[int, ...] = ()
    """The places of the others who count as people."""


@dataclass(eq=False)
class FoundPeople:
    """Filled by the thread that detects, read by the one that draws."""

    frames: dict[int, FramesDetected] = field(default_factory=dict)
    """By the first frame of each part."""
    seen: tuple[int, int] | None = None
    """Whom the user has clicked on: frame (counted from the clip's first) and place in its list."""
    version: int = 0
    """Changes with every change."""

    def __post_init__(self) -> None:
        self._guard = threading.Lock()
        self._where: dict[int, tuple[int, int]] = {}
        self._weights: dict[int, float] = {}
        self._counts: dict[int, int] = {}

    def add(self, part: FramesDetected, first_frame: int) -> None:
        """Take the people of some frames; `first_frame` is the number of the clip's first."""
        with self._guard:
            start = part.frames[0] - first_frame
            if start in self.frames:
                return  # somebody else is chosen of those who were found before
            self.frames[start] = part
            for k, (people, numbers) in enumerate(zip(part.people, part.numbers, strict=True)):
                self._where[start + k] = (start, k)
                for points, number in zip(people, numbers.tolist(), strict=True):
                    self._counts[number] = self._counts.get(number, 0) + 1
                    self._weights[number] = self._weights.get(number, 0.0) + _prominence(points)
            self.version += 1

    def choose(self, frame: int, place: int) -> None:
        """Say who is meant: whoever is at a place in a frame's list."""
        with self._guard:
            self.seen = (frame, place)
            self.version += 1

    @property
    def count(self) -> int:
        """How many people there are so far."""
        with self._guard:
            return sum(count >= _FEWEST for count in self._counts.values())

    @property
    def done(self) -> tuple[range, ...]:
        """Frames that are complete, counted from the clip's first."""
        with self._guard:
            return tuple(range(start, start + len(part.frames)) for start, part in sorted(self.frames.items()))

    def at(self, frame: int) -> FoundInFrame | None:
        """Who is in a frame; None if it is not complete yet."""
        with self._guard:
            where = self._where.get(frame)
            if where is None:
                return None
            start, k = where
            points, numbers = self.frames[start].people[k], self.frames[start].numbers[k]
            meant = self._meant()
            places = np.flatnonzero(numbers == meant)
            known = [place for place, number in enumerate(numbers.tolist()) if self._counts[number] >= _FEWEST]
        if len(places) > 1:  # a detector that does not follow people itself
            places = places[np.argsort([-_prominence(points[place]) for place in places], kind="stable")]
        chosen = int(places[0]) if len(places) else None
        others = tuple(place for place in known if place != chosen)
        return FoundInFrame(points=points, numbers=numbers, chosen=chosen, others=others)

    def keypoints(self, frames: range) -> Keypoints:
        """Of whoever is meant, in frames that are complete."""
        points = np.zeros((len(frames), COUNT, 3))
        for k, frame in enumerate(frames):
            found = self.at(frame)
            if found is not None and found.chosen is not None:
                points[k] = found.points[found.chosen]
        return Keypoints(xy=points[..., :2], confidence=points[..., 2])

    def _meant(self) -> int | None:
        if self.seen is not None and (where := self._where.get(self.seen[0])) is not None:
            numbers = self.frames[where[0]].numbers[where[1]]
            if 0 <= self.seen[1] < len(numbers):
                return int(numbers[self.seen[1]])
        return max(self._weights, key=lambda number: self._weights[number], default=None)


def _prominence(points: Float[np.ndarray, "137 3"]) -> float:
    """Size times confidence."""
    sure = points[BODY][points[BODY, 2] > 0]
    return 0.0 if not len(sure) else float(np.linalg.norm(np.ptp(sure[:, :2], axis=0)) * sure[:, 2].sum())
