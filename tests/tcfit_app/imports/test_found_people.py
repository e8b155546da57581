"""People who are found while a detection runs: who is meant, who counts, and whom the picture offers."""

import numpy as np

from fitting_core.detect.detecting import FramesDetected
from fitting_core.keypoints import BODY, COUNT
from tcfit_app.imports.found_people import FoundPeople
from tcfit_app.review.drawing.overlays import in_the_same_place


def somebody(x: float, size: float) -> np.ndarray:
    points = np.zeros((COUNT, 3))
    points[BODY, :2] = np.random.default_rng(0).uniform(-size, size, (BODY.stop, 2)) + np.array([x, 100])
    points[BODY, 2] = 0.9
    return points


def part(frames: range, *people: tuple[int, np.ndarray]) -> FramesDetected:
    points, numbers = np.stack([one for _, one in people]), np.array([number for number, _ in people])
    return FramesDetected(frames=frames, people=(points,) * len(frames), numbers=(numbers,) * len(frames))


def test_the_most_prominent_is_meant_and_who_is_seen_briefly_does_not_count():
    found = FoundPeople()
    large, small = (0, somebody(100, 50)), (1, somebody(300, 20))
    found.add(part(range(10, 18), small, large), 10)
    found.add(part(range(18, 20), small, large, (2, somebody(500, 30))), 10)
    shown = found.at(8)
    assert shown is not None and shown.chosen == 1 and shown.others == (0,) and found.count == 2
    assert found.done == (range(0, 8), range(8, 10)) and found.at(10) is None


def test_what_comes_twice_counts_once():
    found = FoundPeople()
    for _ in range(2):
        found.add(part(range(3), (0, somebody(100, 50))), 0)
    assert found.count == 0 and found.version == 1


def test_a_part_of_the_person_who_is_taken_for_another_is_not_offered():
    meant = somebody(100, 50)
    assert in_the_same_place(somebody(110, 20), meant) and not in_the_same_place(somebody(200, 20), meant)
    assert not in_the_same_place(np.zeros((COUNT, 3)), meant)
