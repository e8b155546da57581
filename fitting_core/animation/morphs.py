"""Everything that deforms a rest pose's surface over time, as a few morph targets with a weight in each frame.

Skinned meshes of other programs know no pose correctives, and linear skinning alone is up to 63 mm off the fit without
them (149 frames of sign language, free body). Over one motion they lie near a space of few dimensions: 32 to 64 shapes
leave less than half a millimetre.

All weights lie between 0 and 1: Blender 4.2 widens a shape's range by its first key alone and cuts later ones off, by
1.6 mm in one clip. So an expression has two shapes where it goes both ways, and the correctives are counted from their
lowest values, which one more shape of constant weight holds.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse import csr_array, issparse

from fitting_core.body import rotations
from fitting_core.motion import CHUNK, Motion

MOST = 64
"""Maximum number of correctives in a file: each takes 160 kB."""
_GOAL = 0.0005
"""Metres: correctives are added until every vertex of the rest pose is this near."""
_COUNTS = (0, 4, 8, 12, 16, 24, 32, 40, 48, 56)
"""Numbers of correctives that are tried before `MOST`."""
_TRIED = 256
"""Frames on which they are tried, spread over the motion."""
_RANK = 1e-10
"""Directions with a smaller share of the greatest variance are dropped."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Morphs:
    """K shapes that are added to the rest pose, times their weights."""

    names: tuple[str, ...]
    directions: Float[np.ndarray, "K V 3"]
    """Metres, single precision."""
    weights: Float[np.ndarray, "T K"]
    """0 to 1, single precision."""
    units: tuple[float, ...]
    """Size of a weight of 1; for an expression, in units of its component."""


def expression_morphs(motion: Motion) -> Morphs:
    """The components of the expression that move this body, each way that the motion goes, and the positive one always.

    Their unit is that of SMPL-X, unless the motion goes beyond it.
    """
    directions, values = motion.body.expression_directions, motion.params.expression.numpy()
    names, shapes, weights, units = [], [], [], []
    for k in np.flatnonzero(abs(directions).max((0, 1)) > 0):
        for name, sign in ((f"expression_{k}", 1.0), (f"expression_{k}_negative", -1.0)):
            part = (sign * values[:, k]).clip(min=0)
            if sign > 0 or part.any():
                unit = max(1.0, float(part.max()))
                names.append(name)
                shapes.append(sign * unit * directions[..., k])
                weights.append(part / unit)
                units.append(unit)
    return Morphs(
        names=tuple(names),
        directions=np.array(shapes, np.float32).reshape(-1, *directions.shape[:2]),
        weights=np.array(weights, np.float32).reshape(-1, len(motion)).T,
        units=tuple(units),
    )


def corrective_morphs(motion: Motion) -> Morphs:
    """The principal components of the pose correctives over the motion, and the shape from which they are counted.

    With C the correctives (3 V, F) and f the features of all frames (T, F), the displacements are f C'. C is Q S P with
    orthonormal Q (3 V, r), so their components are those of f P' S: no matrix of all frames and vertices is needed.
    """
    features = _features(motion)
    table: Any = motion.body.pose_directions.astype(float)
    products = table.T @ table
    variance, axes = np.linalg.eigh(products.toarray() if issparse(products) else products)
    kept = variance > _RANK * max(variance.max(), 1e-30)
    scale = np.sqrt(variance[kept])
    left, size, right = np.linalg.svd(features @ (axes[:, kept] * scale), full_matrices=False)
    weights, to_shapes = left * size, (axes[:, kept] / scale) @ right.T
    count = _enough(table, weights, to_shapes, min(MOST, weights.shape[1]))
    shapes = np.asarray(table @ to_shapes[:, :count]).T.reshape(count, len(motion.body.template), 3)
    return _from_lowest(weights[:, :count], shapes)


def _from_lowest(weights: Float[np.ndarray, "T K"], shapes: Float[np.ndarray, "K V 3"]) -> Morphs:
    """Shapes with weights of any size as shapes with weights from 0 to 1."""
    lowest = weights.min(0)
    span = np.maximum(weights.max(0) - lowest, 1e-12)
    counted = Morphs(
        names=tuple(f"corrective_{k}" for k in range(len(shapes))),
        directions=(span[:, None, None] * shapes).astype(np.float32),
        weights=((weights - lowest) / span).astype(np.float32),
        units=(1.0,) * len(shapes),
    )
    if not len(shapes):
        return counted
    base = Morphs(
        names=("corrective_base",),
        directions=np.tensordot(lowest, shapes, 1)[None].astype(np.float32),
        weights=np.ones((len(weights), 1), np.float32),
        units=(1.0,),
    )
    return joined_morphs(base, counted)


def _features(motion: Motion) -> Float[np.ndarray, "T 486"]:
    local = rotations.exp(motion.pose[:, 1:])
    return (local - torch.eye(3, dtype=local.dtype)).flatten(1).numpy()


def _enough(table: csr_array | np.ndarray, weights: np.ndarray, to_shapes: np.ndarray, most: int) -> int:
    """How many components bring every vertex within the goal."""
    tried = weights[:: 1 + len(weights) // _TRIED]
    for count in _COUNTS:
        if count < most and _largest(table, to_shapes[:, count:] @ tried[:, count:].T) <= _GOAL:
            return count
    return most


def _largest(table: csr_array | np.ndarray, features: Float[np.ndarray, "486 T"]) -> float:
    """The longest displacement of any vertex in any frame, metres."""
    parts = [np.asarray(table @ features[:, t : t + CHUNK]) for t in range(0, features.shape[1], CHUNK)]
    return max(float(np.linalg.norm(part.reshape(-1, 3, part.shape[1]), axis=1).max()) for part in parts)


def joined_morphs(*morphs: Morphs) -> Morphs:
    """All of them, one after the other."""
    return Morphs(
        names=tuple(name for morph in morphs for name in morph.names),
        directions=np.concatenate([morph.directions for morph in morphs]),
        weights=np.concatenate([morph.weights for morph in morphs], 1),
        units=tuple(unit for morph in morphs for unit in morph.units),
    )
