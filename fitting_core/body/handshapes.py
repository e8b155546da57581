"""Handshapes as angles of the finger joints."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.body.geometry import MIRROR_ROTATION
from fitting_core.keypoints import FINGERS, Side


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
    aside: tuple[float, float, float, float] = (0, 0, 0, 0)
    """How far index, middle, ring and little finger lean towards the little finger's side by themselves."""
    thumb: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
    """Axis-angle of the left thumb's three joints."""


_CURLED, _STRAIGHT = (82, 100, 60), (2, 4, 3)
_FIST_THUMB = ((38, 26, -16), (16, 34, -14), (14, 46, -16))
_OUT_THUMB = ((0, -18, 8), (0, -5, 0), (0, -4, 0))
HANDSHAPES = {
    "relaxed": Handshape(
        index=(18, 24, 14), middle=(22, 28, 16), ring=(26, 30, 18), pinky=(28, 30, 18),
        spread=1, thumb=((3, 12, -4), (4, 14, -2), (6, 16, -2)),
    ),
    "flat": Handshape(spread=-3, thumb=((0, 30, 0), (0, 8, 0), (0, 4, 0))),
    "spread": Handshape(
        index=(0, 5, 3), middle=(0, 5, 3), ring=(0, 5, 3), pinky=(0, 5, 3), spread=13, thumb=_OUT_THUMB,
    ),
    "fist": Handshape(
        index=_CURLED, middle=_CURLED, ring=_CURLED, pinky=_CURLED, converge=8, thumb=_FIST_THUMB,
    ),
    "point": Handshape(
        index=_STRAIGHT, middle=_CURLED, ring=_CURLED, pinky=_CURLED, converge=8, thumb=_FIST_THUMB,
    ),
    "pinch": Handshape(
        index=(46, 46, 26), middle=(15, 18, 10), ring=(12, 15, 8), pinky=(10, 12, 8),
        thumb=((26, 22, -18), (3, 7, -1), (-7, -16, 1)),
    ),
    "victory": Handshape(
        index=_STRAIGHT, middle=_STRAIGHT, ring=_CURLED, pinky=_CURLED, converge=8, aside=(-10, 9, 0, 0),
        thumb=((30, 22, -18), (19, 38, -7), (20, 49, -4)),
    ),
    "thumb up": Handshape(
        index=_CURLED, middle=_CURLED, ring=_CURLED, pinky=_CURLED, converge=8,
        thumb=((-12, -8, 14), (-3, -6, 1), (-4, -9, 1)),
    ),
    "L": Handshape(index=_STRAIGHT, middle=_CURLED, ring=_CURLED, pinky=_CURLED, converge=8, thumb=_OUT_THUMB),
    "Y": Handshape(
        index=_CURLED, middle=_CURLED, ring=_CURLED, pinky=_STRAIGHT, converge=8, aside=(0, 0, 0, 18), thumb=_OUT_THUMB,
    ),
    "I love you": Handshape(
        index=_STRAIGHT, middle=_CURLED, ring=_CURLED, pinky=_STRAIGHT, converge=8, aside=(-5, 0, 0, 12),
        thumb=_OUT_THUMB,
    ),
    "horns": Handshape(
        index=_STRAIGHT, middle=_CURLED, ring=_CURLED, pinky=_STRAIGHT, converge=8, thumb=_FIST_THUMB,
    ),
    "C": Handshape(
        index=(34, 42, 26), middle=(38, 44, 28), ring=(40, 46, 28), pinky=(40, 46, 28),
        thumb=((30, 12, -30), (4, 9, -2), (-2, -4, 0)),
    ),
    "O": Handshape(
        index=(48, 50, 30), middle=(54, 53, 31), ring=(55, 52, 30), pinky=(55, 50, 30),
        thumb=((30, 37, -24), (4, 10, -1), (-7, -17, 1)),
    ),
    "crossed": Handshape(
        index=_STRAIGHT, middle=(14, 16, 8), ring=_CURLED, pinky=_CURLED, converge=8, aside=(8, -12, 0, 0),
        thumb=((30, 22, -18), (19, 38, -7), (20, 49, -4)),
    ),
    "hook": Handshape(
        index=(6, 85, 45), middle=_CURLED, ring=_CURLED, pinky=_CURLED, converge=8, thumb=_FIST_THUMB,
    ),
    "three": Handshape(
        index=_STRAIGHT, middle=_STRAIGHT, ring=_CURLED, pinky=_CURLED, converge=8, aside=(-10, 9, 0, 0),
        thumb=_OUT_THUMB,
    ),
    "four": Handshape(spread=8, thumb=((16, 32, 2), (16, 40, -3), (17, 42, -3))),
    "W": Handshape(
        pinky=(80, 86, 56), aside=(-12, 0, 12, 0), thumb=((5, 59, 4), (15, 38, -2), (12, 29, -2)),
    ),
    "bent": Handshape(
        index=(75, 12, 6), middle=(78, 12, 6), ring=(78, 12, 6), pinky=(75, 12, 6),
        thumb=((0, 30, 0), (3, 8, 0), (2, 6, 0)),
    ),
    "claw": Handshape(
        index=(12, 65, 40), middle=(12, 70, 40), ring=(12, 70, 40), pinky=(12, 65, 40), spread=8,
        thumb=((18, 0, -16), (4, 10, -1), (8, 20, -1)),
    ),
    "flat O": Handshape(
        index=(60, 20, 10), middle=(75, 32, 13), ring=(62, 25, 12), pinky=(58, 25, 12),
        thumb=((42, 30, -30), (4, 7, -2), (-7, -16, 1)),
    ),
}  # fmt: skip
"""By name: the handshapes that signs, fingerspelling and gestures use most. Where the thumb meets a finger it was
placed there by inverse kinematics on the free body."""

_LONG = ("index", "middle", "ring", "pinky")
_STEPS = {"index": 1.0, "middle": 0.2, "ring": -0.7, "pinky": -1.7}
_YAW = {"index": 6.0, "middle": 0.0, "ring": -5.0, "pinky": -11.0}
"""Degrees from straight ahead to the thumb's side in the rest pose: a finger curls about its own hinge, across it."""


def finger_angles(shape: Handshape, side: Side) -> Float[np.ndarray, "15 3"]:
    """Axis-angle (radians) of the 15 finger joints of a hand in SMPL-X's order, relative to the rest pose."""
    angles = np.zeros((5, 3, 3))
    for i, finger in enumerate(FINGERS[:4]):
        cosine, sine = np.cos(np.radians(_YAW[finger])), np.sin(np.radians(_YAW[finger]))
        angles[i] = np.outer(getattr(shape, finger), [sine, 0, -cosine])
        angles[i, 0] += shape.converge * _STEPS[finger] * np.array([cosine, 0, sine])
        angles[i, 0, 1] = shape.aside[_LONG.index(finger)] - shape.spread * _STEPS[finger]
    angles[4] = shape.thumb
    return in_hand(np.radians(angles.reshape(15, 3)), side)


def in_hand(angles: Float[np.ndarray, "*b 15 3"], side: Side) -> Float[np.ndarray, "*b 15 3"]:
    """Angles of a left hand's finger joints in the hand of this side, and of this side's in a left hand."""
    return angles * (1.0 if side == "left" else MIRROR_ROTATION)
