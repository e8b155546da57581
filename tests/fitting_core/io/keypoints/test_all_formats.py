"""What all formats of keypoints have in common: who detected them, and confidences a hair outside 0 to 1."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core.clips.options import ClipOptions
from fitting_core.clips.people import read_people
from fitting_core.clips.reading import read_clip, read_keypoints
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.io.keypoints.coco_wholebody import write_coco_wholebody
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.keypoints.pose_binary import PoseFile, write_pose_file
from fitting_core.io.keypoints.pose_file import openpose_components, write_pose
from fitting_core.keypoint_noise import DETECTOR_TITLES
from fitting_core.keypoints import COUNT, INDEX, Keypoints
from tests.fitting_core.io.keypoints.test_pose_file import holistic

SIZE = (640, 480)
FRAMES = 12
SEEN = Keypoints(
    xy=np.tile(np.random.default_rng(1).uniform(50, 400, (COUNT, 2)), (FRAMES, 1, 1)),
    confidence=np.full((FRAMES, COUNT), 0.8),
)


def openpose(folder: Path, said: object = None) -> Path:
    """Files that say something beside the people, if it is anything."""
    write_openpose(folder, SEEN, name="walk")
    for file in folder.iterdir():
        content = json.loads(file.read_text())
        file.write_text(json.dumps(content if said is None else {**content, "detector": said}))
    return folder


def coco(file: Path, detector: str = "") -> Path:
    write_coco_wholebody(file, SEEN, name="walk", size=SIZE, frame_rate=25.0, detector=detector)
    return file


def test_files_that_say_nothing_are_of_those_whose_format_it_is(tmp_path: Path):
    write_pose(tmp_path / "walk.pose", SEEN, size=SIZE, frame_rate=25.0)
    assert read_detections(openpose(tmp_path / "walk")).detector == "openpose"
    assert read_detections(coco(tmp_path / "walk.json")).detector == "coco-wholebody"
    assert read_detections(tmp_path / "walk.pose").detector == "openpose"
    assert read_detections(holistic(tmp_path)[0]).detector == "mediapipe"


@pytest.mark.parametrize("detector", DETECTOR_TITLES)
def test_what_was_written_says_who_it_was(tmp_path: Path, detector: str):
    write_openpose(tmp_path / "walk", SEEN, name="walk", detector=detector)
    found = read_detections(tmp_path / "walk")
    assert found.detector == detector and not found.notes
    found = read_detections(coco(tmp_path / "walk.json", detector))
    assert found.detector == detector and not found.notes


def test_a_name_is_read_in_any_case(tmp_path: Path):
    assert read_detections(openpose(tmp_path / "walk", " MediaPipe")).detector == "mediapipe"


@pytest.mark.parametrize("said", ["alphapose", "", 5, ["mediapipe"], {"name": "mediapipe"}])
def test_of_a_detector_that_nobody_measured_a_note_says_so(tmp_path: Path, said: object):
    found = read_detections(openpose(tmp_path / "walk", said))
    assert found.detector == "" and "weighted as if they were OpenPose's" in found.notes[0]
    assert repr(said) in found.notes[0] and "mediapipe" in found.notes[0]


def test_files_of_two_detectors_are_no_clip(tmp_path: Path):
    folder = openpose(tmp_path / "walk")
    last = max(folder.iterdir())
    last.write_text(json.dumps({**json.loads(last.read_text()), "detector": "mediapipe"}))
    with pytest.raises(InputError, match=r"Different detectors in one clip: .* 'openpose', .* 'mediapipe'"):
        read_detections(folder)


def test_a_clip_and_its_people_know_it(tmp_path: Path):
    folder = openpose(tmp_path / "walk", "mediapipe")
    clip = read_clip(None, folder, clip=ClipOptions(image_size=SIZE))
    assert clip.detector == "mediapipe" and clip.corrected(0, {"nose": (1.0, 2.0)}).detector == "mediapipe"
    assert [one.clip.detector for one in read_people(None, folder, clip=ClipOptions(image_size=SIZE))] == ["mediapipe"]
    assert read_keypoints(folder, clip)[2] == "mediapipe"


# --- confidences a hair outside 0 to 1, as real detectors write them ---


NOSE, WRIST = INDEX["nose"], INDEX["right_wrist"]
NAMES = {"openpose_file": "walk_0_keypoints.json", "coco_file": "walk.json", "pose_file": "walk.pose"}


def openpose_file(path: Path, points: np.ndarray) -> None:
    path.write_text(json.dumps({"people": [{"pose_keypoints_2d": points[:25].ravel().tolist()}]}))


def coco_file(path: Path, points: np.ndarray) -> None:
    whole = np.zeros((133, 3))
    whole[[0, 5, 6, 10, 11, 12]] = points[[NOSE, 5, 2, WRIST, 12, 9]]
    path.write_text(json.dumps([{"image_id": 0, "keypoints": whole.tolist()}]))


def pose_file(path: Path, points: np.ndarray) -> None:
    components, places = openpose_components()
    taken = points[None, None, list(places)]
    write_pose_file(
        path,
        PoseFile(
            components=components, size=(640, 480), frame_rate=25.0, data=taken[..., :2], confidence=taken[..., 2]
        ),
    )


@pytest.fixture(params=[openpose_file, coco_file, pose_file], ids=lambda write: write.__name__)
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
