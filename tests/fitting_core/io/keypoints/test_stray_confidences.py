"""Confidences a hair outside 0 to 1, as real detectors write them, in every format: taken as 0 or 1, and noted."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core.clips.options import ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.io.keypoints.pose_binary import PoseFile, write_pose_file
from fitting_core.io.keypoints.pose_file import openpose_components
from fitting_core.keypoints import COUNT, INDEX

NOSE, WRIST = INDEX["nose"], INDEX["right_wrist"]
NAMES = {"openpose": "walk_0_keypoints.json", "coco": "walk.json", "pose": "walk.pose"}


def openpose(path: Path, points: np.ndarray) -> None:
    path.write_text(json.dumps({"people": [{"pose_keypoints_2d": points[:25].ravel().tolist()}]}))


def coco(path: Path, points: np.ndarray) -> None:
    whole = np.zeros((133, 3))
    whole[[0, 5, 6, 10, 11, 12]] = points[[NOSE, 5, 2, WRIST, 12, 9]]
    path.write_text(json.dumps([{"image_id": 0, "keypoints": whole.tolist()}]))


def pose(path: Path, points: np.ndarray) -> None:
    components, places = openpose_components()
    taken = points[None, None, list(places)]
    write_pose_file(
        path,
        PoseFile(
            components=components, size=(640, 480), frame_rate=25.0, data=taken[..., :2], confidence=taken[..., 2]
        ),
    )


@pytest.fixture(params=[openpose, coco, pose], ids=lambda write: write.__name__)
def written(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., Path]:
    """written(nose, wrist): one person whose nose and right wrist have these confidences, in each of the formats."""

    def write(nose: float, wrist: float) -> Path:
        points = np.full((COUNT, 3), 0.5)
        points[:, :2] = np.arange(2 * COUNT).reshape(-1, 2)
        points[NOSE, 2], points[WRIST, 2] = nose, wrist
        path = tmp_path / NAMES[request.param.__name__]
        request.param(path, points)
        return path

    return write


def test_a_hair_outside_counts_as_0_or_1_and_is_noted(written: Callable[..., Path]):
    path = written(-2e-6, 1.0008)
    detections = read_detections(path)
    person = detections.frames[0][0]
    assert person[NOSE].tolist() == [0, 0, 0] and person[WRIST, 2] == 1 and person[WRIST, 0] > 0
    [note] = [note for note in detections.notes if "outside 0 to 1" in note]
    assert note == f"{path.name} has confidences outside 0 to 1 (2 from -2e-06 to 1.001); they count as 0 or 1."
    assert note in read_clip(None, path, clip=ClipOptions(image_size=(640, 480))).notes


def test_the_edge_of_what_is_taken(written: Callable[..., Path]):
    assert not read_detections(written(-0.00099, 0.5)).frames[0][0, NOSE].any()
    with pytest.raises(InputError, match=r"nose.*found confidence -0\.0011; expected 0 \(not detected\) to 1"):
        read_detections(written(-0.0011, 0.5))
