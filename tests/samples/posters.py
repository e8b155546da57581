"""Pixels of what is drawn on posters."""

import numpy as np
from jaxtyping import Float


def pixels_of_world(
    world: Float[np.ndarray, "*n 2"], size: tuple[int, int], x: float = 0.0
) -> Float[np.ndarray, "*n 2"]:
    """Pixels of places on a poster whose middle is at x: `world_of_pixels` backwards."""
    return (world - np.array([x, 0.0])) * size[1] + np.array(size) / 2
