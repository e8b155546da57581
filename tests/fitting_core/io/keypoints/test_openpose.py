"""Reading OpenPose JSON in its variants, real and broken, and writing it."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fitting_core.detections import to_pixels
from fitting_core.errors import InputError
from fitting_core.frame_alignment import timeline_of_keypoints
from fitting_core.io import read_detections
from fitting_core.io.keypoints.openpose import read_openpose, write_openpose
from fitting_core.keypoints import BODY, BODY_25, FACE, INDEX, LEFT_HAND, RIGHT_HAND, Keypoints

COCO = [
    "nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle",
    "right_eye", "left_eye", "right_ear", "left_ear",
]  # fmt: skip


def triples(count: int, *, start: float = 10.0, confidence: float = 0.5) -> list[float]:
    return [value for k in range(count) for value in (start + k, start + 2 * k, confidence)]


BODY_LIST = triples(25)
PERSON = {"pose_keypoints_2d": BODY_LIST}


def changed(values: list, index: int, value: object) -> list:
    return [*values[:index], value, *values[index + 1 :]]


@pytest.mark.parametrize("suffix", ["_2d", ""])
@pytest.mark.parametrize(
    "key, part, count",
    [
        ("pose_keypoints", BODY, 25),
        ("hand_left_keypoints", LEFT_HAND, 21),
        ("hand_right_keypoints", RIGHT_HAND, 21),
        ("face_keypoints", FACE, 70),
    ],
)
def test_each_list_alone_goes_to_its_part(write_people, key, part, count, suffix):
    person = {f"{key}{suffix}": triples(count)}
    points = read_openpose(write_people({"a_0": [person]})).frames[0][0]
    assert points[part].ravel().tolist() == triples(count)
    assert points[:, 2].sum() == pytest.approx(0.5 * count)


@pytest.mark.parametrize("key", ["pose_keypoints_2d", "pose_keypoints"])
def test_coco_18(write_people, key):
    """The middle of the hips is as sure as the less sure of them."""
    values = changed(triples(18), 3 * COCO.index("left_hip") + 2, 0.3)
    points = read_openpose(write_people({"a_0": [{key: values}]})).frames[0][0]
    for k, name in enumerate(COCO):
        assert points[INDEX[name]].tolist() == [10 + k, 10 + 2 * k, 0.3 if name == "left_hip" else 0.5]
    hips = points[[INDEX["right_hip"], INDEX["left_hip"]]]
    assert points[INDEX["mid_hip"]].tolist() == [*hips[:, :2].mean(0), 0.3]
    assert (points[[INDEX[name] for name in BODY_25 if "toe" in name or "heel" in name], 2] == 0).all()


def test_byte_order_mark_and_hidden_files(write_people):
    folder = write_people({"a_0": [PERSON]})
    file = folder / "a_0_keypoints.json"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    (folder / "._a_0_keypoints.json").write_bytes(b"\x00\x05\x16\x07")
    assert len(read_openpose(folder)) == 1


NAMED = {
    "plain numbers": "{}",
    "OpenPose's own": "walk_{:012}_keypoints",
    "a camera before": "cam01.{:04}",
    "without a separator": "frame{}",
    "the image's name": "frame_{:04}.png_keypoints",
    "brackets": "clip ({})_keypoints",
    "a rate behind": "walk_{:04}_30fps_keypoints",
    "the same number twice": "{0}/../walk_{0}_of_{0}",
    "capitals": "walk_{}.JSON",
}


@pytest.mark.parametrize("name", NAMED)
def test_frames_are_found_by_the_number_in_which_names_differ(tmp_path: Path, name: str):
    folder = tmp_path / "keypoints"
    folder.mkdir()
    (folder / "notes.json").write_text('{"filmed": "in 2024"}')
    for k in range(12):
        stem = NAMED[name].format(k).rpartition("/")[2]
        (folder / (stem if stem.endswith(".JSON") else f"{stem}.json")).write_text(
            json.dumps({"people": [{"pose_keypoints_2d": changed(BODY_LIST, 0, 100 + k)}]})
        )
    found = read_detections(folder)
    assert [people[0, 0, 0] for people in found.frames] == list(range(100, 112))
    assert found.numbers == tuple(range(12))
    assert timeline_of_keypoints(found).numbers == range(12)
    told = name in ("the image's name", "brackets", "a rate behind")
    assert [f"0 of {found.stems[0]}" in note for note in found.notes] == [True] * told


def test_names_that_differ_in_two_numbers(write_people):
    found = read_detections(write_people({"walk_1_33": [PERSON], "walk_2_66": [PERSON]}))
    with pytest.raises(InputError, match=r"differ in several numbers \(walk_1_33, walk_2_66\); expected one, which"):
        timeline_of_keypoints(found)


_NUMBERS = st.one_of(st.floats(), st.integers(), st.none(), st.text(max_size=2), st.floats(0, 1))
_LISTS = st.one_of(st.lists(_NUMBERS, max_size=3), st.lists(st.floats(0, 1), min_size=54, max_size=54), _NUMBERS)
_KEYS = st.sampled_from(["pose_keypoints_2d", "pose_keypoints", "face_keypoints_2d", "person_id", "x"])
_PEOPLE = st.one_of(st.lists(st.one_of(st.dictionaries(_KEYS, _LISTS, max_size=3), _NUMBERS), max_size=3), _NUMBERS)


@settings(max_examples=80, deadline=None)
@given(people=_PEOPLE)
def test_whatever_a_file_holds_is_read_or_refused_in_words(tmp_path_factory, people):
    file = tmp_path_factory.getbasetemp() / "any_0_keypoints.json"
    file.write_text(json.dumps({"people": people}))
    try:
        points = read_openpose(file).frames[0]
    except InputError as error:
        assert "any_0_keypoints.json" in str(error) and "expected" in str(error)
    else:
        assert np.isfinite(points).all() and (points[..., 2] <= 1).all() and (points[..., 2] >= 0).all()


def test_a_folder_without_keypoint_files(tmp_path):
    for name in ("0001.png", "0002.png"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"found 2 other files, such as 0001.png; expected"):
        read_detections(tmp_path)


def test_two_body_layouts_in_one_clip(write_people):
    folder = write_people({"a_0": [PERSON], "a_1": [{"pose_keypoints_2d": triples(18)}]})
    with pytest.raises(InputError, match=r"a_0_keypoints.json has 25 points, a_1_keypoints.json has 18"):
        read_openpose(folder)


def test_the_same_frame_number_twice(write_people):
    folder = write_people({"a_12": [PERSON], "a_0012": [PERSON]})
    with pytest.raises(InputError, match=r"Frame 12 is there twice: .*a_0012_keypoints.json.*Remove one") as error:
        read_openpose(folder)
    assert "a_12_keypoints.json" in str(error.value)


SIZE = (641, 481)
SCALES = {"pixels": (0, 1.0, 1.0), "0..1": (0, 1 / 640, 1 / 480), "-1..1": (-1, 2 / 640, 2 / 480)}


def scaled(figure: np.ndarray, scale: str) -> np.ndarray:
    offset, x, y = SCALES[scale]
    return np.where(figure[:, 2:] > 0, figure * [x, y, 1] + [offset, offset, 0], [offset, offset, 0])


@pytest.mark.parametrize("option", ["auto", "forced"])
@pytest.mark.parametrize("scale", SCALES)
def test_normalised_coordinates(write_people, figure, scale, option):
    person = figure(100.0, 200.0)
    person[3] = 0
    detections = read_openpose(write_people({"a_0": [scaled(person, scale)]}))
    pixels, notes = to_pixels(detections, SIZE, keypoint_scale="auto" if option == "auto" else scale)
    np.testing.assert_allclose(pixels.frames[0][0], person, atol=1e-9)
    assert (scale in notes[0]) if scale != "pixels" else notes == ()


def test_normalised_coordinates_need_the_image_size(write_people, figure):
    detections = read_openpose(write_people({"a_0": [scaled(figure(100.0, 200.0), "0..1")]}))
    with pytest.raises(InputError, match=r"normalised to 0..1 \(judged by their range\), so the image size is needed"):
        to_pixels(detections, None)


CANVAS = (512, 288)


def of_controlnet(figure, *, shares: bool, **changed: object) -> dict:
    """As ControlNet's preprocessors write a frame: confidences of 1, null for parts that are not there, a canvas."""
    person = figure(100.0, 200.0)
    values = person[:25] / ([*CANVAS, 1] if shares else [1, 1, 1])
    coco = values[[BODY_25.index(name) for name in COCO]]
    coco[:, 2] = 1
    lists = {"pose_keypoints_2d": coco.ravel().tolist(), "hand_left_keypoints_2d": None, "face_keypoints_2d": None}
    return {"people": [lists], "canvas_width": CANVAS[0], "canvas_height": CANVAS[1]} | changed


