"""Cameras from the files of other programs: exactly what the file says, scaled to the clip, in a world of metres."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from fitting_core.camera import Camera, World
from fitting_core.errors import InputError
from fitting_core.frame_alignment import Timeline
from fitting_core.io.cameras.moving import ClipFrames
from fitting_core.io.cameras.reading import CameraFile, camera_files, read_camera
from fitting_core.lens import Straightener, filmed
from tests.fitting_core.io.cameras import camera_files as files
from tests.fitting_core.io.cameras.camera_files import DISTORTION, ROTATION, SIZE, TRANSLATION, K

CENTER = (K[0, 2] + 0.5, K[1, 2] + 0.5)
FRAMES = ClipFrames(timeline=Timeline(numbers=range(5)), part=slice(0, 5), frame_rate=25.0)
FORMS: dict[str, tuple[Callable[[Path], Path], str | None, str | None, bool]] = {
    "pose2sim": (lambda f: files.pose2sim(f / "Calib.toml"), "int_cam01_img", "z", True),
    "caliscope": (lambda f: files.caliscope(f / "camera_array.toml"), "0", "z", True),
    "opencv yaml": (lambda f: files.opencv(f / "camera.yml"), None, None, True),
    "opencv xml": (lambda f: files.opencv(f / "camera.xml"), None, None, True),
    "opencv json": (lambda f: files.opencv(f / "camera.json"), None, None, True),
    "opencv without a world": (lambda f: files.opencv(f / "camera.yaml", world=False), None, None, False),
    "ros": (lambda f: files.ros(f / "head.yaml"), None, None, False),
    "python's json": (lambda f: files.plain_json(f / "camera.json"), None, None, True),
    "npz": (lambda f: files.own(f / "camera.npz", up="y"), None, "y", True),
}
"""What writes it; the camera's name, the world's axis against gravity, and whether it has a world."""


@pytest.mark.parametrize("form", FORMS)
def test_every_form_says_the_same(form: str, tmp_path: Path):
    write, name, up, has_world = FORMS[form]
    camera = read_camera(CameraFile(path=write(tmp_path), name=name), SIZE)
    assert camera.lens and camera.calibrated
    assert camera.focal == camera.lens.focal == (K[0, 0], K[1, 1])
    assert camera.center == camera.lens.center == CENTER
    assert camera.lens.distortion == (DISTORTION[:4] if form == "pose2sim" else DISTORTION)
    assert (camera.world is not None) == has_world
    if camera.world:
        np.testing.assert_allclose(camera.world.rotation, ROTATION, atol=1e-12)
        np.testing.assert_allclose(camera.world.translation, TRANSLATION, atol=1e-12)
        assert camera.world.up == up


@pytest.mark.parametrize("model", files.COLMAP_PARAMETERS)
def test_colmap(model: str, tmp_path: Path):
    camera = read_camera(CameraFile(path=files.colmap(tmp_path / "sparse", model=model)), SIZE)
    one = model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
    assert camera.focal == (900, 900 if one else 910) and camera.center == (640.5, 360.25)
    expected = {"SIMPLE_RADIAL": (-0.1, 0, 0, 0), "RADIAL": (-0.1, 0.02, 0, 0), "OPENCV": (-0.1, 0.02, 0.001, -0.002)}
    expected["FULL_OPENCV"] = (-0.1, 0.02, 0.001, -0.002, 0.003, 0.01, 0.02, 0.003)
    assert (camera.lens.distortion if camera.lens else None) == expected.get(model)
    assert camera.world
    np.testing.assert_allclose(camera.world.rotation, ROTATION, atol=1e-12)
    np.testing.assert_allclose(camera.world.translation, TRANSLATION, atol=1e-12)
    assert any("scale" in note for note in camera.notes)


def test_of_several_cameras_one_is_named(tmp_path: Path):
    for path in (
        files.pose2sim(tmp_path / "Calib.toml"),
        files.colmap(tmp_path / "model", images=("a b.jpg", "c.jpg")),
    ):
        with pytest.raises(InputError, match="2 cameras"):
            read_camera(CameraFile(path=path), SIZE, FRAMES)
        with pytest.raises(InputError, match="'cam9'; it has "):
            read_camera(CameraFile(path=path, name="cam9"), SIZE)
    second = read_camera(CameraFile(path=tmp_path / "Calib.toml", name="int_cam02_img"), SIZE)
    assert second.world and np.allclose(second.world.translation, TRANSLATION + 1)
    second = read_camera(CameraFile(path=tmp_path / "model" / "images.txt", name="c.jpg"), SIZE)
    assert second.world and np.allclose(second.world.translation, TRANSLATION + 1)
    named = files.own(
        tmp_path / "two.npz", names=["left", "right"], K=[K, 2 * K + np.diag([0, 0, -1])], dist=None, size=[SIZE, SIZE],
        R=[ROTATION, np.eye(3)], t=[TRANSLATION, (1, 2, 3)],
    )  # fmt: skip
    right = read_camera(CameraFile(path=named, name="right"), SIZE)
    assert right.focal[0] == 2 * K[0, 0] and right.world and right.world.translation == (1, 2, 3) and not right.lens


def test_what_an_npz_has_beside_is_said_to_be_passed_over(tmp_path: Path):
    """A user's distortion was not read since it was called dist_coeffs, and nobody was told."""
    path = files.own(tmp_path / "camera.npz", dist=None, dist_coeffs=DISTORTION, size=None, image_size=SIZE, up="z")
    camera = read_camera(CameraFile(path=path), SIZE)
    assert camera.lens is None
    assert camera.notes == (
        "camera.npz: dist_coeffs: passed over; expected K, dist, size, image_size, R, t, up, names, frames.",
    )


