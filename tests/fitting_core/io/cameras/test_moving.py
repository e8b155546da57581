"""Cameras that move: the same path in every form, its frames found, and read with a clip."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.camera import Camera, is_possible, path_of
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.frame_alignment import Timeline
from fitting_core.io.camera_arrays import camera_arrays, camera_from
from fitting_core.io.cameras.moving import ClipFrames
from fitting_core.io.cameras.reading import CameraFile, read_camera
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.keypoints import Keypoints
from tcfit_app.project.project import Project
from tests.fitting_core.io.cameras import camera_files as files
from tests.fitting_core.io.cameras.camera_files import SIZE, TURNS, WAY
from tests.samples.clip_options import as_options
from tests.samples.walkers import CAMERA, RATE, walker

COUNT = len(TURNS)


def clip(
    count: int = COUNT, *, first: int = 0, part: slice | None = None, stems: tuple[str, ...] | None = None
) -> ClipFrames:
    timeline = Timeline(numbers=range(first, first + count), stems=stems)
    return ClipFrames(timeline=timeline, part=part or slice(0, count), frame_rate=20.0)


def read(path: Path, frames: ClipFrames, **more) -> Camera:
    return read_camera(CameraFile(path=path, **more), SIZE, frames)


def in_world(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Rotations from world to camera, and the camera's places in the world, frame by frame."""
    assert camera.path is not None and camera.world is not None
    turns = camera.path.to_still.swapaxes(1, 2) @ np.array(camera.world.rotation)
    return turns, camera.path.places @ np.array(camera.world.rotation) + camera.world.place


@pytest.mark.parametrize("form", [files.moving_npz, files.moving_colmap, files.transforms])
def test_the_same_path_in_every_form(tmp_path: Path, form):
    camera = read(form(tmp_path / "path.json" if form is files.transforms else tmp_path / "path.npz"), clip())
    turns, places = in_world(camera)
    np.testing.assert_allclose(turns, TURNS, atol=1e-9)
    np.testing.assert_allclose(places, WAY, atol=1e-9)
    assert camera.path is not None and len(camera.path) == COUNT
    np.testing.assert_allclose(camera.path.rotation[0], np.eye(3), atol=1e-12)
    assert any("moves" in note for note in camera.notes)
    scaleless = form is not files.moving_npz
    assert any("without scale" in note for note in camera.notes) == scaleless
    assert is_possible(camera) and camera_from(camera_arrays(camera)) == camera


def test_the_unit_scales_the_way(tmp_path: Path):
    camera = read(files.transforms(tmp_path / "t.json"), clip(), unit=0.5, up="z")
    np.testing.assert_allclose(in_world(camera)[1], 0.5 * WAY, atol=1e-9)
    assert not any("scale" in note for note in camera.notes) and camera.world is not None and camera.world.up == "z"


def test_a_path_that_does_not_move_is_a_camera_that_stands(tmp_path: Path):
    same = np.repeat(TURNS[:1], COUNT, 0), np.repeat(WAY[:1], COUNT, 0)
    camera = read(files.moving_npz(tmp_path / "c.npz", *same), clip())
    assert camera.path is None and camera.world is not None
    np.testing.assert_allclose(camera.world.place, WAY[0], atol=1e-9)


@pytest.mark.parametrize(
    ("names", "frames", "expected"),
    [
        ([f"frame_{i + 1:04}.png" for i in range(COUNT)], clip(), range(COUNT)),  # as ffmpeg counts them
        ([f"images/{i}.png" for i in range(COUNT)], clip(), range(COUNT)),
        ([f"x{i}.jpg" for i in range(100, 100 + COUNT)], clip(first=100), range(COUNT)),
        (["b.png", "a.png", "c.png"], clip(3, stems=("a", "b", "c")), (1, 0, 2)),
        ([f"f{i}.png" for i in range(COUNT)], clip(part=slice(2, 5)), range(2, 5)),
        ([f"f{i}.png" for i in range(COUNT)], clip(3, stems=("shot3", "shot4", "shot5")), range(3, 6)),
        ([f"f{i}.png" for i in range(COUNT)], clip(COUNT - 2), range(COUNT - 2)),  # a video that is cut off
    ],
)
def test_frames_are_found_by_their_images_names(tmp_path: Path, names, frames, expected):
    turns, way = TURNS[: len(names)], WAY[: len(names)]
    path = files.transforms(tmp_path / "t.json", turns, way, names=names)
    camera = read(path, frames)
    np.testing.assert_allclose(in_world(camera)[1], WAY[list(expected)], atol=1e-9)


