"""Uploaded keypoints, under names of ours."""

import json
from dataclasses import replace

import pytest

from fitting_core.errors import InputError
from tcfit_app.imports.keypoint_jobs import ImportUpload
from tests.samples.project_samples import sample_clip

FRAME = json.dumps({"people": [{"pose_keypoints_2d": [100.0, 200.0, 0.5] * 25}]}).encode()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("walk_keypoints.json", "upload_0_keypoints.json"),
        ("other.json", "upload.json"),
        ("../../x.json", "upload.json"),
        ("a\0b.json", "upload.json"),
    ],
)
def test_uploaded_file_is_read_under_a_name_of_ours(name: str, expected: str):
    messages: list[str] = []
    found = ImportUpload(name=name, content=FRAME).run(
        replace(sample_clip(1), first_frame=0), lambda step, share: messages.append(step)
    )
    assert messages == [f"Reading {expected}"] and found.keypoints.xy[0, 0].tolist() == [100.0, 200.0]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.txt", b"hello", "and its name is not a keypoint file's"),
        ("a.json", b"", "0 bytes"),
        ("a.zip", b"PK\x03\x04", "Give a folder of OpenPose's files by its path"),
        ("<b>\x07.exe", b"x", "<b>?.exe has 1 bytes"),
        ("x.POSE", b"damaged", "x.POSE"),
    ],
)
def test_what_is_refused(name: str, content: bytes, words: str):
    with pytest.raises(InputError) as caught:
        ImportUpload(name=name, content=content).run(sample_clip(1), lambda step, share: None)
    assert words in str(caught.value)