@pytest.mark.parametrize("shares", [True, False])
@pytest.mark.parametrize("listed", [True, False])
def test_files_of_controlnet_and_comfyui(tmp_path: Path, figure, shares: bool, listed: bool):
    """One object, or a list of frames; pixels of the canvas, or shares of it."""
    frame = of_controlnet(figure, shares=shares)
    (tmp_path / "poses.json").write_text(json.dumps([frame] * 3 if listed else frame))
    found = read_detections(tmp_path / "poses.json")
    assert found.size == CANVAS and len(found) == (3 if listed else 1)
    assert found.numbers == ((0, 1, 2) if listed else None)
    own, _ = to_pixels(found, CANVAS)
    nose = [people[0, 0, :2] for people in own.frames]
    np.testing.assert_allclose(nose, [figure(100.0, 200.0)[0, :2]] * len(found))
    assert all(people[0, :, 2].max() == 1 for people in own.frames)


@pytest.mark.parametrize("shares", [True, False])
def test_keypoints_of_a_resized_image_are_scaled_to_the_video(tmp_path: Path, figure, shares: bool):
    (tmp_path / "poses.json").write_text(json.dumps(of_controlnet(figure, shares=shares)))
    found, notes = to_pixels(read_detections(tmp_path / "poses.json"), (2 * CANVAS[0], 2 * CANVAS[1]))
    np.testing.assert_allclose(found.frames[0][0, 0, :2], 2 * figure(100.0, 200.0)[0, :2] + (0 if shares else 0.5))
    assert ("normalised to shares (as the file says)" if shares else "scaled to that") in notes[0]
    _, notes = to_pixels(read_detections(tmp_path / "poses.json"), (600, 600))
    assert shares or "of another shape: the keypoints are taken as they are" in notes[0]


