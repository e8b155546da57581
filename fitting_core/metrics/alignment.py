"""Points moved onto others, frame by frame: what a metric does not count is taken off first."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """x -> scale * rotation @ x + translation, one for each of T frames."""

    rotation: Float[np.ndarray, "T 3 3"]
    translation: Float[np.ndarray, "T 3"]
    scale: Float[np.ndarray, "T"]

    def __call__(self, points: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T K 3"]:
        """The points of each frame, moved by that frame's transformation."""
        turned = points @ self.rotation.transpose(0, 2, 1)
        return self.scale[:, None, None] * turned + self.translation[:, None]


def similarity(
    source: Float[np.ndarray, "T K 3"], target: Float[np.ndarray, "T K 3"], *, scaled: bool = True
) -> Similarity:
    """The transformation of each frame that brings `source` nearest to `target`.

    Least squares by singular values; S. Umeyama, PAMI 13(4), 1991.

    Args:
        source: At least three points of each frame, not on one line.
        target: The same points elsewhere.
        scaled: Whether the size may change too; else the motion is rigid.
    """
    mean_source, mean_target = source.mean(1, keepdims=True), target.mean(1, keepdims=True)
    a, b = source - mean_source, target - mean_target
    u, s, vt = np.linalg.svd(np.einsum("tki,tkj->tij", a, b))
    sign = np.ones_like(s)
    sign[:, 2] = np.sign(np.linalg.det(u @ vt))
    rotation = np.einsum("tij,tj,tjk->tki", u, sign, vt)
    scale = (s * sign).sum(1) / (a * a).sum((1, 2)).clip(1e-12) if scaled else np.ones(len(source))
    moved = scale[:, None] * (rotation @ mean_source.transpose(0, 2, 1))[..., 0]
    return Similarity(rotation=rotation, translation=mean_target[:, 0] - moved, scale=scale)


def procrustes(source: Float[np.ndarray, "T K 3"], target: Float[np.ndarray, "T K 3"]) -> Float[np.ndarray, "T K 3"]:
    """`source` moved by the similarity (rotation, scale, translation) of each frame that is nearest to `target`."""
    return similarity(source, target)(source)


def rooted(points: Float[np.ndarray, "T K 3"], roots: list[int]) -> Float[np.ndarray, "T K 3"]:
    """Points counted from the middle of some of them, such as the pelvis."""
    return points - points[:, roots].mean(1, keepdims=True)
