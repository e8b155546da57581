"""Paths that are no plain files: told apart without being opened, by every reader."""

import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from build_assets.free_body.hand.recordings import read_recording
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body, register
from fitting_core.clips.reading import read_footage
from fitting_core.config.toml import read_config
from fitting_core.detect.onnx_model import OnnxModel, consumers
from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.io import read_detections, read_motion
from fitting_core.io.keypoints.coco_wholebody import read_coco_wholebody
from fitting_core.io.keypoints.openpose import read_openpose
from fitting_core.io.keypoints.pose_file import read_pose
from fitting_core.io.result_files import read_fit
from fitting_core.io.truth import read_truth
from fitting_core.measure.references.files import read_reference
from fitting_core.priors.files.registry import read_prior
from fitting_core.video.frames import FrameSource
from fitting_core.world_camera import read_world_camera
from tests.samples.special_files import SPECIAL, endless, pipe

READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "any keypoints": ("k.json", read_detections),
    "a .pose file, by its name": ("k.pose", read_detections),
    "a .pose file": ("k.pose", read_pose),
    "COCO": ("k.json", read_coco_wholebody),
    "OpenPose": ("k_0_keypoints.json", read_openpose),
    "OpenPose's folder": ("k_0_keypoints.json", lambda path: read_openpose(path.parent)),
    "a body": ("SMPLX_NEUTRAL.npz", load_body),
    "a pickled body": ("SMPLX_NEUTRAL.pkl", load_body),
    "a download": ("models.zip", register),
    "a tar": ("models.tar.gz", register),
    "a folder of models": ("SMPLX_NEUTRAL.npz", lambda path: register(path.parent)),
    "a result": ("fit.npz", read_fit),
    "a motion": ("motion.npz", read_motion),
    "SMPLify-X's": ("000.pkl", read_motion),
    "a reference": ("reference.npz", read_reference),
    "a reference as text": ("reference.trc", read_reference),
    "a truth": ("truth.npz", read_truth),
    "a world's camera": ("camera.npz", read_world_camera),
    "a prior": ("prior.npz", read_prior),
    "a video": ("walk.mp4", read_footage),
    "an image": ("walk.png", FrameSource),
    "a folder of images": ("walk_0.png", lambda path: FrameSource(path.parent)),
    "a model": ("model.onnx", OnnxModel),
    "a model's graph": ("model.onnx", lambda path: consumers(path, "x")),
    "a configuration": ("mine.toml", read_config),
    "a body that is to be found": ("SMPLX_NEUTRAL.npz", lambda path: find_body(search=path)),
    "a recording of a hand": ("hand.npz", read_recording),
}


@pytest.fixture(scope="module")
def listening() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as server:
        yield server


@pytest.mark.parametrize("make", SPECIAL)
@pytest.mark.parametrize("name, read", READERS.values(), ids=READERS)
def test_what_is_no_plain_file_is_refused_at_once(
    tmp_path: Path, name: str, read: Callable[[Path], Any], make: Callable[[Path], None]
):
    """Opened, a pipe would wait for ever, and /dev/zero fill the memory."""
    (tmp_path / "in").mkdir()
    path = tmp_path / "in" / name
    make(path)
    with pytest.raises(InputError) as error:
        read(path)
    assert str(path.parent) in str(error.value)


KINDS = {
    "folder": (Path.mkdir, "is a folder, expected a file"),
    "pipe": (pipe, "is a named pipe, expected a file"),
    "device": (endless, "is a device, expected a file"),
}


@pytest.mark.parametrize("make, says", KINDS.values(), ids=KINDS)
def test_the_kind_is_told(tmp_path: Path, make: Callable[[Path], None], says: str):
    path = tmp_path / "here"
    make(path)
    with pytest.raises(InputError, match=f"here: {says}"):
        regular_file(path)


@pytest.mark.skipif(not Path("/proc/kmsg").exists(), reason="this system has no such files")
def test_a_file_of_the_kernel():
    """It says that it is a plain file without content, and whoever reads it waits for ever."""
    with pytest.raises(InputError, match="/proc/kmsg: is a file of the kernel, expected a file"):
        regular_file(Path("/proc/kmsg"))


def test_a_socket(tmp_path: Path, listening: socket.socket, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)  # a socket's name has at most 108 bytes
    listening.bind("here")
    with pytest.raises(InputError, match="here: is a socket, expected a file"):
        regular_file(tmp_path / "here")


def test_the_size(tmp_path: Path):
    path = tmp_path / "large.bin"
    with path.open("wb") as file:
        file.truncate(5 * 2**30)
    with pytest.raises(InputError, match=r"large.bin: has 5\.0 GB, expected at most 4\.0 GB"):
        regular_file(path)
    assert regular_file(path, most=None) == path
    (tmp_path / "link").symlink_to(path)
    assert regular_file(tmp_path / "link", most=None) == tmp_path / "link"


def test_nothing_there_and_no_path_at_all(tmp_path: Path):
    with pytest.raises(FileNotFoundError):
        regular_file(tmp_path / "missing")
    with pytest.raises(InputError, match="is not a path, expected that of a file"):
        regular_file(Path("a\0b"))
