"""Facial expressions by what they do to the face, whatever a body's expression components are."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import BodyModel

# Among the 51 inner landmarks, right ones of the person first.
_BROWS = range(10)
_UPPER_LIDS, _LOWER_LIDS = (20, 21, 26, 27), (23, 24, 29, 30)
_RIGHT_CORNER, _LEFT_CORNER = 31, 37

GESTURES: dict[str, dict[int, tuple[float, float, float]]] = {
    "blink": {k: (0.0, -8.0, 0.0) for k in _UPPER_LIDS} | {k: (0.0, 1.0, 0.0) for k in _LOWER_LIDS},
    "smile": {_RIGHT_CORNER: (-6.0, 5.0, -2.0), _LEFT_CORNER: (6.0, 5.0, -2.0)},
    "raised_brows": {k: (0.0, 4.0, 0.0) for k in _BROWS},
    "lowered_brows": {k: (0.0, -3.0, 0.0) for k in _BROWS},
}
"""Millimetres by which landmarks move (x to the person's left, y up, z forward); the others should stay."""
_RIDGE_MM = 1.0
"""Weight of one unit of a component against one millimetre at one landmark; holds components near 0."""


def expression_of(body: BodyModel, gesture: str) -> Float[np.ndarray, "10"]:
    """Expression coefficients that come closest to a gesture of GESTURES at full strength, by least squares.

    Bodies order and mix their expression components as they like, so coefficients mean nothing across bodies.
    """
    wanted = np.zeros((len(body.landmark_vertices), 3))
    for landmark, move in GESTURES[gesture].items():
        wanted[landmark] = move
    moves = body.expression_directions[body.landmark_vertices] * body.landmark_weights[..., None, None]
    by_component = 1000 * moves.sum(1).reshape(-1, moves.shape[-1])
    ridge = _RIDGE_MM**2 * np.eye(moves.shape[-1])
    return np.linalg.solve(by_component.T @ by_component + ridge, by_component.T @ wanted.reshape(-1))


def expressions(body: BodyModel, strengths: Mapping[str, Float[np.ndarray, "T"]]) -> Float[np.ndarray, "T 10"]:
    """Sum of gestures, each with its strength over time (0 to 1)."""
    return sum((strength[:, None] * expression_of(body, name) for name, strength in strengths.items()), np.zeros(10))
