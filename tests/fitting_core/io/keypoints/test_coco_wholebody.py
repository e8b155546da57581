"""COCO-WholeBody JSON: its three forms, the points that it has and lacks, and what is read of what was written."""

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from fitting_core import wholebody as layout
from fitting_core.clips.options import ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.errors import InputError
from fitting_core.io import read_detections
from fitting_core.io.keypoints.coco_wholebody import write_coco_wholebody
from fitting_core.keypoints import FACE, INDEX, LEFT_HAND, RIGHT_HAND, Keypoints
from tests.fitting_core.io.keypoints.keypoint_samples import SIZE, as_points, by_frame, keypoints

LACKING = [INDEX[name] for name in (*layout.MEANS, *layout.ABSENT)]
KEPT = [k for k in range(137) if k not in LACKING]


def whole(seed: int = 0, score: float = 0.9) -> np.ndarray:
    """133 points of a person."""
    points = np.random.default_rng(seed).uniform(50, 400, (133, 3))
    points[:, 2] = score
    return points


def written(folder: Path, content: Any) -> Path:
    path = folder / "clip.json"
    path.write_text(json.dumps(content))
    return path


def test_the_layout_is_the_one_of_the_paper():
    """Figure 2 of Jin et al.: body 0-16, feet 17-22, face 23-90, left hand 91-111, right hand 112-132."""
    names = layout.WHOLEBODY_NAMES
    expected = {0: "nose", 1: "left_eye", 2: "right_eye", 5: "left_shoulder", 10: "right_wrist", 16: "right_ankle",
                17: "left_big_toe", 19: "left_heel", 20: "right_big_toe", 22: "right_heel"}  # fmt: skip
    assert {k: names[k] for k in expected} == expected
    assert layout.PLACES[23:91] == tuple(range(FACE.start, FACE.start + 68))
    assert layout.PLACES[91:112] == tuple(range(LEFT_HAND.start, LEFT_HAND.stop))
    assert layout.PLACES[112:] == tuple(range(RIGHT_HAND.start, RIGHT_HAND.stop))


@settings(max_examples=20)
@given(keypoints())
def test_what_was_written_reads_back(clip: Keypoints):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "clip.json"
        write_coco_wholebody(file, clip, name="walk", size=SIZE, frame_rate=29.97, first_frame=3)
        found = read_detections(file)
    points = as_points(clip)
    assert np.array_equal(by_frame(found.frames)[:, KEPT], points[:, KEPT])
    assert np.array_equal(by_frame(found.frames), layout.from_wholebody(layout.to_wholebody(points)))
    assert (found.size, found.frame_rate, found.numbers) == (SIZE, 29.97, tuple(range(3, 3 + len(clip))))


def test_the_file_is_what_cocos_tools_expect(tmp_path: Path):
    """Keys of the annotations of COCO-WholeBody 1.0, one by one."""
    clip = Keypoints(xy=np.full((2, 137, 2), 9.0), confidence=np.stack([np.ones(137), np.zeros(137)]))
    write_coco_wholebody(tmp_path / "a.json", clip, name="walk", size=SIZE, frame_rate=25)
    content = json.loads((tmp_path / "a.json").read_text())
    assert [image["file_name"] for image in content["images"]] == ["walk_000000000000.jpg", "walk_000000000001.jpg"]
    [person] = content["annotations"]
    lengths = {"keypoints": 51, "foot_kpts": 18, "face_kpts": 204, "lefthand_kpts": 63, "righthand_kpts": 63}
    assert {key: len(person[key]) for key in lengths} == lengths
    assert person["image_id"] == 0 and person["num_keypoints"] == 17 and person["face_valid"] is True


def test_results_of_several_people_with_gaps(tmp_path: Path):
    """As mmpose 0.x and DWPose write them: flat lists of 133 x 3, in no order, frames without anybody left out."""
    a, b, c = whole(1), whole(2), whole(3)
    results = [
        {"image_id": image, "category_id": 1, "keypoints": points.ravel().tolist(), "score": 0.8}
        for image, points in ((12, c), (7, a), (7, b))
    ]
    found = read_detections(written(tmp_path, results))
    assert found.numbers == (7, 12) and [len(people) for people in found.frames] == [2, 1]
    assert np.allclose(found.frames[0], layout.from_wholebody(np.stack([a, b])))
    clip = read_clip(None, tmp_path / "clip.json", clip=ClipOptions(person=1, image_size=(640, 480)))
    assert len(clip) == 6 and clip.first_frame == 7 and not clip.keypoints.confidence[1:].any()
    assert any("clip.json has 2 frames" in note and "4 frames have no keypoints" in note for note in clip.notes)


def test_predictions_of_mmpose(tmp_path: Path):
    """Pairs with scores beside them, frames counted from 1, and scores of SimCC heads above 1."""
    frames = [
        {"frame_id": k + 1, "instances": [{"keypoints": whole(k)[:, :2].tolist(), "keypoint_scores": [1.6] * 133}]}
        for k in range(3)
    ]
    found = read_detections(written(tmp_path, {"meta_info": {}, "instance_info": frames}))
    assert found.numbers == (0, 1, 2)
    assert np.allclose(found.frames[1][0], layout.from_wholebody(whole(1, score=1.0)))
    assert found.notes == ("The keypoints' scores reach 1.6; those above 1 count as confidence 1.",)


