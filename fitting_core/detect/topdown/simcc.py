"""RTMPose, DWPose and RTMW: the 133 points of COCO-WholeBody of one person in a box, by SimCC.

SimCC (Li et al. 2022, arXiv:2107.03332) says for every point how likely each column and each row is, in bins of half a
pixel of the model's input. RTMPose is Jiang et al. 2023 (arXiv:2303.07399), DWPose Yang et al. 2023 (arXiv:2307.15880),
RTMW Jiang et al. 2024 (arXiv:2407.08634).

**Confidence.** The heads' numbers are logits, not probabilities. What a head was trained to say for a point that it is
certain of follows from its loss: RTMPose and DWPose minimise the divergence of softmax(10 logits) from softmax(10 G),
with G a Gaussian of height 1, so their peak stands 1 above the rest; RTMW's loss has softmax(logits) there, so that its
peak stands 10 above the rest. Only differences of logits count in either, therefore the height is taken above the
median of all bins. `peak_confidence` divides it by 1 or 10, whichever the heights of the clip say, and cuts at 1.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from fitting_core.detect.onnx_model import OnnxModel, what_it_is
from fitting_core.errors import InputError
from fitting_core.wholebody import WHOLEBODY_COUNT

PADDING = 1.25
"""How much larger than a person's box the part of the image is that the model sees, as in its training."""
_MEAN = np.array([123.675, 116.28, 103.53], dtype=np.float32)
_DEVIATION = np.array([58.395, 57.12, 57.375], dtype=np.float32)
"""Of ImageNet's channels, red first."""
_HIGH = 3.0
"""A peak at least this high comes from a model whose certain peaks have height 10, not 1 (MMPose's users report at most
1.1 for those)."""
_SCALES = (1.0, 10.0)


class SimCC:
    """A pose model: finds the points of one person in a box. Raises InputError if the model's input and outputs do not
    fit each other."""

    def __init__(self, model: OnnxModel) -> None:
        assert recognises(model)
        self.model = model
        width, height = model.size
        if width is None or height is None:
            raise InputError(
                f"{model.path}: leaves the size of its images open ({model.describe()}); expected fixed ones, such as "
                "192 x 256 or 288 x 384 pixels. Export it with a fixed input size."
            )
        self.size = (width, height)
        self._x_first, self.ratio = self._arrangement()

    def _arrangement(self) -> tuple[bool, float]:
        """Whether the columns come first, and how many bins each pixel has; from what the model says to nothing."""
        blank = np.zeros((self.size[1], self.size[0], 3), dtype=np.float32)
        first, second = (output.shape for output in self.model.run([blank])[0])
        for x_first, (columns, rows) in ((True, (first, second)), (False, (second, first))):
            ratio = columns[1] / self.size[0]
            if columns[0] == rows[0] == WHOLEBODY_COUNT and ratio > 0 and rows[1] == ratio * self.size[1]:
                return x_first, ratio
        raise InputError(
            f"{self.model.path}: gives {' and '.join(f'{a} x {b}' for a, b in (first, second))} numbers for an image "
            f"of {self.size[0]} x {self.size[1]}; expected {WHOLEBODY_COUNT} points with equally many bins for each "
            "column and each row."
        )

    def points(
        self, images: Sequence[UInt8[np.ndarray, "H W 3"]], boxes: Float[np.ndarray, "n 4"]
    ) -> Float[np.ndarray, "n 133 3"]:
        """The points of one person in each of some RGB images.

        Args:
            images: One for each box.
            boxes: Left, top, right, bottom of the person; pixels.

        Returns:
            x, y in pixels of the image, and the height of the peak: `peak_confidence` makes a confidence of it.
        """
        regions = np.array([region(box, self.size) for box in boxes]).reshape(-1, 4)
        outputs = self.model.run([self._cut(image, part) for image, part in zip(images, regions, strict=True)])
        result = np.zeros((len(boxes), WHOLEBODY_COUNT, 3))
        for points, part, output in zip(result, regions, outputs, strict=True):
            x, y = output if self._x_first else reversed(output)
            (columns, a), (rows, b) = peaks(x), peaks(y)
            points[:, :2] = np.stack([columns, rows], -1) / self.ratio / self.size * part[2:] + part[:2]
            points[:, 2] = np.minimum(a, b)
        return result

    def _cut(self, image: UInt8[np.ndarray, "H W 3"], part: Float[np.ndarray, "4"]) -> Float32[np.ndarray, "h w 3"]:
        scale = self.size[0] / part[2]
        to_input = np.array([[scale, 0, -part[0] * scale], [0, scale, -part[1] * scale]])
        return (cv2.warpAffine(image, to_input, self.size, flags=cv2.INTER_LINEAR) - _MEAN) / _DEVIATION


def recognises(model: OnnxModel) -> bool:
    """Whether a model finds points of the whole body by SimCC."""
    shapes = [output.shape for output in model.outputs]
    return len(shapes) == 2 and all(len(shape) == 3 and shape[1] in (WHOLEBODY_COUNT, None) for shape in shapes)


def wrong_model(model: OnnxModel) -> InputError:
    """Why another model cannot be used."""
    return InputError(
        f"{model.path}: is {what_it_is(model)}. Expected a whole-body model of the RTMPose, DWPose or RTMW family: two "
        f"outputs, simcc_x and simcc_y, of {WHOLEBODY_COUNT} points each (COCO-WholeBody)."
    )


def region(box: Float[np.ndarray, "4"], size: tuple[int, int]) -> Float[np.ndarray, "4"]:
    """The part of the image that a model of this input size sees for a box: left, top, width, height in pixels.

    The box with PADDING, widened or heightened about its centre to the input's aspect ratio.
    """
    centre, extent = (box[:2] + box[2:]) / 2, np.maximum(box[2:] - box[:2], 1.0) * PADDING
    aspect = size[0] / size[1]
    width = max(extent[0], extent[1] * aspect)
    extent = np.array([width, width / aspect])
    return np.concatenate([centre - extent / 2, extent])


def peaks(bins: Float[np.ndarray, "K n"]) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]:
    """Where each row is highest, in bins, and how high above its median.

    The place is the vertex of the parabola through the highest bin and its two neighbours, half a bin away at most. A
    bin is half a pixel of the input, which for a person of 1000 pixels height is 2 pixels of the image.
    """
    bins = bins.astype(float)
    highest = bins.argmax(1)
    middle = np.clip(highest, 1, bins.shape[1] - 2)
    around = np.take_along_axis(bins, middle[:, None] + np.arange(-1, 2), 1)
    slope, bend = (around[:, 2] - around[:, 0]) / 2, around[:, 0] - 2 * around[:, 1] + around[:, 2]
    shift = np.where((bend < 0) & (middle == highest), -slope / np.minimum(bend, -1e-12), 0.0)
    return highest + np.clip(shift, -0.5, 0.5), bins.max(1) - np.median(bins, 1)


def peak_confidence(heights: Float[np.ndarray, "*n"], *, highest: float | None = None) -> Float[np.ndarray, "*n"]:
    """Confidences, 0 to 1, of peaks' heights.

    Args:
        heights: Of the peaks.
        highest: The largest in the clip, or as much of it as is known; None: these are all.
    """
    if highest is None:
        highest = float(heights.max(initial=0.0))
    return np.clip(heights / _SCALES[int(highest > _HIGH)], 0.0, 1.0)
