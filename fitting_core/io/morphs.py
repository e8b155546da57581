"""What moves a rest pose's surface from frame to frame, as a few shapes with a weight in each frame.

Skinned meshes of other programs know no pose correctives, and linear skinning alone is up to 63 mm off the fit without
them (149 frames of sign language, free body). Over one motion they lie near a space of few dimensions: 32 to 64 shapes
leave less than half a millimetre.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse import csr_matrix

from fitting_core import rotations
from fitting_core.io.motion import CHUNK, Motion

MOST = 64
"""Correctives in a file, at most: each takes 160 kB."""
_GOAL = 0.0005
"""Metres: correctives are added until no vertex of the rest pose is farther off."""
_COUNTS = (0, 4, 8, 12, 16, 24, 32, 48)
"""Numbers of correctives that are tried before `MOST`."""
_TRIED = 256
"""Frames on which they are tried, evenly over the motion."""
_SPARSE = 0.3
"""Share of correctives that are not zero up to which a sparse product is the faster one (see the app's meshes.py)."""
_RANK = 1e-10
"""Directions with a smaller share of the greatest variance are none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Morphs:
    """K shapes that are added to the rest pose, times their weights."""

    names: tuple[str, ...]
    directions: Float[np.ndarray, "K V 3"]
    """Metres, single precision."""
    weights: Float[np.ndarray, "T K"]


def expression_morphs(motion: Motion) -> Morphs:
    """The components of the expression that move this body, with the fit's values as weights."""
    directions = motion.body.expression_directions
    moving = np.flatnonzero(abs(directions).max((0, 1)) > 0)
    return Morphs(
        names=tuple(f"expression_{k}" for k in moving),
        directions=np.ascontiguousarray(directions[..., moving].transpose(2, 0, 1), np.float32),
        weights=motion.params.expression.numpy()[:, moving].astype(np.float32),
    )


def corrective_morphs(motion: Motion, *, most: int = MOST) -> Morphs:
    """The principal components of the pose correctives over the motion, scaled to weights within -1 and 1.

    With C the correctives (3 V, F) and f the features of all frames (T, F), the displacements are f C'. C is Q S P with
    orthonormal Q (3 V, r), so their components are those of f P' S: no matrix of all frames and vertices is needed.
    """
    table, features = _table(motion), _features(motion)
    variance, axes = np.linalg.eigh(np.asarray(csr_matrix(table.T @ table).todense()))
    kept = variance > _RANK * max(variance.max(), 1e-30)
    scale = np.sqrt(variance[kept])
    left, size, right = np.linalg.svd(features @ (axes[:, kept] * scale), full_matrices=False)
    weights, to_shapes = left * size, (axes[:, kept] / scale) @ right.T
    count = _enough(table, weights, to_shapes, min(most, weights.shape[1]))
    weights, shapes = weights[:, :count], np.asarray(table @ to_shapes[:, :count])
    largest = np.maximum(abs(weights).max(0, initial=0.0), 1e-12)
    return Morphs(
        names=tuple(f"corrective_{k}" for k in range(count)),
        directions=(shapes * largest).T.reshape(count, len(motion.body.template), 3).astype(np.float32),
        weights=(weights / largest).astype(np.float32),
    )


def _table(motion: Motion) -> csr_matrix | Float[np.ndarray, "V*3 486"]:
    dense = motion.body.pose_directions.reshape(-1, motion.body.pose_directions.shape[-1]).astype(float)
    return csr_matrix(dense) if np.count_nonzero(dense) < _SPARSE * dense.size else dense


def _features(motion: Motion) -> Float[np.ndarray, "T 486"]:
    local = rotations.exp(motion.pose[:, 1:])
    return (local - torch.eye(3, dtype=local.dtype)).flatten(1).numpy()


def _enough(table: csr_matrix | np.ndarray, weights: np.ndarray, to_shapes: np.ndarray, most: int) -> int:
    """How many components bring every vertex within the goal."""
    tried = weights[:: 1 + len(weights) // _TRIED]
    for count in _COUNTS:
        if count < most and _largest(table, to_shapes[:, count:] @ tried[:, count:].T) <= _GOAL:
            return count
    return most


def _largest(table: csr_matrix | np.ndarray, features: Float[np.ndarray, "486 T"]) -> float:
    """The longest displacement of any vertex in any frame, metres."""
    parts = [np.asarray(table @ features[:, t : t + CHUNK]) for t in range(0, features.shape[1], CHUNK)]
    return max(float(np.linalg.norm(part.reshape(-1, 3, part.shape[1]), axis=1).max()) for part in parts)


def joined(*morphs: Morphs) -> Morphs:
    """All of them, one after the other."""
    return Morphs(
        names=tuple(name for morph in morphs for name in morph.names),
        directions=np.concatenate([morph.directions for morph in morphs]),
        weights=np.concatenate([morph.weights for morph in morphs], 1),
    )
