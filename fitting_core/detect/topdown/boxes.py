"""Boxes around people, and what all models that find them have in common."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from fitting_core.detect.onnx_model import ModelTensor, OnnxModel, consumers

SCORE = 0.3
"""Boxes of a lower score are left out."""
OVERLAP = 0.45
"""Of two boxes whose intersection over union is larger, the one of lower score is left out."""
PERSON = 0
"""The class of people, in COCO and in models of people alone."""
STRIDES = (8, 16, 32)
"""Input pixels for each cell of the three grids that RTMDet and YOLOX predict on."""
_GREY = 114
"""Of the margin, as in the training of both."""
_DEFAULT_SIDE = 640
"""Of the input of models that take any size."""


@dataclass(frozen=True, kw_only=True)
class Boxes:
    """People in one image, most certain first."""

    corners: Float[np.ndarray, "n 4"]
    """Left, top, right, bottom; pixels of the image."""
    scores: Float[np.ndarray, "n"]
    """0 to 1."""

    def __len__(self) -> int:
        return len(self.scores)


Decode = Callable[[tuple[np.ndarray, ...], tuple[int, int]], tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n"]]]
"""From one image's outputs and the input's width and height to corners in input pixels, and scores of people."""


class BoxModel:
    """Finds people.

    Args:
        model: What is run.
        decode: Of its outputs.
        mean: Of the channels blue, green and red, which is taken off the pixels; before that they are 0 to 255.
        deviation: Of these channels, by which pixels are divided.
    """

    def __init__(
        self,
        model: OnnxModel,
        decode: Decode,
        mean: Float32[np.ndarray, "3"] | float = 0.0,
        deviation: Float32[np.ndarray, "3"] | float = 1.0,
    ) -> None:
        self.model, self.size = model, input_size(model)
        self._decode, self._mean, self._deviation = decode, mean, deviation

    def find(self, images: Sequence[UInt8[np.ndarray, "H W 3"]]) -> list[Boxes]:
        """The people in each RGB image."""
        prepared = [letterboxed(image, self.size) for image in images]
        outputs = self.model.run([(pixels - self._mean) / self._deviation for pixels, _ in prepared])
        found = []
        for image, (_, scale), output in zip(images, prepared, outputs, strict=True):
            corners, scores = self._decode(output, self.size)
            found.append(non_maximum_suppressed(people(corners, scores, scale, (image.shape[1], image.shape[0]))))
        return found


def has_focus(model: OnnxModel) -> bool:
    """Whether a model begins with YOLOX's Focus layer, which slices the image into every second row and column.

    RTMDet begins with a convolution. With non-maximum suppression in the model nothing else tells the two apart, and
    their images are prepared in different ways.
    """
    return "Slice" in consumers(model.path, model.inputs[0].name)


def is_end2end(outputs: tuple[ModelTensor, ...]) -> bool:
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


def input_size(model: OnnxModel) -> tuple[int, int]:
    """Width and height of what goes in; a whole number of the largest cells where the model takes any."""
    width, height = model.size
    return width or _DEFAULT_SIDE, height or _DEFAULT_SIDE


def letterboxed(image: UInt8[np.ndarray, "H W 3"], size: tuple[int, int]) -> tuple[Float32[np.ndarray, "h w 3"], float]:
    """An RGB image as BGR, scaled to fit at the top left of a grey one; and by how much it was scaled."""
    scale = min(size[0] / image.shape[1], size[1] / image.shape[0])
    inner = (max(1, int(image.shape[1] * scale)), max(1, int(image.shape[0] * scale)))
    whole = np.full((size[1], size[0], 3), _GREY, dtype=np.float32)
    whole[: inner[1], : inner[0]] = cv2.resize(image, inner, interpolation=cv2.INTER_LINEAR)[..., ::-1]
    return whole, scale


def people(
    corners: Float[np.ndarray, "n 4"], scores: Float[np.ndarray, "n"], scale: float, size: tuple[int, int]
) -> Boxes:
    """Boxes of the image from those of the model's input: the certain ones, within the image.

    Args:
        corners: In pixels of the input.
        scores: Of the class of people.
        scale: What `letterboxed` returned.
        size: Of the image.
    """
    certain = np.isfinite(corners).all(1) & (scores >= SCORE)
    corners = np.clip(corners[certain].astype(float) / scale, 0, [size[0], size[1], size[0], size[1]])
    scores = np.clip(scores[certain].astype(float), 0, 1)
    order = np.argsort(-scores, kind="stable")
    order = order[((corners[order, 2:] - corners[order, :2]) > 1).all(1)]
    return Boxes(corners=corners[order], scores=scores[order])


def non_maximum_suppressed(boxes: Boxes) -> Boxes:
    """Non-maximum suppression: of boxes that overlap by more than OVERLAP only the best."""
    left = list(range(len(boxes)))
    kept = []
    while left:
        best, *rest = left
        kept.append(best)
        overlaps = intersection_over_union(boxes.corners[best], boxes.corners[rest])
        left = [i for i, overlap in zip(rest, overlaps, strict=True) if overlap <= OVERLAP]
    return Boxes(corners=boxes.corners[kept], scores=boxes.scores[kept])


def intersection_over_union(box: Float[np.ndarray, "4"], others: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n"]:
    """How much one box and each of some others have in common, 0 to 1."""
    low, high = np.maximum(box[:2], others[:, :2]), np.minimum(box[2:], others[:, 2:])
    common = np.clip(high - low, 0, None).prod(1)
    areas = (others[:, 2:] - others[:, :2]).prod(1) + (box[2:] - box[:2]).prod()
    return common / np.maximum(areas - common, 1e-9)


def grid(size: tuple[int, int]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 1"]]:
    """Column and row of all cells of all three grids, and their strides; row by row, finest grid first."""
    cells, strides = [], []
    for stride in STRIDES:
        columns, rows = np.meshgrid(np.arange(size[0] // stride), np.arange(size[1] // stride))
        cells.append(np.stack([columns, rows], -1).reshape(-1, 2).astype(float))
        strides.append(np.full((len(cells[-1]), 1), float(stride)))
    return np.concatenate(cells), np.concatenate(strides)
