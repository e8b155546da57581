"""Families of models: which one a file holds, opening it, and decoding the boxes of the two that find people.

RTMDet (Lyu et al. 2022, arXiv:2212.07784; MMDetection) puts out dets (N, n, 5) and labels (N, n), with non-maximum
suppression in the model ("end2end"), as MMDeploy exports it.

YOLOX (Ge et al. 2021, arXiv:2107.08430) is exported in two: one (N, cells, 5 + classes), the grid as it is (the
authors' own, and DWPose's yolox_l.onnx); or dets (N, n, 5) and labels (N, n), with non-maximum suppression in the model
(MMDeploy's). Both families take BGR images of 0 to 255.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from fitting_core.detect.onnx_model import OnnxModel, what_it_is
from fitting_core.detect.topdown import simcc
from fitting_core.detect.topdown.boxes import (
    PERSON,
    STRIDES,
    BoxModel,
    decode_end2end,
    grid,
    has_focus,
    input_size,
    is_end2end,
)
from fitting_core.errors import InputError

_MEAN = np.array([103.53, 116.28, 123.675], dtype=np.float32)
_DEVIATION = np.array([57.375, 57.12, 58.395], dtype=np.float32)
"""Of ImageNet's channels, here in the order blue, green, red."""


def _make_rtmdet(model: OnnxModel) -> BoxModel:
    """The model, ready to find people."""
    return BoxModel(model, decode_end2end, _MEAN, _DEVIATION)


def _is_rtmdet(model: OnnxModel) -> bool:
    """Whether a model is an RTMDet."""
    return is_end2end(model.outputs) and not has_focus(model)


_BEFORE_CLASSES = 5
"""Numbers of a cell before those of the classes: centre, size, and whether there is anything."""
_MOST_EXPONENT = 12.0
"""Of sizes: larger ones are larger than any image, and would not be numbers any more."""


def _make_yolox(model: OnnxModel) -> BoxModel:
    return BoxModel(model, decode_end2end if is_end2end(model.outputs) else _decode_grid)


def _is_yolox(model: OnnxModel) -> bool:
    if is_end2end(model.outputs):
        return has_focus(model)
    if len(model.outputs) != 1 or len(model.outputs[0].shape) != 3:
        return False
    _, cells, numbers = model.outputs[0].shape
    width, height = input_size(model)
    expected = sum((width // stride) * (height // stride) for stride in STRIDES)
    return numbers is not None and numbers > _BEFORE_CLASSES and cells in (expected, None)


def _decode_grid(
    output: tuple[np.ndarray, ...], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n"]]:
    """Corners in input pixels, and scores of people, from one image's grid.

    A cell at (column, row) of a grid of stride s says x, y, log w and log h of its box, in cells: the centre is
    ((column + x) s, (row + y) s), the size (exp(w) s, exp(h) s). Its score is that of an object times that of the
    class.
    """
    numbers = output[0].astype(float)
    cells, strides = grid(size)
    centres = (numbers[:, :2] + cells) * strides
    halves = np.exp(np.minimum(numbers[:, 2:4], _MOST_EXPONENT)) * strides / 2
    return np.concatenate([centres - halves, centres + halves], 1), numbers[:, 4] * numbers[:, _BEFORE_CLASSES + PERSON]


@dataclass(frozen=True, kw_only=True)
class Family:
    """Models of one kind."""

    title: str
    finds: Literal["points", "boxes"]
    recognises: Callable[[OnnxModel], bool]
    make: Callable[[OnnxModel], Any]


FAMILIES: dict[str, Family] = {
    "simcc": Family(title="RTMPose, DWPose, RTMW", finds="points", recognises=simcc.recognises, make=simcc.SimCC),
    "rtmdet": Family(title="RTMDet", finds="boxes", recognises=_is_rtmdet, make=_make_rtmdet),
    "yolox": Family(title="YOLOX", finds="boxes", recognises=_is_yolox, make=_make_yolox),
}
"""By name; the first that recognises a model runs it."""


def load_pose_model(path: Path, *, provider: str = "cpu", threads: int = 0) -> simcc.SimCC:
    """Open a whole-body model. Raises InputError if there is no such file, it is not an ONNX model, or of another kind,
    which the message names."""
    return _load(path, "points", provider, threads)


def load_box_model(path: Path, *, provider: str = "cpu", threads: int = 0) -> BoxModel:
    """Open a model that finds people. Raises InputError as `load_pose_model`."""
    return _load(path, "boxes", provider, threads)


def family_of(model: OnnxModel) -> Family | None:
    """The family that a model belongs to."""
    return next((family for family in FAMILIES.values() if family.recognises(model)), None)


def _load(path: Path, finds: Literal["points", "boxes"], provider: str, threads: int) -> Any:
    model = OnnxModel(path, provider=provider, threads=threads)
    family = family_of(model)
    if family is not None and family.finds == finds:
        return family.make(model)
    if finds == "points":
        raise simcc.wrong_model(model)
    known = " or ".join(f.title for f in FAMILIES.values() if f.finds == "boxes")
    raise InputError(
        f"{path}: is {what_it_is(model)}. Expected a detector of people: {known}, with outputs dets and labels; export "
        "RTMDet with non-maximum suppression (end2end)."
    )
