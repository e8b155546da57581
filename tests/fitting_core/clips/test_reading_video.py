"""Clips of a video alone: keypoints are found, once, and go the way of those from files."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fitting_core import DetectionProgress, InputError, read_clip, read_people
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.reading import read_footage
from fitting_core.detect.detectors import DETECTORS
from fitting_core.lens import straightened_keypoints
from fitting_core.video.decoding import VideoFile
from tests.fitting_core.io.cameras.camera_files import own
from tests.samples.clip_options import as_options
from tests.samples.fake_detector import FakeDetector, People, known

SIZE = (320, 240)
Figure = Callable[..., np.ndarray]
Fake = Callable[..., FakeDetector]


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Fake:
    """fake(people): the detector that is taken where nobody names one finds these."""

    def put(people: People) -> FakeDetector:
        detector = FakeDetector(people)
        monkeypatch.setitem(DETECTORS, "mediapipe", known(detector))
        return detector

    return put


@pytest.fixture
def walker(fake: Fake, figure: Figure) -> FakeDetector:
    """The person's neck is at x = 100 + n in frame n."""
    return fake(lambda frame: figure(100 + frame, 120, height=100)[None])


def test_a_video_is_enough(video, walker: FakeDetector):
    path, told = video(10), []
    clip = read_clip(path, tell=told.append)
    assert np.allclose(clip.keypoints.xy[:, 1, 0], 100 + np.arange(10), atol=0.1)
    assert (clip.name, clip.source, clip.first_frame, clip.frame_rate) == ("walk", path, 0, 25.0)
    assert clip.notes == ("Keypoints were found by fake (version 1).",)
    assert clip.found_by == "fake (version 1)" and clip.detector == "mediapipe"
    assert told[0] == DetectionProgress(done=0, total=10, kept=0)
    assert told[-1] == DetectionProgress(done=10, total=10, kept=10)
    assert clip.silhouettes is not None and len(clip.silhouettes) == 10 and clip.silhouettes.known.all()


def test_each_frame_is_decoded_once_and_the_camera_is_that_of_cached_keypoints(
    video, walker: FakeDetector, monkeypatch: pytest.MonkeyPatch
):
    """The pictures from which lens and vertical are estimated are taken while frames are decoded for the detector."""
    path, decoded, read = video(40), [], VideoFile.read

    def counted(file: VideoFile, index: int) -> np.ndarray | None:
        decoded.append(index)
        return read(file, index)

    monkeypatch.setattr(VideoFile, "read", counted)
    first = read_clip(path)
    assert sorted(set(decoded)) == list(range(40)) and len(decoded) - decoded.count(0) == 39
    decoded.clear()
    assert read_clip(path).camera == first.camera
    assert len(set(decoded)) == 15


def test_nothing_is_found_twice(video, walker: FakeDetector):
    path = video(10)
    first = read_clip(path)
    assert walker.asked == list(range(10))
    for again in (read_clip(path, clip=ClipOptions(person=0)), read_people(path)[0].clip):
        assert np.array_equal(again.keypoints.xy, first.keypoints.xy)
    assert walker.asked == list(range(10))


def test_what_stops_it_is_not_lost(video, walker: FakeDetector):
    path = video(10)

    def stop(progress: DetectionProgress) -> None:
        if progress.done == 6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read_clip(path, tell=stop)
    assert walker.closed == 1 and len(read_clip(path)) == 10
    assert walker.asked == [*range(6), *range(4, 10)]


def test_a_part_of_the_clip_alone_is_looked_at(video, walker: FakeDetector):
    clip = read_clip(video(10), clip=ClipOptions(first_frame=2, last_frame=7))
    assert walker.asked == [2, 3, 4, 5, 6, 7]
    assert clip.first_frame == 2 and np.allclose(clip.keypoints.xy[:, 1, 0], 102 + np.arange(6), atol=0.1)


def test_options_are_checked_before_minutes_pass(video, walker: FakeDetector, tmp_path: Path):
    path = video(10)
    file = own(tmp_path / "c.npz", K=np.diag([500.0, 500, 1]), size=(999, 999))
    wrong: list[dict[str, Any]] = [
        {"first_frame": 20},
        {"frame_rate": -1.0},
        {"image_size": (3, 3)},
        {"camera": tmp_path / "none.npz"},
        {"camera": file},
        {"fov": 500.0},
    ]
    for options in wrong:
        with pytest.raises(InputError):
            read_clip(path, **as_options(options))
    assert not walker.asked


def test_more_frames_than_the_memory_holds(video, walker: FakeDetector, monkeypatch: pytest.MonkeyPatch):
    """Said before hours of detection, with what to do."""
    pages = {"SC_PAGE_SIZE": 1000, "SC_PHYS_PAGES": 6 * 35}
    monkeypatch.setattr(os, "sysconf", pages.__getitem__)
    assert len(read_clip(video(6))) == 6
    walker.asked.clear()
    with pytest.raises(InputError, match=r"walk.avi has 7 frames to fit.*--part-minutes"):
        read_clip(video(7))
    assert not walker.asked
    assert len(read_clip(video(7), clip=ClipOptions(last_frame=5))) == 6


