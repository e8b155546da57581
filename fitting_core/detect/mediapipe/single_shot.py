"""MediaPipe's single-shot detectors of people, palms and faces (Bazarevsky et al. 2019, arXiv:1907.05047).

Each cell of a coarse grid has anchors, at its middle, that say how likely something lies there, its box and some
points of it. What overlaps is averaged by score instead of suppressed, which steadies it from frame to frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from fitting_core.detect.mediapipe.networks import Network
from fitting_core.detect.mediapipe.squares import Image, Square, picture
from fitting_core.detect.topdown.boxes import intersection_over_union

_OVERLAP = 0.3
"""Intersection over union above which two boxes are one detection."""


@dataclass(frozen=True, kw_only=True)
class _Kind:
    network: str
    strides: tuple[int, ...]
    """Pixels of the picture for each cell of its layers."""
    lowest: float
    """The network's input for a black pixel; a white one is 1."""
    threshold: float
    """Score from which something is found."""


_KINDS = {
    "person": _Kind(network="pose_detection", strides=(8, 16, 32, 32, 32), lowest=-1.0, threshold=0.5),
    "palm": _Kind(network="palm_detection_full", strides=(8, 16, 16, 16), lowest=0.0, threshold=0.4),
    "face": _Kind(network="face_detection_short_range", strides=(8, 16, 16, 16), lowest=-1.0, threshold=0.5),
}
_ANCHORS = 2
"""Of each layer in a cell."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """A person, a palm or a face."""

    score: float
    box: Float[np.ndarray, "4"]
    """Left, top, right, bottom; pixels of the image."""
    points: Float[np.ndarray, "n 2"]
    """Pixels of the image. Of a person: the middle of the hips, then one on the circle around the body. Of a palm: the
    wrist first, the middle finger's knuckle third. Of a face: right and left eye first."""


class SingleShot:
    """A detector of "person", "palm" or "face"."""

    def __init__(self, kind: str, *, threads: int = 1) -> None:
        self._kind = _KINDS[kind]
        self._network = Network(self._kind.network, threads=threads)
        self._anchors = anchors(self._network.size, self._kind.strides)

    def find(self, image: Image, square: Square | None = None, *, threshold: float | None = None) -> list[Found]:
        """What an RGB image, or a square of it, shows; most certain first.

        Args:
            image: RGB.
            square: Where to look; None: everywhere.
            threshold: Least score; None: the detector's own.
        """
        if square is None:
            square = Square(image.shape[1] / 2, image.shape[0] / 2, max(image.shape[:2]))
        size, low = self._network.size, self._kind.lowest
        shown = picture(image, square, size, border=cv2.BORDER_CONSTANT) * np.float32(1 - low) + np.float32(low)
        first, second = self._network(shown[None])
        numbers, logits = (first[0], second[0, :, 0]) if first.shape[2] > 1 else (second[0], first[0, :, 0])
        scores = 1 / (1 + np.exp(-np.clip(logits.astype(float), -100, 100)))
        sure = np.flatnonzero(scores >= (self._kind.threshold if threshold is None else threshold))
        pairs = numbers[sure].reshape(len(sure), numbers.shape[1] // 2, 2).astype(float)
        centres, sizes = pairs[:, 0] + self._anchors[sure], pairs[:, 1]
        boxes = np.concatenate([centres - sizes / 2, centres + sizes / 2], 1)
        points = pairs[:, 2:] + self._anchors[sure][:, None]
        found = []
        for score, box, own in _merged(scores[sure], boxes, points):
            corners = square.to_image(box.reshape(2, 2), size)
            upright = np.concatenate([corners.min(0), corners.max(0)])
            found.append(Found(score=score, box=upright, points=square.to_image(own, size)))
        return found


def anchors(size: int, strides: tuple[int, ...]) -> Float[np.ndarray, "n 2"]:
    """Middles of the cells for each anchor, layers of one stride together; pixels of the network's picture."""
    found = []
    for stride in sorted(set(strides)):
        middles = (np.arange(size // stride) + 0.5) * stride
        cells = np.stack(np.meshgrid(middles, middles), -1).reshape(-1, 2)
        found.append(np.repeat(cells, _ANCHORS * strides.count(stride), 0))
    return np.concatenate(found)


def _merged(
    scores: Float[np.ndarray, "n"], boxes: Float[np.ndarray, "n 4"], points: Float[np.ndarray, "n k 2"]
) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Best score, mean box and mean points of each group that overlaps its best one."""
    left = np.argsort(-scores, kind="stable")
    while len(left):
        best = left[0]
        mine = intersection_over_union(boxes[best], boxes[left]) > _OVERLAP
        mine[0] = True
        group, left = left[mine], left[~mine]
        weights = scores[group] / scores[group].sum()
        yield float(scores[best]), weights @ boxes[group], np.tensordot(weights, points[group], 1)
