"""RTMPose's family over a clip: with a box model, and without one where a person is followed by their own points."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fitting_core.detect.detecting import Detected, Detection
from fitting_core.detect.topdown.boxes import Boxes
from fitting_core.detect.topdown.detector import PART, TopDown, to_points
from fitting_core.detect.topdown.families import load_pose_model
from fitting_core.keypoints import INDEX
from fitting_core.video.frames import FrameSource
from fitting_core.wholebody import WHOLEBODY_COUNT
from tests.fitting_core.detect.onnx_files import brightest_model, spots

SIZE = (320, 240)
FRAMES = 70
LENGTHS = (4, 8, 16, PART, FRAMES - PART - 28)
"""Frames of the parts: two whole ones, and shorter ones."""


def place(t: int) -> tuple[float, float]:
    """Where the middle of the three spots is."""
    return 60 + 2.5 * t, 120 + 40 * np.sin(t / 12)


def picture(t: int) -> np.ndarray:
    x, y = place(t)
    return spots(SIZE, {0: (x, y - 30), 1: (x + 20, y), 2: (x - 20, y + 30)}, sigma=5.0)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("frames")
    for t in range(FRAMES):
        cv2.imwrite(str(folder / f"{t:03}.png"), picture(t)[..., ::-1])
    return folder


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return brightest_model(tmp_path_factory.mktemp("model") / "pose.onnx", size=(96, 128))


class SpotBoxes:
    """Stands for a box model: a smaller box of nobody, and a box around all that is bright."""

    def __init__(self, path: Path) -> None:
        self.model = load_pose_model(path, threads=1).model
        self.calls = 0

    def find(self, images: list[np.ndarray]) -> list[Boxes]:
        self.calls += len(images)
        found = []
        for image in images:
            rows, columns = np.nonzero(image.max(-1) > 40)
            own = [columns.min(), rows.min(), columns.max(), rows.max()]
            found.append(Boxes(corners=np.array([[5, 5, 30, 40], own], float), scores=np.array([0.8, 0.9])))
        return found


def detection(video: Path, model: Path, *, boxes: Any = None, batch: int = 8, frames: int = FRAMES) -> Detection:
    detector = TopDown("spots", load_pose_model(model, threads=1), boxes, batch=batch)
    return Detection(source=FrameSource(video), frames=range(frames), detector=detector)


def result(made: Detection) -> Detected:
    store = made.store()
    store.discard()
    *_, last = made.events(store)
    assert isinstance(last, Detected)
    return last


def distances(found: Detected) -> np.ndarray:
    """Of the first person's nose (red), left eye (green) and right eye (blue)."""
    centres = np.array([place(t) for t in range(FRAMES)])
    offsets = {"nose": (0, -30), "left_eye": (20, 0), "right_eye": (-20, 30)}
    xy = np.array([people[0, :, :2] for people in found.people])
    return np.array([np.linalg.norm(xy[:, INDEX[name]] - centres - by, axis=1) for name, by in offsets.items()])


def test_the_box_follows_the_points(video: Path, model: Path):
    found = result(detection(video, model))
    assert [len(people) for people in found.people] == [1] * FRAMES and distances(found).max() < 1.0
    confidence = np.array([people[0, :, 2] for people in found.people])
    assert confidence[:, INDEX["nose"]].min() > 0.8
    assert (confidence[:, [INDEX["face_left_pupil"], INDEX["face_right_pupil"]]] == 0).all()
    assert found.points == "coco-wholebody" and all(not masks.size for masks in found.silhouettes)


def test_with_a_box_model_everybody_is_found_the_largest_first(video: Path, model: Path):
    boxes = SpotBoxes(model)
    found = result(detection(video, model, boxes=boxes))
    assert distances(found).max() < 1.0 and boxes.calls == FRAMES
    assert {len(people) for people in found.people} == {2}
    assert max(people[1, people[1, :, 2] > 0, :2].max(initial=0) for people in found.people) < 60


def test_what_is_found_does_not_depend_on_the_batch(video: Path, model: Path):
    every = [result(detection(video, model, boxes=SpotBoxes(model), batch=batch, frames=20)).people for batch in (8, 3)]
    assert all(np.array_equal(one, other) for one, other in zip(*every, strict=True))


@pytest.mark.parametrize(("after", "with_boxes"), [(6, False), pytest.param(75, True, marks=pytest.mark.thorough)])
def test_it_goes_on_where_it_stopped(video: Path, model: Path, with_boxes: bool, after: int):
    def made() -> Detection:
        return detection(video, model, boxes=SpotBoxes(model) if with_boxes else None, batch=1)

    whole = result(made())
    stopped = made()
    store = stopped.store()
    store.discard()
    events = stopped.events(store)
    for _ in range(after):
        next(events)
    events.close()
    kept = sum(map(len, stopped.stored_parts(store)))
    ends = np.cumsum([length + 2 for length in LENGTHS]) - 1  # of their events: a part's frames, itself, how far it is
    assert kept == sum(length for length, end in zip(LENGTHS, ends, strict=True) if after > end)
    *_, found = made().events(store)
    assert isinstance(found, Detected)
    assert all(np.array_equal(a, b) for a, b in zip(found.people, whole.people, strict=True))


def test_somebody_who_leaves_is_not_detected(model: Path, tmp_path: Path):
    dark = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for t in range(12):
        cv2.imwrite(str(tmp_path / f"{t:02}.png"), dark if 4 <= t < 8 else picture(t)[..., ::-1])
    found = result(detection(tmp_path, model, frames=12))
    assert [len(people) for people in found.people] == [1] * 4 + [0] * 4 + [1] * 4


def test_points_outside_the_image_are_not_detected():
    points = np.zeros((1, WHOLEBODY_COUNT, 3))
    points[0, :4] = [[10, 10, 0.9], [-1, 10, 0.9], [10, 240, 0.9], [20, 20, 0.01]]
    confidence = to_points(points, 0.9, SIZE)[0, :, 2]
    assert confidence[INDEX["nose"]] == 0.9 and (confidence > 0).sum() == 1
