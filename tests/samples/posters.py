"""Pixels of what is drawn on posters."""

import numpy as np
from jaxtyping import Float


def pixels_of_world(world: Float[np.ndarray, "*n 2"], size: tuple[int, int]) -> Float[np.ndarray, "*n 2"]:
    """Pixels of places on a poster: `world_of_pixels` backwards."""
    return world * size[1] + np.array(size) / 2