def test_a_calibration_of_another_size_is_scaled_and_said(tmp_path: Path):
    path = files.own(tmp_path / "camera.npz")
    camera = read_camera(CameraFile(path=path), (640, 360))
    assert camera.focal == (K[0, 0] / 2, K[1, 1] / 2) and camera.center == (CENTER[0] / 2, CENTER[1] / 2)
    assert camera.size == (640, 360) and "scaled" in camera.notes[0]
    assert camera.lens and camera.lens.focal == camera.focal and camera.lens.distortion == DISTORTION
    for size in ((720, 1280), (1280, 1024)):
        with pytest.raises(InputError, match="another shape"):
            read_camera(CameraFile(path=path), size)


def test_unit_and_up_are_the_users(tmp_path: Path):
    path = files.own(tmp_path / "camera.npz", t=1000 * TRANSLATION)
    notes = read_camera(CameraFile(path=path), SIZE).notes
    assert any("millimetres" in note for note in notes) and any("camera_up" in note for note in notes)
    camera = read_camera(CameraFile(path=path, unit=0.001, up="-y"), SIZE)
    assert camera.world and camera.world.up == "-y" and camera.world.up_in_camera is not None
    assert np.allclose(camera.world.translation, TRANSLATION)
    assert np.allclose(camera.world.up_in_camera, ROTATION @ (0, -1, 0))
    with pytest.raises(InputError, match="camera_unit"):
        read_camera(CameraFile(path=files.opencv(tmp_path / "k.yml", world=False), unit=2.0), SIZE)


def test_points_of_the_world_are_filmed_where_opencv_says(tmp_path: Path):
    camera = read_camera(CameraFile(path=files.own(tmp_path / "camera.npz")), SIZE)
    assert camera.world and camera.lens
    points = camera.world.place + np.random.default_rng(0).uniform((-1, -0.6, 2), (1, 0.6, 4), (50, 3)) @ ROTATION
    expected = cv2.projectPoints(points, ROTATION, TRANSLATION, K, np.array(DISTORTION))[0][:, 0]
    np.testing.assert_allclose(filmed(camera.lens, _seen(camera, camera.world, points)), expected + 0.5, atol=1e-9)


def test_a_picture_is_straightened_as_opencv_does(tmp_path: Path):
    """OpenCV counts from the middle of the first pixel, and tcfit from the image's corner."""
    camera = read_camera(CameraFile(path=files.opencv(tmp_path / "camera.yml")), SIZE)
    assert camera.lens
    picture = np.random.default_rng(0).integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    expected = cv2.undistort(picture, K, np.array(DISTORTION))
    inside = (slice(100, -100), slice(100, -100))
    off = np.abs(Straightener(camera.lens, SIZE)(picture)[inside].astype(int) - expected[inside])
    assert off.mean() < 0.1, "half a pixel off it is 3.3"


def _seen(camera: Camera, world: World, points: np.ndarray) -> np.ndarray:
    """Pixels of the straightened picture."""
    x, y, z = ((points - world.place) @ world.from_camera).T
    return np.stack([x / z, y / z], 1) * camera.focal + camera.center


def test_the_files_of_a_camera(tmp_path: Path):
    model = files.colmap(tmp_path / "model")
    (model / "points3D.txt").write_text("# many\n")
    both = [model / "cameras.txt", model / "images.txt"]
    assert camera_files(model) == camera_files(both[0]) == both
    assert camera_files(files.own(tmp_path / "camera.npz")) == [tmp_path / "camera.npz"]


def _lens_profile(path: Path, **params: object) -> Path:
    """In the form of Gyroflow's lens profiles."""
    matrix = [[1796.3, 0.0, 1919.4], [0.0, 1797.2, 1063.2], [0.0, 0.0, 1.0]]
    path.write_text(
        json.dumps(
            {
                "camera_brand": "Brand",
                "calib_dimension": {"w": 3840, "h": 2160},
                "output_dimension": {"w": 3840, "h": 2160},
                "fps": 119.88,
                "fisheye_params": {"camera_matrix": matrix, "distortion_coeffs": [0.0342, 0.0677, -0.0741, 0.0299]},
            }
            | params
        )
    )
    return path


def test_a_lens_profile_of_gyroflow_is_a_fisheye(tmp_path: Path):
    file = CameraFile(path=_lens_profile(tmp_path / "profile.json"))
    with pytest.raises(InputError, match=r"camera 'fisheye_params' has a lens of another model \(fisheye\)"):
        read_camera(file, (1920, 1080))
    file = CameraFile(path=_lens_profile(tmp_path / "profile.json", distortion_model="opencv_fisheye"))
    with pytest.raises(InputError, match=r"another model \(opencv_fisheye\)"):
        read_camera(file, (1920, 1080))


@pytest.mark.parametrize("outside", [{"calib_dimension": {"w": 3840, "h": 2160}}, {"image_size": [3840, 2160]}])
def test_a_size_beside_the_camera_s_table_counts(tmp_path: Path, outside: dict[str, object]):
    matrix = [[1800.0, 0.0, 1919.5], [0.0, 1800.0, 1079.5], [0.0, 0.0, 1.0]]
    (tmp_path / "camera.json").write_text(json.dumps(outside | {"params": {"camera_matrix": matrix}}))
    camera = read_camera(CameraFile(path=tmp_path / "camera.json"), (1920, 1080))
    assert camera.focal == (900.0, 900.0) and camera.center == (960.0, 540.0)
