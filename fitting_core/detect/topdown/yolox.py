"""YOLOX (Ge et al. 2021, arXiv:2107.08430): boxes around people.

Exports of it that are in use, distinguished by their outputs: one (N, cells, 5 + classes), the grid as it is (the
authors'
own, and DWPose's yolox_l.onnx); or dets (N, n, 5) and labels (N, n), with non-maximum suppression in the model
(MMDeploy's). Both take BGR images of 0 to 255.
"""

import numpy as np
from jaxtyping import Float

from fitting_core.detect.onnx_model import OnnxModel
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

_BEFORE_CLASSES = 5
"""Numbers of a cell before those of the classes: centre, size, and whether there is anything."""
_MOST_EXPONENT = 12.0
"""Of sizes: larger ones are larger than any image, and would not be numbers any more."""


def make(model: OnnxModel) -> BoxModel:
    """The model, which `recognises`, ready to find people."""
    return BoxModel(model, decode_end2end if is_end2end(model.outputs) else decode_grid)


def recognises(model: OnnxModel) -> bool:
    """Whether a model is a YOLOX."""
    if is_end2end(model.outputs):
        return has_focus(model)
    if len(model.outputs) != 1 or len(model.outputs[0].shape) != 3:
        return False
    _, cells, numbers = model.outputs[0].shape
    width, height = input_size(model)
    expected = sum((width // stride) * (height // stride) for stride in STRIDES)
    return numbers is not None and numbers > _BEFORE_CLASSES and cells in (expected, None)


def decode_grid(
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
