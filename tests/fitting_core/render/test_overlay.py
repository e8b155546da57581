"""Overlay videos: what is in them, and that nothing half-written stays."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.render.overlay import LABELS, Panel, write_overlay
from fitting_core.video import encoding
from fitting_core.video.encoding import video_writer

needs_gl = pytest.mark.usefixtures("off_screen_gl")

CAMERA = Camera(focal=(300.0, 300.0), center=(160.0, 120.0), size=(320, 240))
BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
FACES = np.asarray(BALL.faces)
FRAMES = 4


def frames(count: int = FRAMES, size: tuple[int, int] = (320, 240)) -> Iterator[np.ndarray]:
    for i in range(count):
        yield np.full((size[1], size[0], 3), 40 + 10 * i, np.uint8)


def bodies(x: float, count: int = FRAMES) -> Iterator[np.ndarray]:
    for _ in range(count):
        yield np.asarray(BALL.vertices) + np.array([x, 0.0, 2.0])


def panels(count: int = FRAMES) -> list[Panel]:
    return [Panel(label=LABELS[0], vertices=bodies(-0.4, count)), Panel(label=LABELS[1], vertices=bodies(0.4, count))]


def decode(path: Path) -> np.ndarray:
    capture = cv2.VideoCapture(str(path))
    images = []
    while True:
        ok, image = capture.read()
        if not ok:
            return np.array(images)[..., ::-1].astype(int)
        images.append(image)


@needs_gl
def test_each_fit_is_drawn_in_its_panel(tmp_path: Path) -> None:
    done: list[int] = []
    path = tmp_path / "side by side.mp4"
    count = write_overlay(path, frames(), panels(), faces=FACES, camera=CAMERA, frame_rate=25, progress=done.append)
    video = decode(path)
    assert count == FRAMES and done == [1, 2, 3, 4]
    assert video.shape == (FRAMES, 240, 2 * 320 + 4, 3)
    left, right = video[:, :, :320], video[:, :, 324:]
    for i in range(FRAMES):
        empty = np.full(3, 40 + 10 * i)
        # The balls' middles project to x = 160 -+ 60.
        assert np.abs(left[i, 120, 100] - empty).max() > 40 and np.abs(left[i, 120, 220] - empty).max() < 12
        assert np.abs(right[i, 120, 220] - empty).max() > 40 and np.abs(right[i, 120, 100] - empty).max() < 12
    # Blue left, orange right, as A and B in the app.
    assert left[0, 120, 100, 0] < left[0, 120, 100, 2] and right[0, 120, 220, 0] > right[0, 120, 220, 2]
    # A caption in each corner.
    assert left[0, :30, :90].max() > 180 and right[0, :30, :90].max() > 180
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@needs_gl
def test_tall_videos_are_scaled_down_with_body_and_keypoints(tmp_path: Path) -> None:
    big = Camera(focal=(600.0, 600.0), center=(320.0, 240.0), size=(640, 480))
    xy, confidence = np.zeros((2, COUNT, 2)), np.zeros((2, COUNT))
    xy[:, 0], confidence[:, 0] = (500.0, 400.0), 1.0
    write_overlay(
        tmp_path / "one.mp4",
        frames(2, (640, 480)),
        [Panel(label="fit", vertices=bodies(0.0, 2))],
        faces=FACES,
        camera=big,
        frame_rate=25,
        keypoints=Keypoints(xy=xy, confidence=confidence),
        max_height=240,
    )
    video = decode(tmp_path / "one.mp4")
    assert video.shape == (2, 240, 320, 3)
    assert np.abs(video[0, 120, 160] - 40).max() > 40, "the body, at the middle"
    assert video[0, 200, 250, 0] > 150 and video[0, 200, 250, 2] < 120, "the yellow nose, at half its pixels"
    assert np.abs(video[0, 20, 300] - 40).max() < 12


@needs_gl
def test_a_frame_without_a_fit_shows_the_video(tmp_path: Path) -> None:
    vertices = [next(bodies(0.0)), None]
    path = tmp_path / "gap.mp4"
    panel = Panel(label="fit", vertices=vertices)
    write_overlay(path, frames(2), [panel], faces=FACES, camera=CAMERA, frame_rate=25)
    first, second = decode(path)
    assert np.abs(first[120, 160] - 40).max() > 40 and np.abs(second[120, 160] - 50).max() < 12


BAD = {
    "frames of another size": (lambda: frames(size=(322, 240)), panels, None, "322 x 240"),
    "a fit that is too short": (frames, lambda: panels(3), None, '"SMPLify-X" ends after 3 frames'),
    "a fit that is too long": (
        frames,
        lambda: panels(6),
        None,
        "video ends after 4 frames, before SMPLify-X, temporal",
    ),
    "no frames": (lambda: frames(0), panels, None, "no frames"),
    "keypoints that are too short": (frames, panels, 2, "2 of the keypoints"),
}


@needs_gl
@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_explained_and_leaves_the_old_file(tmp_path: Path, case: str) -> None:
    make_frames, make_panels, count, message = BAD[case]
    keypoints = (
        None if count is None else Keypoints(xy=np.zeros((count, COUNT, 2)), confidence=np.zeros((count, COUNT)))
    )
    path = tmp_path / "out.mp4"
    path.write_bytes(b"older")
    with pytest.raises(InputError, match=message):
        write_overlay(
            path, make_frames(), make_panels(), faces=FACES, camera=CAMERA, frame_rate=25, keypoints=keypoints
        )  # fmt: skip
    assert path.read_bytes() == b"older" and list(tmp_path.iterdir()) == [path]


def test_a_video_holds_what_it_was_given(tmp_path: Path) -> None:
    path, images = tmp_path / "video.mp4", [np.full((64, 96, 3), (200, 60, 20), np.uint8)] * 3
    with video_writer(path, (96, 64), 12.5) as video:
        for image in images:
            video.write(image)
    capture = cv2.VideoCapture(str(path))
    assert int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little") in (b"h264", b"avc1")
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)
    decoded = decode(path)
    assert decoded.shape == (3, 64, 96, 3)
    assert np.abs(decoded - [200, 60, 20]).max() < 20, "colours come back as RGB"


def test_an_error_while_writing_leaves_nothing(tmp_path: Path) -> None:
    with (
        pytest.raises(RuntimeError, match="stop"),
        video_writer(tmp_path / "v.mp4", (64, 64), 25) as video,
    ):
        video.write(np.zeros((64, 64, 3), np.uint8))
        raise RuntimeError("stop")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "message"), [("v.avi", "end it in .mp4"), ("nowhere/v.mp4", "create it first")])
def test_bad_targets_are_explained(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message), video_writer(tmp_path / name, (64, 64), 25):
        pass


def test_a_full_disk_is_told_and_leaves_the_old_file(tmp_path: Path) -> None:
    """The limit of a file's size stands in for a full disk."""
    path = tmp_path / "v.mp4"
    path.write_bytes(b"older")
    code = f"""
import resource
from pathlib import Path
import numpy as np
from fitting_core.video import encoding
from fitting_core.video.encoding import video_writer
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
noise = np.random.default_rng(0)
with video_writer(Path({str(path)!r}), (640, 480), 25) as video:
    for _ in range(3):
        video.write(noise.integers(0, 255, (480, 640, 3), dtype=np.uint8))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1 and "File too large" in done.stderr
    assert path.read_bytes() == b"older" and list(tmp_path.iterdir()) == [path]


def test_a_missing_encoder_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoding, "CODEC", "none")
    with pytest.raises(InputError, match="PyAV cannot write"), video_writer(tmp_path / "v.mp4", (64, 64), 25):
        pass
