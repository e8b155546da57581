"""Overlay videos: what is in them, and that nothing half-written stays."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera, World
from fitting_core.errors import InputError
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.motion import Motion
from fitting_core.render.colors import linear, rgb
from fitting_core.render.overlay import Cell, Shown, picture_of, pictures, write_overlay, write_sheet
from fitting_core.video.encoding import video_writer

needs_gl = pytest.mark.usefixtures("off_screen_gl")

CAMERA = Camera(focal=(300.0, 300.0), center=(160.0, 120.0), size=(320, 240))
FRAMES = 4


def motion(
    body: BodyModel, x: float = 0.0, *, camera: Camera = CAMERA, count: int = FRAMES, depth: float = 4.0
) -> Motion:
    """Somebody who stands before the camera in a T pose, facing it."""
    params = BodyParams.neutral(count)
    params.global_orient[:, 0] = torch.pi
    params.camera_translation[:] = torch.tensor([x, 0.2, depth])
    return Motion(body=body, params=params, camera=camera, frame_rate=25.0, name="still")


def image(frame: int) -> np.ndarray:
    return np.full((240, 320, 3), 40 + 10 * frame, np.uint8)


def drawn_part(picture: np.ndarray, background: int | list[int]) -> np.ndarray:
    return (np.abs(picture.astype(int) - background) > 12).any(-1)


def decode(path: Path) -> np.ndarray:
    capture = cv2.VideoCapture(str(path))
    images = []
    while True:
        ok, image = capture.read()
        if not ok:
            return np.array(images)[..., ::-1].astype(int)
        images.append(image)


@needs_gl
def test_each_fit_is_drawn_in_its_panel(tmp_path: Path, free_body: BodyModel) -> None:
    done: list[int] = []
    path = tmp_path / "side by side.mp4"
    shown = [
        Shown(motion=motion(free_body, x), color=linear(color), label=label)
        for x, color, label in ((-1.0, "beside", "one"), (1.0, "fit", "other"))
    ]
    write_overlay(path, shown, image=image, progress=done.append)
    video = decode(path)
    assert done == [1, 2, 3, 4] and video.shape == (FRAMES, 240, 2 * 320 + 4, 3)
    left, right = video[:, :, :320], video[:, :, 324:]
    for i in range(FRAMES):
        for part, side in ((left[i], -1), (right[i], 1)):
            columns = np.flatnonzero(drawn_part(part[100:], 40 + 10 * i).sum(0) > 20)
            assert abs(columns.mean() - (160 + side * 75)) < 10, "x of 1 m at 4 m, at 300 pixels"
    red_over_blue = video[0, 100:, :, 0] - video[0, 100:, :, 2]
    assert red_over_blue[:, :320].min() < -30 and red_over_blue[:, 324:].max() > 40, "violet left, orange right"
    assert left[0, :30, :60].max() > 180 and right[0, :30, :60].max() > 180, "a caption in each corner"
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@needs_gl
def test_tall_videos_are_scaled_down_with_body_and_keypoints(free_body: BodyModel) -> None:
    big = Camera(focal=(600.0, 600.0), center=(320.0, 240.0), size=(640, 480))
    xy, confidence = np.zeros((2, COUNT, 2)), np.zeros((2, COUNT))
    xy[:, 0], confidence[:, 0] = (600.0, 400.0), 1.0
    seen = Shown(motion=motion(free_body, camera=big, count=2))
    points = Keypoints(xy=xy, confidence=confidence)
    (picture,) = pictures(
        [seen], [1], image=lambda frame: np.full((480, 640, 3), 40, np.uint8), keypoints=points, height=240
    )
    assert picture.shape == (240, 320, 3) and drawn_part(picture, 40)[90, 160], "the chest"
    assert abs(picture[200, 300] - rgb("body")).max() < 12, "the nose, at half its pixels"
    assert not drawn_part(picture, 40)[20, 300]


@needs_gl
def test_the_side_shows_an_upright_body_whole_and_narrow(free_body: BodyModel) -> None:
    """Arms stretched out are wide for the camera and narrow from the side, wherever the camera stands."""
    along_x = World(rotation=((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)), translation=(0.0, 0.0, 3.0), up="y")
    for world in (None, along_x):
        camera = Camera(focal=(300.0, 300.0), center=(160.0, 120.0), size=(320, 240), world=world)
        picture = picture_of(motion(free_body, camera=camera), 0, "side", height=300)
        body = np.ptp(picture, axis=-1) > 4  # white and grey are the floor
        assert picture.shape == (300, 300, 3)
        assert not (body[0].any() or body[-1].any() or body[:, 0].any() or body[:, -1].any())
        wide, tall = np.ptp(np.flatnonzero(body.any(0))), np.ptp(np.flatnonzero(body.any(1)))
        assert tall > 2.5 * wide


@needs_gl
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"image": lambda frame: np.zeros((240, 322, 3), np.uint8)}, "322 x 240"),
        (
            {"keypoints": Keypoints(xy=np.zeros((2, COUNT, 2)), confidence=np.zeros((2, COUNT)))},
            "keypoints of 2 frames",
        ),
    ],
)
def test_bad_input_is_explained_and_leaves_the_old_file(
    tmp_path: Path, free_body: BodyModel, options: dict[str, Any], message: str
) -> None:
    path = tmp_path / "out.mp4"
    path.write_bytes(b"older")
    with pytest.raises(InputError, match=message):
        write_overlay(path, [Shown(motion=motion(free_body))], **options)
    assert path.read_bytes() == b"older" and list(tmp_path.iterdir()) == [path]


def test_frames_and_views_that_do_not_exist_are_refused(free_body: BodyModel) -> None:
    with pytest.raises(InputError, match="no frame 4 to draw: the motion has frames 0 to 3"):
        picture_of(motion(free_body), 4)
    with pytest.raises(InputError, match="no view 'top'; expected camera or side"):
        picture_of(motion(free_body), 0, "top")  # pyright: ignore[reportArgumentType]


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


def test_a_sheet_is_written_whole_or_not_at_all(tmp_path: Path):
    cells = [Cell(picture=np.full((8, 8, 3), 7, np.uint8))]
    write_sheet(tmp_path / "sheet.png", cells, 1)
    assert (tmp_path / "sheet.png").read_bytes()[:4] == b"\x89PNG"
    for path in (tmp_path / "missing" / "sheet.png", tmp_path / "sheet.nothing"):
        with pytest.raises(InputError, match=r"sheet\.png"):
            write_sheet(path, cells, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.png"]