CANVASES = {
    "no number": ([{"canvas_width": "wide"}], "has canvas_width and canvas_height 'wide' and 288; expected"),
    "one alone": ([{"canvas_height": None}], "512 and None; expected the image's width"),
    "none": ([{"canvas_width": 0}], "0 and 288; expected"),
    "two": ([{}, {"canvas_width": 640}], r"Different canvases in one clip: poses.json, frame 0 says \(512, 288\)"),
}


@pytest.mark.parametrize("name", CANVASES)
def test_a_canvas_that_is_none(tmp_path: Path, figure, name: str):
    changes, says = CANVASES[name]
    frames = [of_controlnet(figure, shares=True, **changed) for changed in changes]
    (tmp_path / "poses.json").write_text(json.dumps(frames))
    with pytest.raises(InputError, match=says):
        read_detections(tmp_path / "poses.json")


@st.composite
def clips(draw: st.DrawFn) -> Keypoints:
    count = draw(st.integers(1, 3))
    sizes = st.floats(-1e6, 1e6, width=64)
    confidence = draw(arrays(float, (count, 137), elements=st.floats(0, 1), fill=st.just(0.0)))
    return Keypoints(xy=draw(arrays(float, (count, 137, 2), elements=sizes)), confidence=confidence)


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(clip=clips(), first=st.integers(0, 10**12 - 10))
def test_what_is_written_reads_back_the_same(tmp_path_factory, clip, first):
    folder = tmp_path_factory.mktemp("written")
    write_openpose(folder, clip, name="walk", first_frame=first)
    detections = read_openpose(folder)
    assert detections.numbers == tuple(range(first, first + len(clip)))
    for people, xy, confidence in zip(detections.frames, clip.xy, clip.confidence, strict=True):
        points = people[0] if len(people) else np.zeros((137, 3))
        detected = confidence > 0
        assert (points[:, 2] == confidence).all()
        assert (points[detected, :2] == xy[detected]).all()
        assert (points[~detected] == 0).all()


def test_writing_replaces_own_files_and_refuses_among_others(tmp_path, figure):
    points = figure(50, 200)[None]
    clip = Keypoints(xy=points[..., :2], confidence=points[..., 2])
    write_openpose(tmp_path, clip, name="walk")
    write_openpose(tmp_path, clip, name="walk")
    with pytest.raises(InputError, match="already holds 1 other keypoint files, such as walk_000000000000_keypoints"):
        write_openpose(tmp_path, clip, name="run")
    assert [path.name for path in tmp_path.iterdir()] == ["walk_000000000000_keypoints.json"]


def test_a_failed_write_keeps_the_old_file(tmp_path, figure, monkeypatch):
    points = figure(50, 200)[None]
    clip = Keypoints(xy=points[..., :2], confidence=points[..., 2])
    (file,) = write_openpose(tmp_path, clip, name="walk")
    before = file.read_text()

    def full_disk(self: Path, text: str, **_: object) -> None:
        self.write_bytes(text[:10].encode())
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_text", full_disk)
    with pytest.raises(OSError, match="no space"):
        write_openpose(tmp_path, clip, name="walk")
    assert file.read_text() == before
    assert list(tmp_path.iterdir()) == [file]