def test_visibilities_are_no_confidences(tmp_path: Path):
    """Annotations by people: 0 not labelled, 1 hidden, 2 visible; and a hand that is marked as not valid."""
    points = whole(4, score=2)
    points[[3, 95], 2] = 1
    points[100, 2] = 0
    parts = {"foot_kpts": 17, "face_kpts": 23, "lefthand_kpts": 91, "righthand_kpts": 112, "": 133}
    lists = {
        key: points[start:stop].ravel().tolist()
        for (key, start), stop in zip(list(parts.items())[:-1], list(parts.values())[1:], strict=True)
    }
    person = {"image_id": 1, "keypoints": points[:17].ravel().tolist(), **lists, "righthand_valid": False}
    images = [{"id": 1, "file_name": "a.jpg"}, {"id": 2, "file_name": "b.jpg"}]
    found = read_detections(written(tmp_path, {"images": images, "annotations": [person]}))
    one = found.frames[0][0]
    assert one[INDEX["left_ear"], 2] == 0.5 and one[INDEX["nose"], 2] == 1 and len(found.frames[1]) == 0
    assert not one[RIGHT_HAND].any() and one[LEFT_HAND.start + 4, 2] == 0.5 and not one[LEFT_HAND.start + 9].any()
    assert "visibilities" in found.notes[0]


def instances(*seeds: int) -> list[dict[str, Any]]:
    """People as mmpose's inferencer writes them: positions and scores in two lists, a box in a list."""
    return [
        {
            "keypoints": whole(seed)[:, :2].tolist(),
            "keypoint_scores": [0.9] * 133,
            "bbox": [[1.0, 2.0, 300.0, 400.0]],
            "bbox_score": 0.8,
        }
        for seed in seeds
    ]


def expected(*seeds: int) -> np.ndarray:
    return layout.from_wholebody(np.stack([whole(seed) for seed in seeds])) if seeds else np.zeros((0, 137, 3))


FOUND: list[tuple[int, ...]] = [(1,), (), (2, 3), (4,)]
"""Who is in each frame; nobody is in the second."""


def test_predictions_of_the_inferencer_for_a_video(tmp_path: Path):
    """MMPoseInferencer(pred_out_dir=...) lists frames from 0; mmpose's demos from 1, below instance_info."""
    frames = [{"frame_id": k, "instances": instances(*seeds)} for k, seeds in enumerate(FOUND)]
    of_demo = [{**frame, "frame_id": k + 1} for k, frame in enumerate(frames)]
    for content in (frames, {"meta_info": {"dataset_name": "coco_wholebody"}, "instance_info": of_demo}):
        found = read_detections(written(tmp_path, content))
        assert found.numbers == (0, 1, 2, 3)
        for people, seeds in zip(found.frames, FOUND, strict=True):
            np.testing.assert_allclose(people, expected(*seeds))


def test_predictions_of_the_inferencer_for_images(tmp_path: Path):
    """A file for each image, by its name, with the image's people."""
    for k, seeds in enumerate(FOUND, 8):
        (tmp_path / f"walk_{k}.json").write_text(json.dumps(instances(*seeds)))
    (tmp_path / "walk_12.json").write_text(json.dumps({"meta_info": {}, "instance_info": instances(5)}))
    found = read_detections(tmp_path)
    assert found.stems == tuple(f"walk_{k}" for k in range(8, 13)) and found.numbers == tuple(range(8, 13))
    for people, seeds in zip(found.frames, [*FOUND, (5,)], strict=True):
        np.testing.assert_allclose(people, expected(*seeds))
    assert read_detections(tmp_path / "walk_10.json").most_people == 2


def annotated(names: list[str], points: np.ndarray, **more: Any) -> dict[str, Any]:
    """One person by an annotation file whose category lists these names, as annotation tools export it."""
    person = {"image_id": 1, "category_id": 7, "keypoints": points.ravel().tolist(), **more}
    categories = [{"id": 3, "name": "dog", "keypoints": ["tail"]}, {"id": 7, "name": "person", "keypoints": names}]
    return {"images": [{"id": 1, "file_name": "a.jpg"}], "annotations": [person], "categories": categories}


@pytest.mark.parametrize("spelling", [str, str.title, lambda name: f" {name.replace('_', ' ')}"])
def test_points_are_taken_by_the_names_of_their_category(tmp_path: Path, spelling: Callable[[str], str]):
    """CVAT lists a skeleton's points in the order in which they were drawn."""
    points = whole()[:17]
    for order in (range(17), range(16, -1, -1), np.random.default_rng(1).permutation(17)):
        names = [spelling(layout.COCO_17[k]) for k in order]
        found = read_detections(written(tmp_path, annotated(names, points[list(order)]))).frames[0][0]
        assert np.allclose(found[INDEX["nose"]], points[0]) and np.allclose(found[INDEX["right_ankle"]], points[16])


H36M = "root right_hip right_knee right_foot left_hip left_knee left_foot spine thorax neck_base head left_shoulder " \
    "left_elbow left_wrist right_shoulder right_elbow right_wrist"  # fmt: skip


def test_points_of_other_names_are_refused(tmp_path: Path):
    """17 points of Human3.6M look like COCO's but for their names."""
    names, points = H36M.split(), whole()[:17]
    people = [{"keypoints": points[:, :2].tolist(), "keypoint_scores": [0.9] * 17}]
    of_mmpose = {"meta_info": {"keypoint_id2name": {str(k): n for k, n in enumerate(names)}}, "instance_info": people}
    for content in (annotated(names, points), of_mmpose):
        with pytest.raises(
            InputError, match=r"other names \(root, right_foot, left_foot, spine, thorax.*expected COCO's"
        ):
            read_detections(written(tmp_path, content))
    with pytest.raises(InputError, match="17 names, some twice"):
        read_detections(written(tmp_path, annotated(["nose"] * 17, points)))
    with pytest.raises(InputError, match="the names of its keypoints are a text"):
        read_detections(written(tmp_path, annotated("nose", points)))  # pyright: ignore[reportArgumentType]
