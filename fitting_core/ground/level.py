"""How a camera is held: what turns its space upright, and puts the floor at height 0."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.ground.grounding import Grounding

SURE = 10.0
"""Degrees of standard deviation up to which gravity alone turns a world upright."""
_STEEP = 0.95
"""Cosine to gravity from which the camera looks so steeply that the image's upper edge says what is ahead."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """From camera space to that of a camera at the same place that looks at the horizon."""

    turn: Float[np.ndarray, "3 3"]
    """x_level = turn @ x_camera; x right, y along gravity, z ahead."""
    height: float | None
    """Metres that the camera is above the floor; None where the floor is not known."""
    text: str
    """For the files that are upright by it."""


def level_of(grounding: Grounding | None) -> Level | None:
    """What is sure enough to turn a motion by: the floor, or gravity to 10 degrees; else None."""
    if grounding is None or (grounding.ground is None and grounding.gravity.deviation >= SURE):
        return None
    gravity, ground = grounding.gravity, grounding.ground
    return Level(turn=upright(gravity.up), height=None if ground is None else ground.offset, text=grounding.text)


def upright(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The turn of camera space by which up becomes -y, and what is ahead stays ahead."""
    ahead = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < _STEEP else np.array([0.0, np.sign(up[2]), 0.0])
    down = -up / np.linalg.norm(up)
    forward = ahead - (ahead @ down) * down
    forward /= np.linalg.norm(forward)
    return np.stack([np.cross(down, forward), down, forward])