def test_intrinsics_of_a_transforms_file(tmp_path: Path):
    path = files.transforms(tmp_path / "t.json")
    table = json.loads(path.read_text())
    found = read(path, clip())
    assert found.focal == (table["fl_x"], table["fl_y"]) and found.lens is not None
    assert found.lens.distortion[:2] == (table["k1"], table["k2"])
    for name in ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2"):
        del table[name]
    path.write_text(json.dumps(table | {"camera_angle_x": 2 * np.arctan(0.5)}))
    found = read(path, clip())
    assert found.focal == pytest.approx((SIZE[0], SIZE[0])) and found.center == (SIZE[0] / 2, SIZE[1] / 2)
    assert found.lens is None and replace(found, path=None) != found


@pytest.mark.parametrize(("first", "last"), [(None, None), (2, 5)])
def test_a_clip_has_the_path_of_its_frames(tmp_path: Path, first: int | None, last: int | None):
    keypoints = Keypoints(xy=np.full((COUNT, 137, 2), 300.0), confidence=np.full((COUNT, 137), 0.9))
    write_openpose(tmp_path / "keypoints", keypoints, name="shot")
    path = files.transforms(tmp_path / "transforms.json", names=[f"{i:04}.png" for i in range(COUNT)])
    made = read_clip(
        None,
        tmp_path / "keypoints",
        clip=ClipOptions(image_size=SIZE, first_frame=first, last_frame=last),
        camera=CameraOptions(camera=path),
    )
    part = slice(first or 0, COUNT if last is None else last + 1)
    np.testing.assert_allclose(in_world(made.camera)[1], WAY[part], atol=1e-9)
    assert made.camera.path is not None and len(made.camera.path) == len(made)
    assert any("without scale" in note and "camera_unit" in note for note in made.notes)
    with Project.create(tmp_path / "p.tcfit", made):
        pass
    with Project.open(tmp_path / "p.tcfit", read_only=True) as project:
        assert project.clip.camera == made.camera


def test_a_unit_that_nobody_says_is_estimated_with_the_keypoints(tmp_path: Path):
    made, unit = walker(), 0.2
    aside = 0.8 * np.sin(np.linspace(0, 4 * np.pi, len(made.xy)))
    seen = replace(CAMERA, path=path_of(np.tile(np.eye(3), (len(aside), 1, 1)), -aside[:, None] * [1.0, 0, 0]))
    points = seen.from_still(made.points)
    xy = np.zeros((len(aside), 137, 2))
    xy[:, :25] = points[..., :2] / points[..., 2:] * CAMERA.focal + CAMERA.center
    confidence = np.pad(made.confidence, ((0, 0), (0, 112)))
    write_openpose(tmp_path / "keypoints", Keypoints(xy=xy, confidence=confidence), name="shot")
    matrices = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (len(aside), 1, 1))
    matrices[:, 0, 3] = aside / unit
    frames = [{"file_path": f"{i:04}.png", "transform_matrix": matrix.tolist()} for i, matrix in enumerate(matrices)]
    table = {"fl_x": CAMERA.focal[0], "fl_y": CAMERA.focal[1], "w": 1280, "h": 720, "frames": frames}
    (tmp_path / "t.json").write_text(json.dumps(table))
    options = {"camera": tmp_path / "t.json", "image_size": CAMERA.size, "frame_rate": RATE}
    clip = read_clip(None, tmp_path / "keypoints", **as_options(options))
    assert clip.camera.path is not None and clip.camera.world is not None
    reach = np.ptp(clip.camera.path.places[:, 0])
    assert reach == pytest.approx(np.ptp(aside), rel=0.25)
    assert any(f"by feet that stand, one unit is {unit * reach / np.ptp(aside):.3g} m" in note for note in clip.notes)
    told = read_clip(None, tmp_path / "keypoints", **as_options(options | {"camera_unit": 0.5}))
    assert told.camera.path is not None and np.ptp(told.camera.path.places[:, 0]) == pytest.approx(
        np.ptp(aside) * 0.5 / unit
    )
    assert not any("without scale" in note for note in told.notes)
