"""Detection over a clip: who is followed, what is stored, and going on after an end."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.detect import load_box_model, load_pose_model
from fitting_core.detect.detecting import Detected, Detection, DetectionProgress, to_keypoints
from fitting_core.detect.stored import StoredDetection
from fitting_core.detect.topdown.boxes import Boxes
from fitting_core.detect.topdown.tracking import bridged, follow
from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX
from fitting_core.video.frames import FrameSource
from fitting_core.wholebody import WHOLEBODY_COUNT
from tests.fitting_core.detect.onnx_files import brightest_model, spots

SIZE = (320, 240)
FRAMES = 70
"""Two whole parts, and some."""


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


class SpotBoxes:
    """Stands for a box model: a box around all that is bright, and a smaller one of somebody else."""

    def __init__(self, path: Path) -> None:
        self.model = load_pose_model(path, threads=1).model
        self.calls = 0

    def find(self, images: list[np.ndarray]) -> list[Boxes]:
        self.calls += len(images)
        found = []
        for image in images:
            rows, columns = np.nonzero(image.max(-1) > 40)
            own = [columns.min(), rows.min(), columns.max(), rows.max()]
            other = [5, 5, 30, 40]
            found.append(Boxes(corners=np.array([own, other], float), scores=np.array([0.9, 0.8])))
        return found


def detection(video: Path, model: Path, *, boxes: SpotBoxes | None = None, **changes: object) -> Detection:
    pose = load_pose_model(model, threads=1)
    made = Detection(source=FrameSource(video), frames=range(FRAMES), pose=pose, boxes=boxes)
    return replace(made, **changes)


def result(made: Detection, folder: Path) -> Detected:
    *steps, last = made.events(StoredDetection(folder))
    assert isinstance(last, Detected) and all(isinstance(step, DetectionProgress) for step in steps)
    assert steps[-1].done == steps[-1].total == len(made.frames)
    return last


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return brightest_model(tmp_path_factory.mktemp("model") / "pose.onnx", size=(96, 128))


def distances(found: Detected, frames: range = range(FRAMES)) -> np.ndarray:
    """Of the nose (red), the left eye (green) and the right eye (blue)."""
    centres = np.array([place(t) for t in frames])
    offsets = {"nose": (0, -30), "left_eye": (20, 0), "right_eye": (-20, 30)}
    xy = found.keypoints.xy
    return np.array([np.linalg.norm(xy[:, INDEX[name]] - centres - by, axis=1) for name, by in offsets.items()])


def test_the_box_follows_the_points(video: Path, model: Path, tmp_path: Path):
    found = result(detection(video, model), tmp_path / "s")
    assert len(found.keypoints) == FRAMES and found.note == ""
    assert distances(found).max() < 1.0
    assert found.keypoints.confidence[:, INDEX["nose"]].min() > 0.8
    assert (found.keypoints.confidence[:, [INDEX["face_left_pupil"], INDEX["face_right_pupil"]]] == 0).all()


def test_with_a_box_model_the_most_prominent_person_is_followed(video: Path, model: Path, tmp_path: Path):
    boxes = SpotBoxes(model)
    found = result(detection(video, model, boxes=boxes), tmp_path / "s")
    assert distances(found).max() < 1.0 and boxes.calls == FRAMES
    assert found.note == ""
    other = result(detection(video, model, boxes=boxes, person=1), tmp_path / "other")
    assert other.keypoints.xy[other.keypoints.confidence > 0].max(initial=0) < 60


@pytest.mark.parametrize("batch", [1, 3])
def test_what_is_found_does_not_depend_on_the_batch(video: Path, model: Path, tmp_path: Path, batch: int):
    every = [
        result(detection(video, model, boxes=SpotBoxes(model), batch=b), tmp_path / str(b)).keypoints
        for b in (8, batch)
    ]
    assert np.array_equal(every[0].xy, every[1].xy) and np.array_equal(every[0].confidence, every[1].confidence)


@pytest.mark.parametrize(("with_boxes", "after"), [(False, 1), (False, 40), (False, 72), (True, 40), (True, 115)])
def test_it_goes_on_where_it_stopped(video: Path, model: Path, tmp_path: Path, with_boxes: bool, after: int):
    """A frame is an event, and so is a stored part."""
    boxes = SpotBoxes(model) if with_boxes else None
    whole = result(detection(video, model, boxes=boxes), tmp_path / "whole")
    store = StoredDetection(tmp_path / "parts")
    events = detection(video, model, boxes=boxes, batch=1).events(store)
    for _ in range(after):
        next(events)
    events.close()
    kept = len(detection(video, model).so_far(store).keypoints)
    assert kept == {(False, 1): 0, (False, 40): 32, (False, 72): 64, (True, 40): 0, (True, 115): 32}[with_boxes, after]
    again = SpotBoxes(model)
    resumed = result(detection(video, model, boxes=again if with_boxes else None), tmp_path / "parts")
    assert np.array_equal(resumed.keypoints.xy, whole.keypoints.xy)
    assert np.array_equal(resumed.keypoints.confidence, whole.keypoints.confidence)
    assert again.calls == {(True, 40): FRAMES - 32}.get((with_boxes, after), 0)


def test_a_damaged_part_is_made_again(video: Path, model: Path, tmp_path: Path):
    whole = result(detection(video, model), tmp_path / "s")
    for name in ("points-000001.npz", "points-000002.npz"):
        (tmp_path / "s" / name).write_bytes((tmp_path / "s" / name).read_bytes()[:100])
    assert len(detection(video, model).so_far(StoredDetection(tmp_path / "s")).keypoints) == 32
    assert np.array_equal(result(detection(video, model), tmp_path / "s").keypoints.xy, whole.keypoints.xy)


def test_another_model_or_range_does_not_go_on(video: Path, model: Path, tmp_path: Path):
    store = StoredDetection(tmp_path / "s")
    next(detection(video, model).events(store))
    other = brightest_model(tmp_path / "other.onnx", size=(48, 64))
    for changed, words in (
        (detection(video, other), "another pose model"),
        (detection(video, model, frames=range(3, 60)), "another video, first frame, last frame"),
        (detection(video, model, boxes=SpotBoxes(model)), "another box model"),
    ):
        with pytest.raises(InputError, match=words):
            next(changed.events(store))
    store.discard()
    next(detection(video, other).events(store))


def test_somebody_who_leaves_is_not_detected(model: Path, tmp_path: Path):
    dark = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for t in range(12):
        cv2.imwrite(str(tmp_path / f"{t:02}.png"), dark if 4 <= t < 8 else picture(t)[..., ::-1])
    made = replace(detection(tmp_path, model), frames=range(12))
    found = result(made, tmp_path / "s")
    assert (found.keypoints.confidence[4:8] == 0).all() and found.keypoints.confidence[[3, 8], 0].min() > 0.8
    assert "4 of 12 frames, the first of them 4" in found.note


def test_short_gaps_of_boxes_are_bridged():
    boxes = np.full((50, 4), np.nan)
    boxes[[0, 4, 45]] = [[0, 0, 10, 10], [4, 8, 14, 18], [40, 40, 50, 50]]
    filled = bridged(boxes)
    assert np.allclose(filled[2], [2, 4, 12, 14]) and np.isnan(filled[5:45]).all()


def test_people_who_cross_keep_their_boxes():
    found = []
    for t in range(20):
        left, right = np.array([10 + 8 * t, 50, 40 + 8 * t, 170.0]), np.array([170 - 8 * t, 60, 196 - 8 * t, 150.0])
        corners = np.array([left, right] if t % 2 else [right, left])
        found.append(Boxes(corners=corners, scores=np.full(2, 0.8)))
    boxes, note = follow(found)
    assert np.allclose(boxes[:, 0], 10 + 8 * np.arange(20)) and note.startswith("Another person is nearly as prominent")
    second, _ = follow(found, person=1)
    assert np.allclose(second[:, 0], 170 - 8 * np.arange(20))
    with pytest.raises(InputError, match="only 2 people"):
        follow(found, person=2)


def test_a_false_box_takes_nobody_over():
    """An old false track, and a new false box beside the person: neither is part of the person's track."""
    found = []
    for t in range(40):
        corners = [[200.0 - 2 * t, 50, 260 - 2 * t, 200]]
        corners += [[150.0, 60, 175, 120]] if t in (5, 6, 7) else []
        corners += [[215.0 - 2 * t, 120, 235 - 2 * t, 170]] if t == 20 else []
        found.append(Boxes(corners=np.array(corners), scores=np.linspace(0.9, 0.4, len(corners))))
    boxes, note = follow(found)
    assert np.allclose(boxes[:, 0], 200 - 2 * np.arange(40)) and note == ""


