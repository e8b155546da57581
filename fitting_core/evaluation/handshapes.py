"""Handshapes as angles of the finger joints."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

FINGERS = ("index", "middle", "pinky", "ring", "thumb")
"""In SMPL-X's order."""
_MIRROR = np.array([1.0, -1.0, -1.0])
"""From the left hand's axis-angle to the right hand's."""


@dataclass(frozen=True, kw_only=True)
class Handshape:
    """Degrees. Curls are of the three joints of a finger from the knuckle outward; 0 is a straight finger."""

    index: tuple[float, float, float] = (5, 8, 5)
    middle: tuple[float, float, float] = (5, 8, 5)
    ring: tuple[float, float, float] = (5, 8, 5)
    pinky: tuple[float, float, float] = (5, 8, 5)
    spread: float = 0.0
    """Between neighbouring fingers."""
    converge: float = 0.0
    """How much a curled finger leans towards the middle one, again between neighbours: fists close."""
    thumb: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
    """Axis-angle of the left thumb's three joints."""


_CURLED = (82, 100, 60)
HANDSHAPES = {
    "relaxed": Handshape(
        index=(18, 24, 14), middle=(22, 28, 16), ring=(26, 30, 18), pinky=(28, 30, 18),
        spread=1, thumb=((3, 12, -4), (4, 14, -2), (6, 16, -2)),
    ),
    "flat": Handshape(spread=-3, thumb=((0, 30, 0), (0, 8, 0), (0, 4, 0))),
    "spread": Handshape(
        index=(0, 5, 3), middle=(0, 5, 3), ring=(0, 5, 3), pinky=(0, 5, 3),
        spread=13, thumb=((0, -18, 8), (0, -5, 0), (0, -4, 0)),
    ),
    "fist": Handshape(
        index=_CURLED, middle=_CURLED, ring=_CURLED, pinky=_CURLED,
        converge=14, thumb=((38, 26, -16), (16, 34, -14), (14, 46, -16)),
    ),
    "point": Handshape(
        index=(2, 4, 3), middle=_CURLED, ring=_CURLED, pinky=_CURLED,
        converge=14, thumb=((38, 26, -16), (16, 34, -14), (14, 46, -16)),
    ),
}  # fmt: skip
"""By name; the signs of a manual alphabet would go here."""

_STEPS = {"index": 1.0, "middle": 0.2, "ring": -0.7, "pinky": -1.7}


def finger_angles(shape: Handshape, side: str) -> Float[np.ndarray, "15 3"]:
    """Axis-angle (radians) of the 15 finger joints of a hand in SMPL-X's order, relative to the rest pose."""
    angles = np.zeros((5, 3, 3))
    for i, finger in enumerate(FINGERS[:4]):
        angles[i, :, 2] = -np.array(getattr(shape, finger))
        angles[i, 0, 0] = shape.converge * _STEPS[finger]
        angles[i, 0, 1] = -shape.spread * _STEPS[finger]
    angles[4] = shape.thumb
    return np.radians(angles.reshape(15, 3)) * (1.0 if side == "left" else _MIRROR)
