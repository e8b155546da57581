"""The RTMPose family: geometry there and back, batches, layouts, and models that are none of it."""

from pathlib import Path

import numpy as np
import pytest

from fitting_core.detect.topdown import simcc
from fitting_core.detect.topdown.families import load_pose_model
from fitting_core.errors import InputError
from tests.fitting_core.detect.onnx_files import brightest_model, channels_of_points, constant_model, spots

SIZE = (640, 480)
PLACES = {0: (251.0, 140.0), 1: (330.4, 260.7), 2: (290.6, 333.3)}
BOX = np.array([210.0, 100.0, 380.0, 390.0])


def expected() -> np.ndarray:
    return np.array([PLACES[channel] for channel in channels_of_points()])


@pytest.mark.parametrize("layout", ["NCHW", "NHWC"])
@pytest.mark.parametrize("size", [(192, 256), (288, 384), (48, 64)])
def test_points_come_back_where_they_are_in_the_image(tmp_path: Path, layout: str, size: tuple[int, int]):
    model = load_pose_model(brightest_model(tmp_path / "m.onnx", layout=layout, size=size), threads=1)
    pixel = (BOX[3] - BOX[1]) * simcc.PADDING / size[1]
    points = model.points([spots(SIZE, PLACES, sigma=2.5 * pixel)], BOX[None])[0]
    apart = np.linalg.norm(points[:, :2] - expected(), axis=1)
    assert apart.max() < min(1.0, pixel / 2), f"{apart.max():.2f} px, a bin is {pixel / 2:.2f}"
    # A spot between two pixels of the input is seen a little darker than it is.
    assert simcc.peak_confidence(points[:, 2]).min() > 0.9


def test_a_box_beyond_the_image_and_one_of_another_aspect(tmp_path: Path):
    model = load_pose_model(brightest_model(tmp_path / "m.onnx", size=(192, 256)), threads=1)
    boxes = np.array([[-100.0, -60.0, 700.0, 520.0], [240.0, 80.0, 345.0, 400.0]])
    for points in model.points([spots(SIZE, PLACES, sigma=10.0)] * 2, boxes):
        assert np.linalg.norm(points[:, :2] - expected(), axis=1).max() < 1.0


def test_the_order_of_the_outputs_and_the_bins_of_a_pixel_are_read_from_the_model(tmp_path: Path):
    for number, changes in enumerate(({"swapped": True}, {"ratio": 3}, {"ratio": 1})):
        made = brightest_model(tmp_path / f"{number}.onnx", size=(96, 128), **changes)
        points = load_pose_model(made, threads=1).points([spots(SIZE, PLACES)], BOX[None])[0]
        assert np.linalg.norm(points[:, :2] - expected(), axis=1).max() < 1.0, changes


def test_peaks_between_bins():
    bins = np.arange(40.0)
    curves = np.stack([np.exp(-((bins - c) ** 2) / 18) for c in (10.0, 17.3, 0.0, 39.0)])
    places, heights = simcc.peaks(curves + 5.0)
    assert np.allclose(places, [10.0, 17.3, 0.0, 39.0], atol=0.02)
    assert np.allclose(heights, curves.max(1) - np.median(curves, 1))


# --- models of another kind ---


def other_models(folder: Path) -> dict[str, tuple[Path, str]]:
    """By what is wrong: a model, and words that must stand in the message."""
    boxes = {"dets": np.zeros((1, 4, 5)), "labels": np.zeros((1, 4), dtype=int)}
    return {
        "boxes": (constant_model(folder / "boxes.onnx", boxes), "a detector of boxes: input image 1 x 3 x 32 x 64"),
        "17 points": (brightest_model(folder / "17.onnx", count=17), "17 points, those of a body (COCO), as SimCC"),
        "21 points": (brightest_model(folder / "21.onnx", count=21), "21 points, those of a hand, as SimCC"),
        "heat maps": (constant_model(folder / "maps.onnx", {"maps": np.zeros((1, 133, 8, 6))}), "as heat maps"),
        "one output": (constant_model(folder / "one.onnx", {"y": np.zeros((1, 7))}), "a model of an unknown kind"),
        "bins": (
            constant_model(
                folder / "bins.onnx", {"simcc_x": np.zeros((1, 133, 100)), "simcc_y": np.zeros((1, 133, 64))}
            ),
            "equally many bins for each column and each row",
        ),
        "two images": (constant_model(folder / "five.onnx", boxes, image=(1, 5, 32, 64)), "3 colour channels"),
    }


@pytest.mark.parametrize("what", ["boxes", "17 points", "21 points", "heat maps", "one output", "bins", "two images"])
def test_a_model_of_another_kind_is_refused_with_what_it_is(tmp_path: Path, what: str):
    path, words = other_models(tmp_path)[what]
    with pytest.raises(InputError) as caught:
        load_pose_model(path, threads=1)
    assert str(path) in str(caught.value) and words in str(caught.value)


def test_files_that_are_no_models(tmp_path: Path):
    whole = brightest_model(tmp_path / "m.onnx").read_bytes()
    for name, content in {"text": b"hello", "empty": b"", "cut": whole[: len(whole) // 2]}.items():
        path = tmp_path / f"{name}.onnx"
        path.write_bytes(content)
        with pytest.raises(InputError, match="cannot be opened as an ONNX model"):
            load_pose_model(path, threads=1)
    with pytest.raises(InputError, match="no such model file"):
        load_pose_model(tmp_path / "nowhere.onnx")
    with pytest.raises(InputError, match="is a folder, expected an ONNX model"):
        load_pose_model(tmp_path)


def test_a_provider_that_is_not_there(tmp_path: Path):
    path = brightest_model(tmp_path / "m.onnx")
    with pytest.raises(InputError, match="expected one of cpu, cuda"):
        load_pose_model(path, provider="gpu")
    import onnxruntime

    if "CUDAExecutionProvider" not in onnxruntime.get_available_providers():
        with pytest.raises(InputError, match="onnxruntime-gpu"):
            load_pose_model(path, provider="cuda")
