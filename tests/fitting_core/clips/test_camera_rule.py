"""Where the focal length of a clip comes from when nobody gives one."""

from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from fitting_core.camera import DEFAULT_FOCAL, Camera, FocalFrom, focal_from_35mm
from fitting_core.clips.options import CameraOptions
from fitting_core.clips.reading import read_footage, told_by_files

CAMERA = Camera(
    focal=(400.0, 400.0),
    center=(160.0, 120.0),
    size=(320, 240),
    focal_from=FocalFrom.DIAGONAL,
    source=DEFAULT_FOCAL,
)


def photograph(path: Path, millimetres: int | None) -> None:
    """A picture of 320 x 240 pixels, with Exif data."""
    exif = Image.Exif()
    if millimetres is not None:
        exif.get_ifd(0x8769)[0xA405] = millimetres
    Image.new("RGB", (320, 240)).save(path, exif=exif)


def test_photographs_tell_it(tmp_path: Path):
    for name in ("1.jpg", "2.jpg"):
        photograph(tmp_path / name, 28)
    camera = read_footage(tmp_path, camera=CameraOptions(focal_length="auto")).camera
    assert camera.focal[0] == pytest.approx(focal_from_35mm(28, (320, 240))) and camera.calibrated
    assert camera.source == "35 mm equivalent of 28 mm, stated by the images"
    assert read_footage(tmp_path).camera == camera, "the default, as of the commands"
    assert read_footage(tmp_path, camera=CameraOptions(focal_length="diagonal")).camera == CAMERA
    single = told_by_files(CAMERA, tmp_path / "1.jpg")
    assert single is not None and single.focal == camera.focal


@pytest.mark.parametrize("told", [(28, 50), (28, None), (None, None), (60_000, 60_000)])
def test_photographs_that_disagree_or_are_silent_tell_nothing(tmp_path: Path, told: tuple[int | None, int | None]):
    for name, millimetres in zip(("1.jpg", "2.jpg"), told, strict=True):
        photograph(tmp_path / name, millimetres)
    assert told_by_files(CAMERA, tmp_path) is None
    assert read_footage(tmp_path, camera=CameraOptions(focal_length="auto")).camera == CAMERA


def movie(path: Path, told: str | None) -> Path:
    """Three black frames, as a phone tags them."""
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"} if path.suffix == ".mov" else {}) as file:
        if told is not None:
            file.metadata["com.apple.quicktime.camera.focal_length.35mm_equivalent"] = told
        stream = file.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for _ in range(3):
            file.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((240, 320, 3), np.uint8), format="rgb24")))
        file.mux(stream.encode())
    return path


@pytest.mark.parametrize("name", ["phone.mov", "converted.mkv"])
def test_a_phones_video_tells_it(tmp_path: Path, name: str):
    camera = read_footage(movie(tmp_path / name, "26.5")).camera
    assert camera.focal[0] == pytest.approx(focal_from_35mm(26.5, (320, 240))) and camera.calibrated
    assert camera.source == "35 mm equivalent of 26.5 mm, stated by the video"


@pytest.mark.parametrize("told", [None, "0", "nan", "wide", "60000"])
def test_a_video_that_says_nothing_of_use_tells_nothing(tmp_path: Path, told: str | None):
    assert read_footage(movie(tmp_path / "phone.mov", told)).camera == CAMERA
