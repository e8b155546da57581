"""A detector that knows beforehand what is to be found, and remembers what it was asked."""

from collections.abc import Callable, Generator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from fitting_core.detect.detectors import Known
from fitting_core.detect.part import Part
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.silhouettes import silhouette_size
from fitting_core.video.frames import FrameSource

People = Callable[[int], Float[np.ndarray, "P 137 3"]]
"""Everybody in a frame, by its number in the video."""


class FakeDetector:
    """See `fitting_core.detect.part.Detector`.

    Args:
        people: Who is found; the same place in the lists of several frames is the same person.
        length: Frames of a part.
        version: Of the detector.
    """

    name, points = "fake", "mediapipe"

    def __init__(self, people: People, *, length: int = 4, version: str = "1") -> None:
        self._people, self._length, self.version = people, length, version
        self.asked: list[int] = []
        """Numbers of all frames that were looked at."""
        self.closed = 0
        """Times that a detection ended, whichever way."""

    def part_length(self, size: tuple[int, int]) -> int:
        """See `Detector`."""
        return self._length

    def detect(
        self, source: FrameSource, parts: Sequence[range], memory: Mapping[str, np.ndarray]
    ) -> Generator[int | Part, None, None]:
        """See `Detector`. What it finds depends on all frames before, through its memory."""
        before = float(memory.get("sum", 0.0))
        done = 0
        try:
            for frames in parts:
                found = []
                for frame in frames:
                    self.asked.append(frame)
                    before = (before + source.frame(frame).mean()) / 2
                    found.append(_with(self._people(frame), before))
                    done += 1
                    yield done
                yield _part(found, source.size, {"sum": np.array(before)})
        finally:
            self.closed += 1


def _with(people: Float[np.ndarray, "P 137 3"], before: float) -> Float[np.ndarray, "P 137 3"]:
    """The memory shows in the points of somebody who goes on, by less than a pixel."""
    moved = people.copy()
    moved[..., 0] += before / 1e4 * (people[..., 2] > 0)
    return moved


def _part(found: list[np.ndarray], size: tuple[int, int], memory: dict[str, np.ndarray]) -> Part:
    width, height = silhouette_size(size)
    mask = np.zeros(-(-width * height // 8), np.uint8)
    return Part(
        people=tuple(found),
        numbers=tuple(np.arange(len(people)) for people in found),
        silhouettes=tuple(
            np.array([mask + place for place in range(len(people))], np.uint8).reshape(len(people), len(mask))
            for people in found
        ),
        memory=memory,
    )


def one_person(keypoints: Keypoints) -> People:
    """Somebody with these keypoints, frame by frame."""
    points = np.concatenate([keypoints.xy, keypoints.confidence[..., None]], -1)
    return lambda frame: points[frame : frame + 1]


def known(detector: FakeDetector) -> Known:
    """As a line of `DETECTORS`; `pytest.MonkeyPatch.setitem` puts it there."""
    return Known(title="a fake", make=lambda name, running: detector, is_here=lambda: True)


def standing(*places: tuple[float, float], height: float) -> Float[np.ndarray, "P 137 3"]:
    """People whose keypoints lie around these places, all alike."""
    around = np.random.default_rng(0).uniform(-height / 2, height / 2, (COUNT, 2))
    points = [np.column_stack([around + place, np.full(COUNT, 0.9)]) for place in places]
    return np.array(points).reshape(-1, COUNT, 3)
