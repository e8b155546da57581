"""A clip filmed through a lens that bends: straightened once, where it comes in; bent again where it goes out."""

from dataclasses import replace
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from fitting_core.camera import Camera, Lens, Vertical, World, is_possible
from fitting_core.clips.options import CameraOptions
from fitting_core.clips.reading import read_clip, read_footage, read_keypoints
from fitting_core.errors import InputError
from fitting_core.io.camera_arrays import camera_arrays, camera_from
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.keypoints import COUNT, Keypoints
from fitting_core.lens import filmed_keypoints, straightened
from fitting_core.video.frames import FrameSource
from tests.fitting_core.io.cameras import camera_files as files
from tests.samples.clip_options import as_options

SIZE = files.SIZE
SPOT = 12
"""A keypoint whose place is marked in the picture."""


def filmed_by_hand() -> Keypoints:
    """Keypoints of two frames as they were filmed, one of them not detected."""
    xy = np.random.default_rng(1).uniform((80, 60), (SIZE[0] - 90, SIZE[1] - 60), (1, COUNT, 2))
    xy = np.concatenate([xy, xy + 5.0])
    confidence = np.full((2, COUNT), 0.9)
    xy[:, 3], confidence[:, 3] = 0.0, 0.0
    return Keypoints(xy=xy, confidence=confidence)


@pytest.fixture
def shot(tmp_path: Path) -> tuple[Path, Path, Path]:
    """Images, keypoints and the camera file."""
    made, images = filmed_by_hand(), tmp_path / "images"
    images.mkdir()
    for t, (x, y) in enumerate(made.xy[:, SPOT]):
        picture = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        cv2.circle(picture, (round(16 * (x - 0.5)), round(16 * (y - 0.5))), 16 * 5, (255, 255, 255), -1, shift=4)
        cv2.imwrite(str(images / f"{t:04}.png"), picture)
    write_openpose(tmp_path / "keypoints", made, name="shot")
    return images, tmp_path / "keypoints", files.own(tmp_path / "camera.npz", up="z")


def test_keypoints_and_frames_are_straightened_alike(shot: tuple[Path, Path, Path]):
    images, keypoints, camera = shot
    clip, made = read_clip(images, keypoints, camera=CameraOptions(camera=camera)), filmed_by_hand()
    lens = clip.camera.lens
    assert lens is not None
    expected, found = straightened(lens, made.xy)
    detected = made.confidence > 0
    assert found.all() and np.abs(expected - made.xy).max() > 20
    np.testing.assert_allclose(clip.keypoints.xy[detected], expected[detected], atol=1e-3)
    with FrameSource(images, lens=lens) as frames:
        for t, picture in enumerate(frames):
            rows, columns = np.nonzero(picture[..., 0] > 127)
            spot = np.array([columns.mean(), rows.mean()]) + 0.5
            assert np.linalg.norm(spot - clip.keypoints.xy[t, SPOT]) < 0.5


def test_what_is_written_for_others_is_where_it_was_filmed(shot: tuple[Path, Path, Path]):
    images, keypoints, camera = shot
    clip, made = read_clip(images, keypoints, camera=CameraOptions(camera=camera)), filmed_by_hand()
    back = filmed_keypoints(clip.keypoints, clip.camera.lens)
    np.testing.assert_allclose(back.xy, made.xy, atol=1e-3)
    again, _, _ = read_keypoints(keypoints, read_footage(images, camera=CameraOptions(camera=camera)))
    np.testing.assert_array_equal(again.xy, clip.keypoints.xy)


def test_keypoints_where_the_lens_says_nothing_do_not_count(shot: tuple[Path, Path, Path]):
    images, keypoints, camera = shot
    files.own(camera, dist=(-0.4, 0.0, 0.0, 0.0))
    clip = read_clip(images, keypoints, camera=CameraOptions(camera=camera))
    lost = (filmed_by_hand().confidence > 0) & (clip.keypoints.confidence == 0)
    assert 0 < lost.sum() < 60 and any(f"{lost.sum()} keypoints lie where" in note for note in clip.notes)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"focal_length": 900.0}, "given twice"),
        ({"fov": 50.0}, "given twice"),
        ({"center": (640.0, 360.0)}, "given twice"),
        ({"camera": None, "camera_up": "z"}, "`camera_up` is given without"),
        ({"camera_up": "north"}, "`camera_up` is 'north'"),
        ({"camera_unit": 0.0}, "`camera_unit` is 0"),
        ({"camera_name": "left"}, "no camera named 'left'"),
    ],
)
def test_a_camera_is_given_once_and_whole(shot: tuple[Path, Path, Path], options: dict, says: str):
    images, keypoints, camera = shot
    with pytest.raises(InputError, match=says):
        read_clip(images, keypoints, **as_options({"camera": camera, **options}))


def test_lens_and_place_are_stored(shot: tuple[Path, Path, Path]):
    camera = read_footage(shot[0], camera=CameraOptions(camera=shot[2])).camera
    assert camera.lens and camera.world
    camera = replace(camera, focal_deviation=0.06, vertical=Vertical(up=(0.0, -0.8, -0.6), deviation=1.2))
    assert camera_from(camera_arrays(camera)) == camera
    assert msgspec.json.decode(msgspec.json.encode(camera), type=Camera) == camera and is_possible(camera)


def test_cameras_of_earlier_versions_are_read():
    old = b'{"focal": [900, 910], "center": [640, 360], "size": [1280, 720], "source": "given"}'
    camera = msgspec.json.decode(old, type=Camera)
    assert camera.lens is None and camera.world is None
    assert camera_from(camera_arrays(camera)) == camera


def test_a_stored_camera_that_cannot_be_is_told():
    camera = Camera(focal=(900.0, 900.0), center=(640.0, 360.0), size=SIZE)
    mirrored = World(rotation=((-1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)), translation=(0, 0, 0))
    assert is_possible(camera)
    assert not is_possible(replace(camera, world=mirrored))
    assert not is_possible(replace(camera, vertical=Vertical(up=(0.0, -2.0, 0.0), deviation=1.0)))
    assert not is_possible(replace(camera, lens=Lens(focal=(9.0, 9.0), center=(5.0, 5.0), distortion=(0.1, 0.2))))