def test_somebody_out_of_sight_is_found_again():
    found = []
    for t in range(60):
        there = [[20.0 + t, 50, 60 + t, 150]] if not 20 <= t < 42 else np.zeros((0, 4))
        found.append(Boxes(corners=np.array(there).reshape(-1, 4), scores=np.full(len(there), 0.8)))
    boxes, _ = follow(found)
    assert np.allclose(boxes[:, 0], 20 + np.arange(60))


def test_real_people_are_followed(shared_data: Path):
    """The woman who walks from right to left in front of the man, in every third frame; read off the video by eye."""
    model = load_box_model(shared_data / "onnx" / "rtmdet_nano.onnx", threads=1)
    frames = range(45, 185, 5)
    with FrameSource(shared_data / "video" / "walk_two_people.mp4") as video:
        found = [model.find([video.frame(frame)])[0] for frame in frames]
    tracks = [follow(found, person=rank)[0] for rank in (0, 1)]
    woman = next(boxes for boxes in tracks if boxes[0, 0] > 1000)
    centres = dict(zip(frames, (woman[:, 0] + woman[:, 2]) / 2, strict=True))
    assert np.isfinite(woman).all()
    for frame, x in ((60, 1390), (90, 1125), (120, 833), (150, 500), (180, 205)):
        assert abs(centres[frame] - x) < 60, (frame, centres[frame])


def test_nobody_at_all():
    none = Boxes(corners=np.zeros((0, 4)), scores=np.zeros(0))
    boxes, note = follow([none] * 3)
    assert np.isnan(boxes).all() and "Nobody" in note


def test_points_outside_the_image_are_not_detected():
    points = np.zeros((1, WHOLEBODY_COUNT, 3))
    points[0, :4] = [[10, 10, 0.9], [-1, 10, 0.9], [10, 240, 0.9], [20, 20, 0.01]]
    found = to_keypoints(points, SIZE)
    assert found.confidence[0, INDEX["nose"]] == 0.9 and (found.confidence > 0).sum() == 1


def test_settings_that_make_no_sense(video: Path, model: Path):
    for changes in ({"batch": 0}, {"person": -1}, {"person": 1}):
        with pytest.raises(InputError):
            detection(video, model, **changes)
