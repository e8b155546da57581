""".pose files: what pose-format's own library makes of ours and we of its; MediaPipe's points; round trips."""

import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from fitting_core.io import read_detections
from fitting_core.io.keypoints.pose_binary import Component, PoseFile, read_pose_file, write_pose_file
from fitting_core.io.keypoints.pose_file import COMPONENTS, write_pose
from fitting_core.keypoints import COUNT, INDEX, LEFT_HAND, RIGHT_HAND, Keypoints
from tests.fitting_core.io.keypoints.keypoint_samples import SIZE, as_points, by_frame, keypoints

MEDIAPIPE_BODY = (
    "NOSE LEFT_EYE_INNER LEFT_EYE LEFT_EYE_OUTER RIGHT_EYE_INNER RIGHT_EYE RIGHT_EYE_OUTER LEFT_EAR RIGHT_EAR "
    "MOUTH_LEFT MOUTH_RIGHT LEFT_SHOULDER RIGHT_SHOULDER LEFT_ELBOW RIGHT_ELBOW LEFT_WRIST RIGHT_WRIST LEFT_PINKY "
    "RIGHT_PINKY "
    "LEFT_INDEX RIGHT_INDEX LEFT_THUMB RIGHT_THUMB LEFT_HIP RIGHT_HIP LEFT_KNEE RIGHT_KNEE LEFT_ANKLE RIGHT_ANKLE "
    "LEFT_HEEL RIGHT_HEEL LEFT_FOOT_INDEX RIGHT_FOOT_INDEX"
).split()
MEDIAPIPE_HAND = list(COMPONENTS["LEFT_HAND_LANDMARKS"])


def holistic(folder: Path, *, face: list[int] | None = None, frames: int = 3) -> tuple[Path, PoseFile]:
    """A file of MediaPipe Holistic's components with random points, the second frame without its left hand."""
    names = [str(k) for k in (face if face is not None else range(478))]
    groups = {
        "POSE_LANDMARKS": MEDIAPIPE_BODY,
        "FACE_LANDMARKS": names,
        "LEFT_HAND_LANDMARKS": MEDIAPIPE_HAND,
        "RIGHT_HAND_LANDMARKS": MEDIAPIPE_HAND,
        "POSE_WORLD_LANDMARKS": MEDIAPIPE_BODY,
    }
    components = tuple(Component(name=n, points=tuple(points), format="XYZC") for n, points in groups.items())
    rng, count = np.random.default_rng(5), sum(len(c.points) for c in components)
    data, confidence = rng.uniform(20, 400, (frames, 1, count, 3)), rng.uniform(0.3, 1, (frames, 1, count))
    hand = slice(33 + len(names), 33 + len(names) + 21)
    data[1, :, hand], confidence[1, :, hand] = np.nan, 0
    pose = PoseFile(components=components, size=(640, 480), frame_rate=12.5, data=data, confidence=confidence)
    write_pose_file(folder / "clip.pose", pose)
    return folder / "clip.pose", pose


@settings(max_examples=20)
@given(keypoints())
def test_what_was_written_reads_back(clip: Keypoints):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "walk.pose"
        write_pose(file, clip, size=SIZE, frame_rate=29.97, first_frame=2)
        found = read_detections(file)
    points = by_frame(found.frames)
    assert not points[:2].any() and len(points) == len(clip) + 2
    difference = np.abs(points[2:] - as_points(clip))
    assert difference[..., :2].max() < 0.01 and difference[..., 2].max() < 1e-6
    assert found.size == SIZE and found.frame_rate == pytest.approx(29.97, abs=1e-5) and found.notes == ()


def test_the_number_of_an_image_that_is_named_by_its_date_counts_no_frames(tmp_path: Path):
    keypoints = Keypoints(xy=np.ones((2, COUNT, 2)), confidence=np.ones((2, COUNT)))
    write_pose(tmp_path / "photo.pose", keypoints, size=SIZE, frame_rate=30.0, first_frame=20240131123456)
    assert len(read_detections(tmp_path / "photo.pose").frames) == 2


def test_mediapipe_holistic(tmp_path: Path):
    file, pose = holistic(tmp_path)
    found = read_detections(file)
    assert (found.size, found.frame_rate, len(found)) == ((640, 480), 12.5, 3)
    person, data = found.frames[0][0], pose.data[0, 0]
    expected = {
        "nose": 0, "left_shoulder": 11, "right_shoulder": 12, "right_wrist": 16, "left_heel": 29, "right_big_toe": 32,
        "left_thumb1": 33 + 478 + 1, "right_pinky4": 33 + 478 + 21 + 20, "face_right_pupil": 33 + 468,
        "face_nose_bridge3": 33 + 4, "face_contour8": 33 + 152, "face_left_eyelid3": 33 + 263,
    }  # fmt: skip
    for name, k in expected.items():
        assert np.allclose(person[INDEX[name], :2], data[k, :2], atol=1e-4), name
    assert np.allclose(person[INDEX["neck"], :2], data[[11, 12], :2].mean(0), atol=1e-4)
    assert person[INDEX["neck"], 2] == pytest.approx(pose.confidence[0, 0, [11, 12]].min(), abs=1e-6)
    assert not found.frames[1][0][LEFT_HAND].any() and found.frames[1][0][RIGHT_HAND, 2].all()
    assert found.notes == (
        "clip.pose has the points of MediaPipe Holistic; it lacks 2 of our 137: left_small_toe, right_small_toe.",
    )


def test_version_0_1_takes_its_number_of_frames_from_the_files_size(tmp_path: Path):
    """Its counts are 16 bits: a clip of 70000 frames says 4464."""
    file, pose = holistic(tmp_path, face=[])
    content = file.read_bytes()
    body = content.index(struct.pack("<fIH", 12.5, 3, 1))
    old = struct.pack("<f", 0.1) + content[4:body] + struct.pack("<HHH", 12, 4464, 1) + content[body + 10 :]
    file.write_bytes(old)
    found = read_pose_file(file)
    assert found.frame_rate == 12 and np.allclose(found.data, pose.data, atol=1e-4, equal_nan=True)


def test_the_formats_own_library_reads_what_was_written_and_the_other_way_round(tmp_path: Path):
    library = pytest.importorskip("pose_format", reason="pip install --no-deps pose-format")
    rng = np.random.default_rng(0)
    clip = Keypoints(xy=rng.uniform(0, 500, (4, 137, 2)), confidence=rng.uniform(0.1, 1, (4, 137)))
    write_pose(tmp_path / "ours.pose", clip, size=SIZE, frame_rate=24)
    theirs = library.Pose.read((tmp_path / "ours.pose").read_bytes())
    assert [c.name for c in theirs.header.components] == list(COMPONENTS)[:4]
    assert theirs.body.fps == 24 and theirs.header.dimensions.width == SIZE[0]
    wrist = theirs.header.get_point_index("pose_keypoints_2d", "RWrist")
    assert np.allclose(theirs.body.data[:, 0, wrist], clip.xy[:, INDEX["right_wrist"]], atol=1e-3)
    with (tmp_path / "theirs.pose").open("wb") as file:
        theirs.write(file)
    found = by_frame(read_detections(tmp_path / "theirs.pose").frames)
    assert np.allclose(found, as_points(clip), atol=1e-3)
