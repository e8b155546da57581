"""Where to look for a person without a box model: around the points of the frame before."""

import numpy as np
from jaxtyping import Float

from fitting_core.detect.topdown import simcc

SURE = 0.3
"""Points of lower confidence say nothing about where the person is."""
_FEWEST_SURE = 6
"""With fewer sure points a person is lost, and looked for in the whole frame again."""


def box_around(
    points: Float[np.ndarray, "133 3"], highest: float, size: tuple[int, int]
) -> Float[np.ndarray, "4"] | None:
    """The box in which to look for a person in the next frame; None if the person is lost.

    Args:
        points: Of this frame, as `SimCC.points` gives them.
        highest: Height of the highest peak of a point in all frames so far.
        size: Of the image.
    """
    confidence = simcc.confidence(points[:, 2], highest=max(highest, points[:, 2].max()))
    inside = ((points[:, :2] >= 0) & (points[:, :2] < size)).all(1)
    sure = points[(confidence >= SURE) & inside, :2]
    if len(sure) < _FEWEST_SURE:
        return None
    box = np.concatenate([sure.min(0), sure.max(0)])
    return box if (box[2:] - box[:2] > 1).all() else None


def whole(size: tuple[int, int]) -> Float[np.ndarray, "4"]:
    """The image as a box."""
    return np.array([0.0, 0.0, size[0], size[1]])
