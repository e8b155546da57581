"""Detection over a clip: what is stored, going on after an end, and who counts as somebody."""

import os
import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.detect import stored
from fitting_core.detect.detecting import Detected, Detection, DetectionProgress, FramesDetected
from fitting_core.detect.detectors import find_detector
from fitting_core.detect.mediapipe import networks
from fitting_core.detect.stored import DetectionSettings, StoredDetection
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT
from fitting_core.silhouettes import silhouette_size
from fitting_core.video.frames import FrameSource
from tests.samples.fake_detector import FakeDetector

SIZE = (64, 48)
FRAMES = 10
"""Two whole parts of the fake detector, and some."""


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("frames")
    for t in range(FRAMES):
        cv2.imwrite(str(folder / f"{t:03}.png"), np.full((SIZE[1], SIZE[0], 3), 20 * t, np.uint8))
    return folder


def standing(*places: float) -> np.ndarray:
    """People, each with all keypoints at one place."""
    return np.array([np.tile([x, 20.0, 0.9], (COUNT, 1)) for x in places]).reshape(-1, COUNT, 3)


def one(frame: int) -> np.ndarray:
    return standing(10.0 + frame)


def detection(video: Path, detector: FakeDetector, frames: range = range(FRAMES)) -> Detection:
    return Detection(source=FrameSource(video), frames=frames, detector=detector)


def result(made: Detection) -> Detected:
    *steps, last = made.events(made.store())
    assert isinstance(last, Detected)
    progress = [step for step in steps if isinstance(step, DetectionProgress)]
    assert progress[-1].done == progress[-1].kept == progress[-1].total == len(made.frames)
    assert [step.done for step in progress] == sorted(step.done for step in progress)
    told = [frame for step in steps if isinstance(step, FramesDetected) for frame in step.frames]
    assert told == list(made.frames)
    return last


def same(one: Detected, other: Detected) -> bool:
    pairs = [(one.people, other.people), (one.silhouettes, other.silhouettes)]
    return all(np.array_equal(a, b) for these, those in pairs for a, b in zip(these, those, strict=True))


