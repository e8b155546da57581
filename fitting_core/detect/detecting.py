"""Detection over a clip: a generator of its progress, which can be stopped at any time and resumed later."""

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from fitting_core.detect.part import Detector, Part
from fitting_core.detect.stored import DetectionSettings, StoredDetection
from fitting_core.silhouettes import silhouette_size
from fitting_core.video.fingerprint import fingerprint
from fitting_core.video.frames import FrameSource

_FIRST = 4
"""Frames of the first part; each after it is twice as long, up to the detector's length."""
_SHORTEST = 5
"""Frames in which a person must be found: false detections last for fewer."""


@dataclass(frozen=True, kw_only=True)
class DetectionProgress:
    """How far a detection is."""

    done: int
    """Frames."""
    total: int
    kept: int
    """Frames that are stored: a detection that is resumed has them already."""

    @property
    def share(self) -> float:
        """0 to 1."""
        return self.done / max(1, self.total)


@dataclass(frozen=True, kw_only=True, eq=False)
class FramesDetected:
    """Keypoints of frames that are complete. A person in them may still turn out to be a false detection."""

    frames: range
    """Numbers in the video."""
    people: tuple[Float[np.ndarray, "P 137 3"], ...]
    """See `Part`."""
    numbers: tuple[Int[np.ndarray, "P"], ...]
    """See `Part`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Detected:
    """All people of a clip."""

    people: tuple[Float[np.ndarray, "P 137 3"], ...]
    """Of each frame, its people in the order in which they were found: x, y in pixels and confidence."""
    silhouettes: tuple[UInt8[np.ndarray, "P n"], ...]
    """Of each frame, see `Part`."""
    silhouette_size: tuple[int, int]
    """Width and height of a silhouette."""
    detector: str
    """Name of what found them."""
    points: str
    """Whose points they are like."""
    version: str
    """Of the detector."""
    frames: range
    """Their numbers in the video."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection:
    """A detection to run: video, frames and detector."""

    source: FrameSource
    frames: range
    """Numbers of consecutive frames of the source."""
    detector: Detector

    def settings(self) -> DetectionSettings:
        """All that the result depends on."""
        return DetectionSettings(
            video=fingerprint(self.source.path),
            first_frame=self.frames[0],
            last_frame=self.frames[-1],
            detector=self.detector.version,
        )

    def store(self) -> StoredDetection:
        """The user's cache of its parts."""
        return StoredDetection(self.settings())

    def events(self, store: StoredDetection) -> Generator[DetectionProgress | FramesDetected | Detected, None, None]:
        """Detect and store part by part; stored parts are not repeated. The last event is the result.

        The first progress says how much was stored before.

        Raises:
            InputError: A model cannot be run, or the store cannot be written.
        """
        store.begin()
        found: list[Part] = []
        memory, parts = {}, self._parts()
        for part in self.stored_parts(store):
            yield FramesDetected(frames=parts[len(found)], people=part.people, numbers=part.numbers)
            memory = part.memory
            found.append(replace(part, memory={}))
        missing = parts[len(found) :]
        start = kept = done = sum(map(len, found))
        yield self._progress(done, kept)
        if missing:
            with closing(self.detector.detect(self.source, missing, memory)) as events:
                for event in events:
                    if isinstance(event, int):
                        done = start + event
                    else:
                        store.write(len(found), event)
                        kept += len(event)
                        yield FramesDetected(frames=parts[len(found)], people=event.people, numbers=event.numbers)
                        found.append(replace(event, memory={}))
                    yield self._progress(max(done, kept), kept)
        yield self.joined(found)

    def _progress(self, done: int, kept: int) -> DetectionProgress:
        return DetectionProgress(done=done, total=len(self.frames), kept=kept)

    def stored_parts(self, store: StoredDetection) -> Iterator[Part]:
        """The stored parts, from the first one to the first gap."""
        for number, frames in enumerate(self._parts()):
            part = store.read(number)
            if part is None or len(part) != len(frames):
                return
            yield part

    def joined(self, parts: list[Part]) -> Detected:
        """Some first parts as one, without those who are found in very few frames."""
        numbers = [own for part in parts for own in part.numbers]
        counts = np.bincount(np.concatenate(numbers)) if any(map(len, numbers)) else np.zeros(0, int)
        fewest = min(_SHORTEST, len(numbers))
        kept = [np.array([counts[n] >= fewest for n in own], bool) for own in numbers]
        people = [people for part in parts for people in part.people]
        silhouettes = [silhouettes for part in parts for silhouettes in part.silhouettes]
        return Detected(
            people=tuple(map(_of_those, people, kept)),
            silhouettes=tuple(map(_of_those, silhouettes, kept)),
            silhouette_size=silhouette_size(self.source.size),
            detector=self.detector.name,
            points=self.detector.points,
            version=self.detector.version,
            frames=self.frames[: len(numbers)],
        )

    def _parts(self) -> list[range]:
        """The first ones are short, so that there is something to see soon."""
        longest, parts, start = self.detector.part_length(self.source.size), [], 0
        length = min(_FIRST, longest)
        while start < len(self.frames):
            parts.append(self.frames[start : start + length])
            start, length = start + length, min(2 * length, longest)
        return parts


def _of_those(values: np.ndarray, kept: Bool[np.ndarray, "P"]) -> np.ndarray:
    """Without a copy where everybody is kept: a long clip has them by the hundred megabytes."""
    return values if kept.all() else values[kept]
