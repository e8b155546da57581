"""Uploaded keypoints, under names of ours."""

import json
from pathlib import Path

import pytest

from fitting_core.errors import InputError
from tcfit_app.imports.keypoint_jobs import received

FRAME = json.dumps({"people": [{"pose_keypoints_2d": [1.0, 2.0, 0.5] * 25}]}).encode()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "inner").mkdir()
    return tmp_path / "inner"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("walk_keypoints.json", "upload_0_keypoints.json"),
        ("coco.json", "upload.json"),
        ("x.POSE", "upload.pose"),
        ("../../x.json", "upload.json"),
        ("a\0b.json", "upload.json"),
    ],
)
def test_uploaded_file_gets_a_name_of_ours(folder: Path, name: str, expected: str):
    path = received(name, FRAME, folder)
    assert path == folder / expected and path.read_bytes() == FRAME
    assert [entry.name for entry in folder.parent.iterdir()] == ["inner"]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.txt", b"hello", "and its name is not a keypoint file's"),
        ("a.json", b"", "0 bytes"),
        ("a.zip", b"PK\x03\x04", "Give a folder of OpenPose's files by its path"),
        ("<b>\x07.exe", b"x", "<b>?.exe has 1 bytes"),
    ],
)
def test_what_is_refused(folder: Path, name: str, content: bytes, words: str):
    with pytest.raises(InputError) as caught:
        received(name, content, folder)
    assert words in str(caught.value) and not list(folder.iterdir())
