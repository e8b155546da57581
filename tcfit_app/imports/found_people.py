"""The people found so far by a running detection, and which of them is chosen."""

import threading
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from fitting_core.detect.detecting import FramesDetected
from fitting_core.keypoints import BODY, COUNT, Keypoints

_FEWEST = 5
"""Minimum number of frames in which someone is found to count as a person."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundInFrame:
    """The people in a frame."""

    points: Float[np.ndarray, "P 137 3"]
    """x, y in pixels of the distorted image, and confidence."""
    numbers: Int[np.ndarray, "P"]
    """Their identities."""
    chosen: int | None
    """The index of the chosen person; None: not in this frame."""
    others: tuple[int, ...] = ()
    """The indices of the others who count as people."""


@dataclass(eq=False)
class FoundPeople:
    """Filled by the detecting thread, read by the drawing thread."""

    frames: dict[int, FramesDetected] = field(default_factory=dict)
    """By the first frame of each part."""
    seen: tuple[int, int] | None = None
    """The person the user clicked on: frame (from the clip's first) and index in its list."""
    version: int = 0
    """Changes with every change."""

    def __post_init__(self) -> None:
        self._guard = threading.Lock()
        self._where: dict[int, tuple[int, int]] = {}
        self._weights: dict[int, float] = {}
        self._counts: dict[int, int] = {}

    def add(self, part: FramesDetected, first_frame: int) -> None:
        """Add the people of some frames; `first_frame` is the number of the clip's first."""
        with self._guard:
            start = part.frames[0] - first_frame
            if start in self.frames:
                return  # someone else was chosen among the people found before
            self.frames[start] = part
            for k, (people, numbers) in enumerate(zip(part.people, part.numbers, strict=True)):
                self._where[start + k] = (start, k)
                for points, number in zip(people, numbers.tolist(), strict=True):
                    self._counts[number] = self._counts.get(number, 0) + 1
                    self._weights[number] = self._weights.get(number, 0.0) + _prominence(points)
            self.version += 1

    def choose(self, frame: int, place: int) -> None:
        """Choose the person at an index of a frame's list."""
        with self._guard:
            self.seen = (frame, place)
            self.version += 1

    @property
    def count(self) -> int:
        """The number of people so far."""
        with self._guard:
            return sum(count >= _FEWEST for count in self._counts.values())

    @property
    def done(self) -> tuple[range, ...]:
        """Frames that are complete, from the clip's first."""
        with self._guard:
            return tuple(range(start, start + len(part.frames)) for start, part in sorted(self.frames.items()))

    def at(self, frame: int) -> FoundInFrame | None:
        """The people in a frame; None if it is not complete yet."""
        with self._guard:
            where = self._where.get(frame)
            if where is None:
                return None
            start, k = where
            points, numbers = self.frames[start].people[k], self.frames[start].numbers[k]
            meant = self._meant()
            places = np.flatnonzero(numbers == meant)
            known = [place for place, number in enumerate(numbers.tolist()) if self._counts[number] >= _FEWEST]
        if len(places) > 1:  # the detector does not track people itself
            places = places[np.argsort([-_prominence(points[place]) for place in places], kind="stable")]
        chosen = int(places[0]) if len(places) else None
        others = tuple(place for place in known if place != chosen)
        return FoundInFrame(points=points, numbers=numbers, chosen=chosen, others=others)

    def keypoints(self, frames: range) -> Keypoints:
        """The chosen person's keypoints, in complete frames."""
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
