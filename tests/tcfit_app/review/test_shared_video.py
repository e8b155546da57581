"""One video for several people, decoded once."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from fitting_core.clip import Clip
from tcfit_app.review.shared.video_frames import VideoFrames, Videos
from tests.drivers.waiting import until
from tests.samples.project_samples import CAMERA, sample_clip

FRAMES = 12


def clip_of(folder: Path, first: int, count: int) -> Clip:
    return replace(sample_clip(count), camera=replace(CAMERA, size=(64, 48)), source=folder, first_frame=first)


def images(folder: Path) -> Path:
    """Frame n is as bright as 20 n."""
    folder.mkdir()
    for n in range(FRAMES):
        cv2.imwrite(str(folder / f"{n:03d}.png"), np.full((48, 64, 3), 20 * n, np.uint8))
    return folder


def brightness(video: VideoFrames, frame: int) -> float:
    found = until(lambda: video.get(frame))
    return float(cv2.imdecode(np.frombuffer(found, np.uint8), cv2.IMREAD_COLOR).mean())


def test_people_of_one_video_share_its_frames(tmp_path: Path) -> None:
    source = images(tmp_path / "video")
    one, other = clip_of(source, 0, 8), clip_of(source, 5, 7)
    videos = Videos([one, other], lambda: None)
    first, second = videos.of(one), videos.of(other)
    assert first is second and first.numbers == range(12)
    for number in (0, 5, 11):
        assert abs(brightness(first, number) - 20 * number) < 2
    videos.leave(first)
    assert abs(brightness(second, 7) - 140) < 2  # still open
    videos.leave(second)
    assert not second._thread.is_alive()


def test_another_video_and_frames_beyond_the_others_are_opened_for_themselves(tmp_path: Path) -> None:
    source, moved = images(tmp_path / "video"), images(tmp_path / "elsewhere")
    videos = Videos([clip_of(source, 0, 4)], lambda: None)
    shown = [videos.of(clip) for clip in (clip_of(source, 0, 4), clip_of(moved, 2, 3), clip_of(source, 2, 8))]
    assert [video.numbers for video in shown] == [range(4), range(2, 5), range(2, 10)]
    assert abs(brightness(shown[1], 2) - 40) < 2 and abs(brightness(shown[2], 9) - 180) < 2
    for video in shown:
        videos.leave(video)
