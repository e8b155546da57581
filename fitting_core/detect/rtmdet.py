"""RTMDet (Lyu et al. 2022, arXiv:2212.07784; MMDetection): boxes around people.

Exports of it that are in use, told apart by their outputs:

| outputs | |
|---|---|
| dets (N, n, 5), labels (N, n) | with non-maximum suppression in the model ("end2end") |
| (N, n, 4), (N, n, classes) | corners in input pixels and scores of all cells |
| three (N, classes, h, w), three (N, 4, h, w) | the head as it is: logits, and distances to the sides in input pixels |
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, UInt8

from fitting_core.detect.boxes import PERSON, STRIDES, Boxes, grid, input_size, letterboxed, people, without_doubles
from fitting_core.detect.onnx_graph import consumers
from fitting_core.detect.onnx_model import OnnxModel, Tensor

_MEAN = np.array([103.53, 116.28, 123.675], dtype=np.float32)
_DEVIATION = np.array([57.375, 57.12, 58.395], dtype=np.float32)
"""Of ImageNet's channels, here in the order blue, green, red."""


class RTMDet:
    """A box model; see `detect.BoxModel`."""

    def __init__(self, model: OnnxModel) -> None:
        assert recognises(model)
        self.model, self.size = model, input_size(model)
        self._decode = next(decode for fits, decode in _FORMS.items() if fits(model.outputs))

    def find(self, images: Sequence[UInt8[np.ndarray, "H W 3"]]) -> list[Boxes]:
        """The people in each of some RGB images."""
        prepared = [letterboxed(image, self.size) for image in images]
        outputs = self.model.run([(pixels - _MEAN) / _DEVIATION for pixels, _ in prepared])
        found = []
        for image, (_, scale), output in zip(images, prepared, outputs, strict=True):
            corners, scores = self._decode(output, self.size)
            found.append(without_doubles(people(corners, scores, scale, (image.shape[1], image.shape[0]))))
        return found


def recognises(model: OnnxModel) -> bool:
    """Whether a model is an RTMDet."""
    return any(fits(model.outputs) for fits in _FORMS) and not has_focus(model)


def has_focus(model: OnnxModel) -> bool:
    """Whether a model begins with YOLOX's Focus layer, which slices the image into every second row and column.

    RTMDet begins with a convolution. With non-maximum suppression in the model nothing else tells the two apart, and
    their images are prepared in different ways.
    """
    return "Slice" in consumers(model.path, model.inputs[0].name)


def is_end2end(outputs: tuple[Tensor, ...]) -> bool:
    """Whether outputs are boxes after non-maximum suppression, as MMDeploy exports them."""
    by_name = {output.name: output for output in outputs}
    return {"dets", "labels"} <= set(by_name) and len(by_name["dets"].shape) == 3


def decode_end2end(
    output: tuple[np.ndarray, ...], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n"]]:
    """Corners and scores of the people among boxes with labels, for whichever order the two outputs have."""
    dets, labels = sorted(output[:2], key=lambda array: -array.ndim)
    mine = dets[labels.reshape(-1) == PERSON]
    return mine[:, :4], mine[:, 4]


def _is_pair(outputs: tuple[Tensor, ...]) -> bool:
    return len(outputs) == 2 and all(len(o.shape) == 3 for o in outputs) and 4 in (o.shape[2] for o in outputs)


def _decode_pair(
    output: tuple[np.ndarray, ...], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n"]]:
    corners, scores = output if output[0].shape[1] == 4 else reversed(output)
    return corners, scores[:, PERSON]


def _is_head(outputs: tuple[Tensor, ...]) -> bool:
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


_Decode = Callable[[tuple[np.ndarray, ...], tuple[int, int]], tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n"]]]
_FORMS: dict[Callable[[tuple[Tensor, ...]], bool], _Decode] = {
    is_end2end: decode_end2end,
    _is_pair: _decode_pair,
    _is_head: _decode_head,
}
"""What recognises a form by its outputs -> one image's outputs and the input's size to corners and people's scores."""