def test_a_picture_and_a_folder_in_smplifyx_layout_without_keypoints(tmp_path: Path, walker: FakeDetector):
    (tmp_path / "clip" / "images").mkdir(parents=True)
    for t in range(6):
        cv2.imwrite(str(tmp_path / "clip" / "images" / f"{t}.png"), np.full((240, 320, 3), 9, np.uint8))
    clip = read_clip(tmp_path / "clip")
    assert clip.name == "clip" and clip.source == tmp_path / "clip" / "images" and len(clip) == 6
    assert len(read_clip(tmp_path / "clip" / "images" / "3.png")) == 1


def test_who_is_meant(video, fake: Fake, figure: Figure):
    def people(frame: int) -> np.ndarray:
        both = [figure(240 - frame, 120, height=50), figure(100 + frame, 120, height=100)]
        return np.stack(both[:1] if frame == 5 else both)

    fake(people)
    path = video(12)
    clip, other = read_clip(path), read_clip(path, clip=ClipOptions(person=0))
    assert clip.keypoints.xy[0, 1, 0] == pytest.approx(100, abs=0.1)
    assert "Person: found in 11 of 12 frames, not in frames 5." in clip.notes[1]
    assert clip.silhouettes is not None and clip.silhouettes.known.tolist() == [t != 5 for t in range(12)]
    assert clip.silhouettes.packed[0].min() == 1, "the second in the list"
    assert other.keypoints.xy[0, 1, 0] == pytest.approx(240, abs=0.1)
    assert other.silhouettes is not None and other.silhouettes.packed[0].max() == 0
    one, two = read_people(path)
    assert (one.about.frames, two.about.frames) == ((0, 11), (0, 11))
    assert two.clip.silhouettes is not None and two.clip.silhouettes.packed[0].max() == 0
    assert one.clip.found_by == "fake (version 1)"


def test_everybodys_silhouettes_are_cut_as_the_person_is(video, fake: Fake, figure: Figure):
    def people(frame: int) -> np.ndarray:
        late = [figure(240, 120, height=60)] if frame >= 4 else []
        return np.stack([figure(100, 120, height=100), *late])

    fake(people)
    _, late = read_people(video(16))
    assert late.clip.first_frame == 4 and len(late.clip) == 12
    assert late.clip.silhouettes is not None and len(late.clip.silhouettes) == 12


def test_nobody_is_found(video, fake: Fake):
    fake(lambda frame: np.zeros((0, 137, 3)))
    for read in (read_clip, read_people):
        with pytest.raises(InputError, match=r"found nobody in any of the 3 frames of .*walk.avi"):
            read(video(3))
    with pytest.raises(InputError, match="fake found nobody in the only frame of"):
        read_clip(video(1))


def test_frames_are_looked_at_as_they_were_filmed(video, walker: FakeDetector, tmp_path: Path):
    """And what is found in them is straightened, as from files."""
    path = video(6)
    matrix = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    file = own(tmp_path / "c.npz", K=matrix, size=SIZE, dist=(-0.2, 0.05, 0, 0))
    filmed, clip = read_clip(path), read_clip(path, camera=CameraOptions(camera=file))
    assert walker.asked == list(range(6)) and clip.camera.lens is not None
    straight = straightened_keypoints(filmed.keypoints, clip.camera.lens)[0]
    assert np.allclose(clip.keypoints.xy, straight.xy) and not np.allclose(clip.keypoints.xy, filmed.keypoints.xy)
    assert clip.silhouettes is not None and filmed.silhouettes is not None
    assert np.array_equal(clip.silhouettes.packed, filmed.silhouettes.packed)


def test_a_detector_by_name_by_itself_and_one_that_is_not_there(
    video, walker: FakeDetector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = video(3)
    mine = FakeDetector(lambda frame: np.zeros((0, 137, 3)), version="mine")
    with pytest.raises(InputError, match="found nobody"):
        read_clip(path, detector=mine)
    with pytest.raises(InputError, match="detector 'odd' is not known; expected one of mediapipe"):
        read_clip(path, clip=ClipOptions(detector="odd"))
    monkeypatch.undo()
    monkeypatch.setenv("TCFIT_DETECTORS", str(tmp_path))
    for name, get in (("mediapipe", "tcfit models add mediapipe"), ("dwpose-l", "tcfit models add dwpose-l")):
        with pytest.raises(InputError, match=get):
            read_clip(path, clip=ClipOptions(detector=name))


def test_footage_has_no_keypoints(video, walker: FakeDetector):
    clip = read_footage(video(4), clip=ClipOptions(first_frame=1))
    assert (len(clip), clip.first_frame, clip.notes, clip.found_by) == (3, 1, (), "")
    assert not clip.keypoints.confidence.any() and clip.silhouettes is None and not walker.asked
