"""RTMDet and YOLOX: their outputs against values computed by hand, and real people."""

from pathlib import Path

import numpy as np
import pytest

from fitting_core.detect.onnx_model import OnnxModel
from fitting_core.detect.topdown.boxes import (
    BoxModel,
    intersection_over_union,
    letterboxed,
)
from fitting_core.detect.topdown.families import FAMILIES, family_of, load_box_model
from fitting_core.errors import InputError
from fitting_core.video.frames import FrameSource
from tests.fitting_core.detect.onnx_files import constant_model

IMAGE = np.zeros((96, 128, 3), dtype=np.uint8)
"""Twice as wide and high as what fits into the models' 64 x 48 of 64 x 64 pixels."""
INPUT = (1, 3, 64, 64)
CELLS = 8 * 8 + 4 * 4 + 2 * 2
DETS = np.array([[[10, 5, 30, 40, 0.9], [40, 10, 60, 30, 0.8], [11, 6, 31, 41, 0.7], [1, 1, 9, 9, 0.2]]])
LABELS = np.array([[0, 17, 0, 0]])
"""A person, a horse, the person again, and somebody below the threshold."""


def only_box(model: BoxModel) -> tuple[list[float], float]:
    (found,) = model.find([IMAGE])
    assert len(found) == 1
    return found.corners[0].tolist(), float(found.scores[0])


@pytest.mark.parametrize(("focus", "kind"), [(False, "rtmdet"), (True, "yolox")])
def test_boxes_of_a_model_with_suppression(tmp_path: Path, focus: bool, kind: str):
    outputs = {"dets": DETS, "labels": LABELS}
    model = load_box_model(constant_model(tmp_path / "m.onnx", outputs, image=INPUT, focus=focus), threads=1)
    assert family_of(model.model) is FAMILIES[kind]
    assert only_box(model) == ([20.0, 10.0, 60.0, 80.0], pytest.approx(0.9))


def test_yolox_as_the_grid_is(tmp_path: Path):
    numbers = np.zeros((1, CELLS, 85))
    # Row 2, column 3 of the grid of stride 8: the centre (28, 18), 16 wide and 24 high.
    numbers[0, 2 * 8 + 3, :6] = (0.5, 0.25, np.log(2), np.log(3), 0.8, 0.75)
    # Row 1, column 0 of the grid of stride 32: a dog.
    numbers[0, 64 + 16 + 2, [4, 5 + 16]] = 1.0
    model = load_box_model(constant_model(tmp_path / "m.onnx", {"output": numbers}, image=INPUT, focus=True), threads=1)
    assert family_of(model.model) is FAMILIES["yolox"]
    corners, score = only_box(model)
    assert np.allclose(corners, [40, 12, 72, 60]) and score == pytest.approx(0.6)


def test_numbers_beyond_all_bounds_are_no_boxes(tmp_path: Path):
    numbers = np.zeros((1, CELLS, 85))
    numbers[0, 0, :6] = (np.nan, 0, 0, 0, 1, 1)
    numbers[0, 1, :6] = (0, 0, 1e5, 0, 1, 1)
    numbers[0, 2, :6] = (0, 0, -1e5, 0, 1, 1)
    model = load_box_model(constant_model(tmp_path / "m.onnx", {"output": numbers}, image=INPUT, focus=True), threads=1)
    (found,) = model.find([IMAGE])
    assert np.isfinite(found.corners).all()
    assert (found.corners >= 0).all() and (found.corners <= [128, 96, 128, 96]).all()


def test_the_image_keeps_its_aspect_ratio_and_turns_blue_green_red():
    image = np.zeros((50, 200, 3), np.uint8)
    image[..., 0] = 200
    whole, scale = letterboxed(image, (100, 60))
    assert scale == 0.5 and whole.shape == (60, 100, 3)
    assert (whole[:25] == [0, 0, 200]).all() and (whole[25:] == 114).all()


def test_every_family_recognises_its_models_alone(tmp_path: Path):
    path = constant_model(tmp_path / "m.onnx", {"y": np.zeros((1, 3))}, image=INPUT)
    assert family_of(OnnxModel(path, threads=1)) is None
    with pytest.raises(InputError, match="unknown kind: input image 1 x 3 x 64 x 64"):
        load_box_model(path, threads=1)
    assert {family.finds for family in FAMILIES.values()} == {"points", "boxes"}


# Read off the video by eye, at frame 60: the man on the wall, and the woman who walks.
PEOPLE = np.array([[515.0, 48, 735, 460], [1278, 543, 1502, 944]])


def test_real_people_are_found(shared_data: Path):
    model = load_box_model(shared_data / "onnx" / "rtmdet_nano.onnx", threads=1)
    assert family_of(model.model) is FAMILIES["rtmdet"]
    with FrameSource(shared_data / "video" / "walk_two_people.mp4") as video:
        found, nobody = model.find([video.frame(60), np.full((300, 400, 3), 90, np.uint8)])
    for person in PEOPLE:
        assert intersection_over_union(person, found.corners).max() > 0.85
    assert len(found) == 2 and len(nobody) == 0
