"""Working memory of a kernel: one record of fixed size, and rows for the points of a fit."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from fitting_core.fit.compiled.layout import MOST_COLUMNS, MOST_HAND, MOST_LATENT, N_BODY, N_COEFFICIENTS, N_JOINTS
from fitting_core.fit.fused.constants import Constants

MOST_LAYERS, WIDEST = 6, 512
"""Of a network."""
LANES = 8
"""Sums run over a multiple of this many numbers, zero-padded: a remainder would take as long as the rest."""
_F = np.float64

FRAME = np.dtype(
    [
        ("value", _F, (MOST_LAYERS + 1, WIDEST)),
        ("slope", _F, (MOST_LAYERS, WIDEST)),
        ("rows", np.float32, (2, MOST_LATENT, WIDEST + 16)),  # rows 2 kB apart would share their places in the cache
        ("slope32", np.float32, WIDEST),
        ("turning", np.float32, (3 * N_BODY, WIDEST + 16)),
        ("turns", np.float32, (MOST_LATENT, 3 * N_BODY)),
        ("sixes", _F, (N_BODY, 3, 6)),
        ("by_latent", _F, (MOST_LATENT, 64)),
        ("turned_at", _F, MOST_LATENT),  # the latent that `by_latent` belongs to
        ("local", _F, (N_JOINTS, 3, 3)),
        ("chart", _F, (N_JOINTS, 3, 3)),
        ("world", _F, (N_JOINTS, 3, 3)),
        ("axes", _F, (N_JOINTS, 3, 3)),
        ("rest", _F, (N_JOINTS, 3)),
        ("joints", _F, (N_JOINTS, 3)),
        ("offset", _F, (N_JOINTS, 3)),
        ("coefficients", _F, N_COEFFICIENTS),
        ("joint_motion", _F, (N_JOINTS, 3, N_COEFFICIENTS)),
        ("offset_motion", _F, (N_JOINTS, 3, N_COEFFICIENTS)),
        ("turning_by", _F, (N_JOINTS, 3, MOST_COLUMNS)),
        ("features", _F, 9 * N_JOINTS),
        ("by_feature", _F, 9 * N_JOINTS),
        ("by_point", _F, (3, 3)),  # derivative of weighted residuals by a point in camera space
        ("residual", _F, 3),  # these residuals
        ("q", _F, 4),
        ("u", _F, 4),
        ("v", _F, 3),
        ("m", _F, (3, 3)),
        ("wide", _F, MOST_HAND),
        ("gradient", _F, MOST_COLUMNS),
        ("matrix", _F, (MOST_COLUMNS, MOST_COLUMNS)),
        ("by_body", _F, (MOST_COLUMNS, 64)),
        ("small", _F, (MOST_COLUMNS, MOST_COLUMNS)),
        ("three", _F, (3, MOST_COLUMNS)),
        ("chained", _F, (MOST_COLUMNS, MOST_LATENT)),
        ("transposed", _F, (MOST_LATENT, 64)),
        ("state_gradient", _F, MOST_COLUMNS),
        ("state_matrix", _F, (MOST_COLUMNS, MOST_COLUMNS)),
        ("free_gradient", _F, MOST_COLUMNS),
        ("free_matrix", _F, (MOST_COLUMNS, MOST_COLUMNS)),
        ("factor", _F, (MOST_COLUMNS, MOST_COLUMNS + 1)),
        ("move", _F, MOST_COLUMNS),
        ("trial_orient", _F, (3, 3)),
        ("trial", _F, MOST_COLUMNS),
    ]
)
"""Of one frame."""


class Scratch(NamedTuple):
    """Used by one thread at a time."""

    frame: np.record
    """FRAME."""
    pairs: Float[np.ndarray, "P 3"]
    weight: Float[np.ndarray, "P"]
    pair_motion: Float[np.ndarray, "P 3 20"]
    pair_gradient: Float[np.ndarray, "P 3"]
    """Gradient of the terms on points, by each pair's position in camera space."""
    points: Float[np.ndarray, "N 3"]
    """In camera space."""
    error: Float[np.ndarray, "N 8"]
    """Pixels; metres from a known position relative to the pelvis; metres from the held position."""
    rows: Float[np.ndarray, "columns 8N"]


def scratch_for(constants: Constants) -> Scratch:
    """Sized for these constants."""
    pairs = sum(table.pair.shape[1] for table in constants.tables)
    points = len(constants.points)
    frame = np.zeros(1, FRAME).view(np.recarray)[0]
    frame["local"][:] = frame["chart"][:] = np.eye(3)
    return Scratch(
        frame=frame,
        pairs=np.zeros((pairs, 3)),
        weight=np.zeros(pairs),
        pair_motion=np.zeros((pairs, 3, N_COEFFICIENTS)),
        pair_gradient=np.zeros((pairs, 3)),
        points=np.zeros((points, 3)),
        error=np.zeros((points, 8)),
        rows=np.zeros((MOST_COLUMNS, 8 * points + LANES)),
    )
