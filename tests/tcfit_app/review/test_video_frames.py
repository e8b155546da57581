"""Frames of the video for the views."""

import random
import re
import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.clip import Clip
from fitting_core.video.frames import FrameSource
from tcfit_app.review.shared import video_frames
from tcfit_app.review.shared.video_frames import FrameSize, VideoFrames, Videos, placeholder, shown_size
from tests.drivers.waiting import until
from tests.samples.media import write_film
from tests.samples.project_samples import CAMERA, sample_clip

COUNT, SIZE, STEP = 24, (1200, 640), 10


def decoded(jpeg: bytes) -> np.ndarray:
    """RGB."""
    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]  # pyright: ignore[reportOptionalSubscript]


def shown(jpeg: bytes) -> int:
    """The index that a frame's grey tells; its left half is red."""
    return round(float(decoded(jpeg)[:, -20:].mean()) / STEP)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walk(tmp_path_factory.mktemp("video") / "walk.avi", SIZE)


def walk(path: Path, size: tuple[int, int]) -> Path:
    """A video whose frames' right halves tell their index."""
    images = [np.full((size[1], size[0], 3), STEP * index, np.uint8) for index in range(COUNT)]
    for image in images:
        image[:, : size[0] // 2] = (0, 0, 255)
    return write_film(path, images)


@pytest.fixture
def opened(video: Path) -> Callable[..., VideoFrames]:
    """opened(source=video, **options): frames that are closed at the end."""
    every: list[VideoFrames] = []

    def make(source: Path | None = video, *, numbers: range = range(COUNT), **options) -> VideoFrames:
        every.append(VideoFrames(source, numbers=numbers, size=SIZE, **options))
        return every[-1]

    yield make  # pyright: ignore[reportReturnType]
    for frames in every:
        frames.close()


def waited(frames: VideoFrames, frame: int, kind: FrameSize = "full") -> bytes:
    """The frame, or what stands in its place, once it is there."""
    until(lambda: frames.get(frame, kind) is not None)
    return frames.get(frame, kind) or waited(frames, frame, kind)


@pytest.mark.parametrize(
    ("size", "small"),
    [((1920, 1080), (960, 540)), ((1088, 1920), (540, 953)), ((640, 480), (640, 480)), ((4000, 10), (960, 2))],
)
def test_playing_frames_are_small_and_keep_their_shape(size: tuple[int, int], small: tuple[int, int]):
    assert shown_size(size, "playing") == small and shown_size(size, "full") == size


@pytest.mark.parametrize(("kind", "size"), [("playing", (960, 512)), ("full", SIZE)])
def test_every_frame_in_any_order(opened: Callable[..., VideoFrames], kind: FrameSize, size: tuple[int, int]):
    frames = opened(fill=False)
    order = list(range(COUNT))
    random.Random(0).shuffle(order)
    for frame in order:
        jpeg = waited(frames, frame, kind)
        assert shown(jpeg) == frame and decoded(jpeg).shape[1::-1] == size
        assert frames.get(frame, kind) == jpeg and frames.problem_of(frame) == ""
    red = decoded(waited(frames, 3))[:, : SIZE[0] // 3].mean((0, 1))
    assert red[0] > 240 and red[1:].max() < 15


@pytest.mark.parametrize("at", ["opening", "decoding"])
def test_whatever_goes_wrong_in_the_thread_is_told_and_nobody_waits_for_ever(
    opened: Callable[..., VideoFrames], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, at: str
):
    def fail(*given: object, **named: object) -> None:
        raise MemoryError("no room")

    if at == "opening":
        monkeypatch.setattr(video_frames, "FrameSource", fail)
    else:
        monkeypatch.setattr(FrameSource, "frame", fail)
    frames = opened()
    assert waited(frames, 1) and frames.problem_of(1) == "MemoryError: no room" and "no room" in caplog.text
    assert waited(frames, 2) and frames.problem_of(2)


def test_asking_does_not_wait_but_has_the_frame_decoded(opened: Callable[..., VideoFrames]):
    frames = opened(fill=False)
    assert frames.get(20) is None and frames.nearest(20) is None
    until(lambda: frames.get(20) is not None)
    found = frames.nearest(20, "playing")
    assert found is not None and found is frames.get(20) and shown(found) == 20
    until(lambda: frames.get(20, "playing") not in (None, found))
    assert frames.nearest(20, "playing") is frames.get(20, "playing")


def test_a_small_clip_is_kept_in_one_size(tmp_path: Path):
    small = walk(tmp_path / "small.avi", (192, 108))
    with closing(VideoFrames(small, numbers=range(COUNT), size=(192, 108))) as frames:
        assert waited(frames, 7) is frames.get(7, "playing") is frames.nearest(7)
        until(lambda: len(frames._cache) == COUNT)


def test_frames_to_be_played_are_there_without_asking(opened: Callable[..., VideoFrames]):
    frames = opened(fill=False)
    frames.prefetch([22, 23, 10, 11], reader="page 1")
    frames.prefetch(range(5, 2, -1), reader="page 2")
    wanted = [22, 23, 10, 11, 5, 4, 3]
    until(lambda: all((frame, "playing") in frames._cache for frame in wanted))
    assert len(frames._cache) == len(wanted)


def test_a_waiting_reader_comes_before_what_is_played(opened: Callable[..., VideoFrames], monkeypatch):
    order, gate = [], threading.Event()
    original = FrameSource.frame

    def recorded(self: FrameSource, index: int) -> np.ndarray:
        gate.wait(10)
        order.append(index)
        return original(self, index)

    monkeypatch.setattr(FrameSource, "frame", recorded)
    frames = opened(fill=False)
    frames.prefetch(range(0, 8))
    until(lambda: any(frames._coming.values()) and len(frames._coming[None]) < 8)  # one of them is being decoded
    frames.get(19)
    frames.get(21)
    gate.set()
    until(lambda: len(order) == 10)
    assert order[:4] == [0, 21, 19, 1]


def test_what_was_to_be_played_is_forgotten(opened: Callable[..., VideoFrames]):
    frames = opened(fill=False)
    frames.prefetch(range(COUNT), reader=1)
    frames.prefetch([3], reader=1)
    frames.prefetch(range(COUNT), reader=2)
    frames.leave(2)
    waited(frames, 3, "playing")
    time.sleep(0.05)
    assert len(frames._cache) < COUNT


def test_the_rest_of_the_clip_follows(opened: Callable[..., VideoFrames]):
    frames = opened()
    until(lambda: all((frame, "playing") in frames._cache for frame in range(COUNT)))
    assert all(shown(frames.get(frame, "playing") or b"") == frame for frame in range(COUNT))


def test_the_rest_of_the_clip_leaves_half_of_the_memory(opened: Callable[..., VideoFrames]):
    one = len(waited(opened(), 2, "playing"))
    frames = opened(limit=10 * one)
    until(lambda: frames._cache.used >= 5 * one * 0.9)
    time.sleep(0.1)
    assert frames._cache.used < 7 * one


@pytest.mark.parametrize("source", [None, "gone.mp4", "text.mp4"])
def test_no_video_is_a_grey_frame_and_a_reason(opened: Callable[..., VideoFrames], tmp_path: Path, source: str | None):
    (tmp_path / "text.mp4").write_text("no video")
    frames = opened(tmp_path / source if source else None)
    assert waited(frames, 3, "playing") == placeholder(SIZE, "playing") == frames.get(4, "playing")
    assert decoded(waited(frames, 0)).shape[1::-1] == SIZE
    expected = {None: "no video", "gone.mp4": "does not exist", "text.mp4": "is not a video"}[source]
    assert expected in frames.problem_of(0) and expected in frames.problem_of(2)


def test_missing_frames_are_grey_and_the_others_are_not(opened: Callable[..., VideoFrames]):
    frames = opened(numbers=range(COUNT + 3))
    assert shown(waited(frames, COUNT - 1)) == COUNT - 1
    assert waited(frames, COUNT) == placeholder(SIZE, "full")
    assert f"There is no frame {COUNT}" in frames.problem_of(COUNT)
    assert frames.problem_of(0) == "" and frames.problem_of(COUNT - 1) == ""
    assert frames.get(COUNT) == placeholder(SIZE, "full"), "it is not decoded again and again"


def test_a_video_that_comes_back_is_shown(
    opened: Callable[..., VideoFrames], video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """As on a network drive that was away for a while."""
    monkeypatch.setattr(video_frames, "_RETRY", 0.05)
    arrived: list[None] = []
    frames = opened(tmp_path / "a.avi", arrived=lambda: arrived.append(None))
    until(lambda: frames.problem_of(3) != "")
    assert waited(frames, 3) == placeholder(SIZE, "full") and len(arrived) == 1
    shutil.copy(video, tmp_path / "part")
    (tmp_path / "part").rename(tmp_path / "a.avi")
    until(lambda: frames.problem_of(3) == "")
    assert shown(waited(frames, 3)) == 3 and len(arrived) > 1


def test_a_frame_that_can_be_read_again_is_shown(
    opened: Callable[..., VideoFrames], video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(video_frames, "_RETRY", 0.05)
    file, content = tmp_path / "a.avi", bytearray(video.read_bytes())
    starts = [match.start() for match in re.finditer(rb"\xff\xd8\xff", content)]
    assert len(starts) == COUNT
    content[starts[12] : starts[13] - 20] = bytes(starts[13] - 20 - starts[12])
    file.write_bytes(content)
    frames = opened(file, fill=False)
    assert waited(frames, 12) == placeholder(SIZE, "full") and "cannot be decoded" in frames.problem_of(12)
    file.write_bytes(video.read_bytes())
    until(lambda: frames.get(12) != placeholder(SIZE, "full"))
    assert shown(waited(frames, 12)) == 12 and frames.problem_of(12) == ""


def test_closing_ends_the_thread_at_once(video: Path):
    frames = VideoFrames(video, numbers=range(COUNT), size=SIZE)
    frames.prefetch(range(COUNT))
    frames.close()
    assert not frames._thread.is_alive()
    found = frames.get(9)
    assert found is not None and decoded(found).shape[1::-1] == SIZE, "nobody waits for it any more"
    frames.close()


def test_many_readers_at_once(opened: Callable[..., VideoFrames]):
    frames = opened(limit=10**6)
    wanted = [random.Random(seed).randrange(COUNT) for seed in range(60)]
    with ThreadPoolExecutor(6) as pool:
        assert [shown(jpeg) for jpeg in pool.map(lambda f: waited(frames, f, "playing"), wanted)] == wanted


# --- one video for several people ---


def clip_of(source: Path, first: int, count: int) -> Clip:
    return replace(sample_clip(count), camera=replace(CAMERA, size=SIZE), source=source, first_frame=first)


def test_people_of_one_video_share_its_frames(video: Path):
    one, other = clip_of(video, 0, 8), clip_of(video, 5, 7)
    videos = Videos([one, other], lambda: None)
    first, second = videos.of(one), videos.of(other)
    assert first is second and first.numbers == range(12)
    assert [shown(waited(first, number)) for number in (0, 5, 11)] == [0, 5, 11]
    videos.leave(first)
    assert shown(waited(second, 7)) == 7, "it is still open"
    videos.leave(second)
    assert not second._thread.is_alive()


def test_another_video_and_frames_beyond_the_others_are_opened_for_themselves(video: Path, tmp_path: Path):
    moved = Path(shutil.copy(video, tmp_path))
    videos = Videos([clip_of(video, 0, 4)], lambda: None)
    opened = [videos.of(clip) for clip in (clip_of(video, 0, 4), clip_of(moved, 2, 3), clip_of(video, 2, 8))]
    assert [one.numbers for one in opened] == [range(4), range(2, 5), range(2, 10)]
    assert shown(waited(opened[1], 2)) == 2 and shown(waited(opened[2], 9)) == 9
    for one in opened:
        videos.leave(one)
