"""Uploads: archives as people make them, and those that attackers make."""

import io
import json
import zipfile
from pathlib import Path

import pytest

from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.io.keypoints.openpose import read_openpose
from tcfit_app.imports import keypoint_jobs as uploads
from tcfit_app.imports.keypoint_jobs import received

FRAME = json.dumps({"people": [{"pose_keypoints_2d": [1.0, 2.0, 0.5] * 25}]}).encode()


def packed(*entries: tuple[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in entries:
            archive.writestr(name, content)
    return buffer.getvalue()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "inner").mkdir()
    return tmp_path / "inner"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_folder_of_frames(folder: Path):
    entries = [(f"kp/walk_{n:012}_keypoints.json", FRAME) for n in (5, 6, 9)]
    content = packed(("kp/", b""), *entries, ("__MACOSX/kp/._x.json", b"x"), ("kp/.DS_Store", b"x"))
    assert received("kp.zip", content, folder) == folder
    assert names(folder) == [f"upload_{n:012}_keypoints.json" for n in (5, 6, 9)]
    assert read_openpose(folder).numbers == (5, 6, 9)


def test_what_lies_beside_openpose_s_files_is_no_frame(folder: Path):
    """As in tcfit's own export, zipped."""
    entries = [(f"walk_{n:012}_keypoints.json", FRAME) for n in (5, 6)]
    received("kp.zip", packed(("clip.json", b"{}"), *entries), folder)
    assert read_openpose(folder).numbers == (5, 6)


def test_predictions_of_mmpose_for_images(folder: Path):
    person = {"keypoints": [[1.0, 2.0]] * 133, "keypoint_scores": [0.5] * 133}
    entries = [(f"p/frame_{n}.png.json", json.dumps([person] * n).encode()) for n in (0, 1, 2)]
    received("predictions.zip", packed(*entries), folder)
    found = read_detections(folder)
    assert [len(people) for people in found.frames] == [0, 1, 2] and found.numbers == (0, 1, 2)


def test_frames_without_numbers_come_in_natural_order(folder: Path):
    received("kp.zip", packed(*((f"{n}_keypoints.json", n.encode()) for n in ("walk", "10", "2", "1"))), folder)
    assert [(folder / name).read_bytes() for name in names(folder)] == [b"1", b"2", b"10", b"walk"]


@pytest.mark.parametrize("name", ["walk_keypoints.json", "coco.json", "x.pose", "x.POSE", "../../x.json", "a\0b.json"])
def test_single_files_get_names_of_ours(folder: Path, name: str):
    path = received(name, FRAME, folder)
    assert path.parent == folder and path.name in ("upload_0_keypoints.json", "upload.json", "upload.pose")
    assert path.read_bytes() == FRAME and names(folder.parent) == ["inner"]


def test_a_packed_single_file(folder: Path):
    assert received("a.zip", packed(("x/video.pose", b"pose")), folder).name == "upload.pose"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.txt", b"hello", "and its name is not a keypoint file's"),
        ("a.json", b"", "0 bytes"),
        ("a.zip", b"", "0 bytes"),
        ("a.zip", b"no archive", "and its name is not a keypoint file's"),
        ("a.zip", packed(), "holds no file"),
        ("a.zip", packed(("a_keypoints.json", FRAME), ("run.py", b"x")), "other files, such as run.py"),
        ("a.zip", packed(("../a_0_keypoints.json", FRAME)), "points outside of it"),
        ("a.zip", packed(("/etc/a_0_keypoints.json", FRAME)), "points outside of it"),
        ("a.zip", packed(("x\\..\\a_0_keypoints.json", FRAME)), "points outside of it"),
        ("a.zip", packed(("C:\\a_0_keypoints.json", FRAME)), "points outside of it"),
        ("a.zip", packed(("a_0_keypoints.json", FRAME), ("b_0_keypoints.json", FRAME)), "several clips"),
        ("a.zip", packed(("b.zip", packed(("a_0_keypoints.json", FRAME)))), "other files, such as b.zip"),
        ("<b>\x07.exe", b"x", "<b>?.exe has 1 bytes"),
    ],
    ids=range(13),  # archives hold the time at which they were made, and processes must name their tests alike
)
def test_what_is_refused(folder: Path, name: str, content: bytes, words: str):
    with pytest.raises(InputError) as caught:
        received(name, content, folder)
    assert words in str(caught.value)
    assert names(folder) == [] and names(folder.parent) == ["inner"]


def test_bombs_are_refused(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(uploads, "MOST_BYTES", 1 << 20)
    monkeypatch.setattr(uploads, "MOST_FILES", 10)
    large = packed(*((f"a_{n}_keypoints.json", bytes(300_000)) for n in range(4)))
    assert len(large) < 5000
    many = packed(*((f"a_{n}_keypoints.json", FRAME) for n in range(11)))
    for content in (large, many):
        with pytest.raises(InputError, match=r"expected 10 files and 1 MB at most"):
            received("a.zip", content, folder)
    with pytest.raises(InputError, match="expected 1 MB at most"):
        received("a.json", bytes(2 << 20), folder)
    assert names(folder) == []


def test_an_archive_that_lies_about_its_sizes(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """The size in the directory says 10 bytes: no more than those are unpacked."""
    monkeypatch.setattr(uploads, "MOST_BYTES", 1 << 20)
    content = bytearray(packed(("a_0_keypoints.json", bytes(8 << 20))))
    place = content.rindex(b"PK\x01\x02")
    content[place + 24 : place + 28] = (10).to_bytes(4, "little")
    with pytest.raises(InputError):
        received("a.zip", bytes(content), folder)
    assert sum(path.stat().st_size for path in folder.iterdir()) <= 10


def test_damaged_and_encrypted_archives(folder: Path):
    whole = packed(("a_0_keypoints.json", FRAME * 50), compression=zipfile.ZIP_STORED)
    damaged = whole[:200] + b"?" + whole[201:]
    with pytest.raises(InputError, match="is damaged or was cut off"):
        received("a.zip", damaged, folder)
    locked = bytearray(whole)
    locked[locked.rindex(b"PK\x01\x02") + 8] |= 1
    with pytest.raises(InputError, match="cannot be unpacked"):
        received("a.zip", bytes(locked), folder)