def test_what_is_found(video: Path):
    found = result(detection(video, FakeDetector(one)))
    assert [people.shape for people in found.people] == [(1, COUNT, 3)] * FRAMES
    assert (found.detector, found.points, found.version, found.frames) == ("fake", "mediapipe", "1", range(FRAMES))
    assert found.silhouette_size == silhouette_size(SIZE) == SIZE
    assert {masks.shape for masks in found.silhouettes} == {(1, SIZE[0] * SIZE[1] // 8)}


EVENTS = 1 + FRAMES + 2 * 3 + 1
"""The first progress, one for each frame, two for each part, and the result."""


@pytest.mark.parametrize("after", range(1, EVENTS + 1))
def test_it_goes_on_wherever_it_stopped(video: Path, after: int):
    whole = result(Detection(source=FrameSource(video), frames=range(FRAMES), detector=FakeDetector(one, version="2")))
    first, second = FakeDetector(one), FakeDetector(one)
    made = detection(video, first)
    events = made.events(made.store())
    for _ in range(after):
        next(events)
    events.close()
    assert first.closed == (after > 1), "it is ended at once, and its threads with it"
    kept = sum(map(len, made.stored_parts(made.store())))
    assert kept in (0, 4, 8, 10) and kept >= len(first.asked) - 4
    assert same(result(detection(video, second)), whole)
    assert second.asked == list(range(kept, FRAMES))


def test_nothing_is_found_twice(video: Path):
    first, second = FakeDetector(one), FakeDetector(one)
    found = result(detection(video, first))
    made = detection(video, second)
    start = next(event for event in made.events(made.store()) if isinstance(event, DetectionProgress))
    assert start == DetectionProgress(done=FRAMES, total=FRAMES, kept=FRAMES)
    assert same(result(detection(video, second)), found) and second.asked == []


@pytest.mark.parametrize("damage", [lambda data: data[:100], lambda data: b"", lambda data: b"x" * len(data)])
def test_a_damaged_part_is_made_again(video: Path, keypoint_store: Path, damage: Callable[[bytes], bytes]):
    whole = result(detection(video, FakeDetector(one)))
    (file,) = keypoint_store.rglob("part-000001.npz")
    file.write_bytes(damage(file.read_bytes()))
    again = FakeDetector(one)
    assert same(result(detection(video, again)), whole)
    assert again.asked == list(range(4, FRAMES)), "and those after it, which go on from it"


WRONG: dict[str, Callable[[dict[str, np.ndarray]], object]] = {
    "fewer people": lambda a: a.update(people=a["people"][:-1]),
    "people of 17 points": lambda a: a.update(people=a["people"][:, :17]),
    "people as text": lambda a: a.update(people=a["people"].astype(str)),
    "counts of fewer people": lambda a: a.update(counts=np.maximum(a["counts"] - 1, 0)),
    "counts below 0": lambda a: a.update(counts=-a["counts"]),
    "counts that are no numbers": lambda a: a.update(counts=a["counts"] * np.nan),
    "numbers below 0": lambda a: a.update(numbers=a["numbers"] - 5),
    "numbers of other lengths": lambda a: a.update(numbers=a["numbers"][1:]),
    "silhouettes of one dimension": lambda a: a.update(silhouettes=a["silhouettes"].ravel()),
    "another memory": lambda a: a.update(memory_sum=a["memory_sum"] + 1),
    "something else beside": lambda a: a.update(memory_x=np.zeros(3)),
    "no counts": lambda a: a.pop("counts"),
    "no digest": lambda a: a.pop("digest"),
    "a digest of another kind": lambda a: a.update(digest=np.array("yes")),
}
"""What a file may hold that is a whole npz and not the part that was stored."""


@pytest.mark.parametrize("wrong", WRONG)
def test_a_part_of_other_arrays_is_made_again(video: Path, keypoint_store: Path, wrong: str):
    whole = result(detection(video, FakeDetector(one)))
    (file,) = keypoint_store.rglob("part-000001.npz")
    with np.load(file, allow_pickle=False) as stored:
        arrays = dict(stored)
    WRONG[wrong](arrays)
    np.savez(file, allow_pickle=False, **arrays)
    again = FakeDetector(one)
    assert same(result(detection(video, again)), whole) and again.asked == list(range(4, FRAMES))


def test_other_frames_and_other_versions_are_stored_apart(video: Path, keypoint_store: Path):
    for version, frames in (("1", range(FRAMES)), ("2", range(FRAMES)), ("1", range(3, 9))):
        detector = FakeDetector(one, version=version)
        found = result(detection(video, detector, frames))
        assert detector.asked == list(frames) and found.frames == frames
    assert len(list(keypoint_store.iterdir())) == 3


def test_who_is_found_in_very_few_frames_is_nobody(video: Path):
    def people(frame: int) -> np.ndarray:
        return standing(10.0, 40.0) if 3 <= frame < 7 else standing(10.0)

    found = result(detection(video, FakeDetector(people)))
    assert [len(people) for people in found.people] == [1] * FRAMES
    assert [len(masks) for masks in found.silhouettes] == [1] * FRAMES


def test_old_detections_make_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(stored, "_MOST_KEPT", 3500)
    stores = [
        StoredDetection(DetectionSettings(video=video, first_frame=0, last_frame=9, detector="d"), tmp_path)
        for video in "abcde"
    ]
    for age, store in enumerate(stores[:4]):
        store.begin()
        settings = next(store.folder.iterdir())
        assert settings.name == "settings.json"
        (store.folder / "part-000000.npz").write_bytes(b"0" * 900)
        os.utime(settings, (1000 + age, 1000 + age))
    assert all(store.folder.exists() for store in stores[:4])
    stores[1].begin()  # used again
    (stores[3].folder / "part-000001.npz").write_bytes(b"0" * 900)
    stores[4].begin()
    assert [store.folder.exists() for store in stores] == [False, True, False, True, True]


def test_a_detection_that_takes_all_the_room_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(stored, "_MOST_KEPT", 500)
    settings = [DetectionSettings(video=name, first_frame=0, last_frame=9, detector="d") for name in ("day", "night")]
    day, night = (StoredDetection(one, tmp_path) for one in settings)
    for store in (night, day):
        store.begin()
        (store.folder / "part-000000.npz").write_bytes(b"0" * 900)
    day.begin()
    assert (day.folder / "part-000000.npz").exists() and not night.folder.exists()


def test_a_place_that_cannot_be_written(video: Path, keypoint_store: Path):
    keypoint_store.parent.mkdir(parents=True, exist_ok=True)
    keypoint_store.write_text("a file, where the folder should be")
    made = detection(video, FakeDetector(one))
    with pytest.raises(InputError, match="Detected keypoints are kept there"):
        next(made.events(made.store()))


def test_room_that_another_process_took_is_made_again(video: Path, keypoint_store: Path):
    made = detection(video, FakeDetector(one))
    store = made.store()
    events = made.events(store)
    next(events)
    store.discard()
    assert isinstance(list(events)[-1], Detected)
    assert len(list(keypoint_store.rglob("part-*.npz"))) == 3


@pytest.mark.skipif(bool(networks.missing()), reason="MediaPipe's networks are not here (tcfit models add mediapipe)")
def test_no_thread_of_mediapipe_stays(shared_data: Path):
    with FrameSource(shared_data / "signs" / "gebaerden" / "video.mp4") as source:
        made = Detection(source=source, frames=range(40), detector=find_detector("mediapipe-fast"))
        events = made.events(made.store())
        for _ in range(3):
            next(events)
        events.close()
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("tcfit: hands")]
