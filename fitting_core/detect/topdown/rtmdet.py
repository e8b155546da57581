"""RTMDet (Lyu et al. 2022, arXiv:2212.07784; MMDetection): boxes around people.

Exports of it that are in use, distinguished by their outputs:

| outputs | |
|---|---|
| dets (N, n, 5), labels (N, n) | with non-maximum suppression in the model ("end2end") |
| (N, n, 4), (N, n, classes) | corners in input pixels and scores of all cells |
| three (N, classes, h, w), three (N, 4, h, w) | the head as it is: logits, and distances to the sides in input pixels |
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from fitting_core.detect.onnx_model import ModelTensor, OnnxModel
from fitting_core.detect.topdown.boxes import (
    PERSON,
    STRIDES,
    BoxModel,
    Decode,
    decode_end2end,
    grid,
    has_focus,
    is_end2end,
)

_MEAN = np.array([103.53, 116.28, 123.675], dtype=np.float32)
_DEVIATION = np.array([57.375, 57.12, 58.395], dtype=np.float32)
"""Of ImageNet's channels, here in the order blue, green, red."""


def make(model: OnnxModel) -> BoxModel:
    """The model, which `recognises`, ready to find people."""
    decode = next(decode for fits, decode in _FORMS.items() if fits(model.outputs))
    return BoxModel(model, decode, _MEAN, _DEVIATION)


def recognises(model: OnnxModel) -> bool:
    """Whether a model is an RTMDet."""
    return any(fits(model.outputs) for fits in _FORMS) and not has_focus(model)


def _is_pair(outputs: tuple[ModelTensor, ...]) -> bool:
    return len(outputs) == 2 and all(len(o.shape) == 3 for o in outputs) and 4 in (o.shape[2] for o in outputs)


def _decode_pair(
    output: tuple[np.ndarray, ...], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n"]]:
    corners, scores = output if output[0].shape[1] == 4 else reversed(output)
    return corners, scores[:, PERSON]


def _is_head(outputs: tuple[ModelTensor, ...]) -> bool:
    if len(outputs) != 2 * len(STRIDES) or any(len(output.shape) != 4 for output in outputs):
        return False
    return all(output.shape[1] == 4 for output in outputs[len(STRIDES) :])


def _decode_head(
    output: tuple[np.ndarray, ...], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n"]]:
    logits, sides = (
        np.concatenate([np.moveaxis(level, 0, -1).reshape(-1, level.shape[0]) for level in levels]).astype(float)
        for levels in (output[: len(STRIDES)], output[len(STRIDES) :])
    )
    cells, strides = grid(size)
    points = cells * strides
    corners = np.concatenate([points - sides[:, :2], points + sides[:, 2:]], 1)
    return corners, 1 / (1 + np.exp(-np.clip(logits[:, PERSON], -60, 60)))


_FORMS: dict[Callable[[tuple[ModelTensor, ...]], bool], Decode] = {
    is_end2end: decode_end2end,
    _is_pair: _decode_pair,
    _is_head: _decode_head,
}
"""By what recognises a form by its outputs."""
