"""What should stay the same over a clip, and by how much it does not."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


def bone_length_variation(points: Float[np.ndarray, "T K 3"], bones: Sequence[tuple[int, int]]) -> float:
    """Standard deviation of the bones' lengths over the frames as a share of their mean lengths, mean of the bones.

    Args:
        points: Metres.
        bones: Pairs of points; those of no length do not count.
    """
    ends = np.array(bones)
    lengths = np.linalg.norm(points[:, ends[:, 0]] - points[:, ends[:, 1]], axis=-1)
    means = lengths.mean(0)
    long = means > 1e-6
    return float((lengths.std(0)[long] / means[long]).mean()) if long.any() else 0.0


def shape_variation(betas: Float[np.ndarray, "T 10"]) -> float:
    """Standard deviation of the shape coefficients over the frames, mean of the coefficients."""
    return float(betas.std(0).mean())
