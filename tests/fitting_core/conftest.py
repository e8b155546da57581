"""A walking stick figure as detections, and OpenPose files of it."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core.keypoints import BODY_25, COUNT

_STANDING = {
    "nose": (0, -3.2), "neck": (0, -2.6), "mid_hip": (0, 0),
    "right_shoulder": (-0.8, -2.6), "right_elbow": (-1.0, -1.5), "right_wrist": (-1.1, -0.4),
    "left_shoulder": (0.8, -2.6), "left_elbow": (1.0, -1.5), "left_wrist": (1.1, -0.4),
    "right_hip": (-0.4, 0), "right_knee": (-0.4, 2), "right_ankle": (-0.4, 4),
    "left_hip": (0.4, 0), "left_knee": (0.4, 2), "left_ankle": (0.4, 4),
    "right_eye": (-0.1, -3.3), "left_eye": (0.1, -3.3), "right_ear": (-0.3, -3.2), "left_ear": (0.3, -3.2),
    "left_big_toe": (0.5, 4.3), "left_small_toe": (0.7, 4.3), "left_heel": (0.4, 4.2),
    "right_big_toe": (-0.5, 4.3), "right_small_toe": (-0.7, 4.3), "right_heel": (-0.4, 4.2),
}  # fmt: skip


@pytest.fixture
def figure() -> Callable[..., np.ndarray]:
    """figure(x, y, height=200, confidence=0.8): a standing person's 137 keypoints (137, 3), hands and face missing."""

    def build(x: float, y: float, *, height: float = 200.0, confidence: float = 0.8) -> np.ndarray:
        points = np.zeros((COUNT, 3))
        for k, name in enumerate(BODY_25):
            points[k] = (*(np.array([x, y]) + np.array(_STANDING[name]) * height / 7.6), confidence)
        return points

    return build


@pytest.fixture
def write_people(tmp_path: Path) -> Callable[..., Path]:
    """write_people({"walk_0": [person, ...], ...}): a folder with one JSON file per stem; returns the folder.

    A person is an array (K, 3), written as its body list, or the object that goes into the file.
    """

    def write(frames: dict[str, object], folder: str = "keypoints") -> Path:
        path = tmp_path / folder
        path.mkdir(parents=True, exist_ok=True)
        for stem, people in frames.items():
            entries = [_entry(person) for person in people] if isinstance(people, list) else people
            (path / f"{stem}_keypoints.json").write_text(json.dumps({"version": 1.3, "people": entries}))
        return path

    return write


def _entry(person: object) -> object:
    if not isinstance(person, np.ndarray):
        return person
    return {"person_id": [-1], "pose_keypoints_2d": person[:25].ravel().tolist()}
