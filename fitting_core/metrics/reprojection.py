"""How far projected points lie from where they were seen."""

import numpy as np
from jaxtyping import Bool, Float


def reprojection_errors(
    projected: Float[np.ndarray, "T K 2"],
    detected: Float[np.ndarray, "T K 2"],
    counted: Bool[np.ndarray, "T K"],
) -> Float[np.ndarray, "N"]:
    """Distances in pixels between projected and detected keypoints, of those that count."""
    return np.linalg.norm(projected - detected, axis=-1)[counted]


def heights_in_image(points: Float[np.ndarray, "T K 2"], counted: Bool[np.ndarray, "T K"]) -> Float[np.ndarray, "T"]:
    """How long the person is in each image: the longer side of the box around the points that count, pixels.

    NaN where fewer than two count. Not the height alone: who sits or lies down comes no nearer to the camera.
    """
    low = np.where(counted[..., None], points, np.inf).min(1)
    high = np.where(counted[..., None], points, -np.inf).max(1)
    return np.where(counted.sum(1) > 1, (high - low).max(1), np.nan)


def frame_means(
    projected: Float[np.ndarray, "T K 2"], seen: Float[np.ndarray, "T K 2"], counted: Bool[np.ndarray, "T K"]
) -> Float[np.ndarray, "T"]:
    """Mean reprojection error of each frame in pixels; NaN where no point counts."""
    errors = np.where(counted, np.linalg.norm(np.where(counted[..., None], projected - seen, 0), axis=-1), 0)
    number = counted.sum(1)
    return np.where(number > 0, errors.sum(1) / np.maximum(number, 1), np.nan)
