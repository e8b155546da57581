"""Postures of the left hand that fingerspelling and gestures need, as anatomical angles (see hand_skeleton.py).

Recorded hands are mostly open. Manual alphabets want every finger straight, bent or curled by itself, and the thumb
wherever a thumb goes. So postures are drawn at random from what each finger does.
"""

import numpy as np
from jaxtyping import Float

from fitting_core.body.hand_skeleton import FINGERS, FLEXION, SPREAD, TWIST

_LONG = ("index", "middle", "ring", "pinky")
_BENDS = {
    "straight": (0.36, (0, 5, 3)),
    "curled": (0.36, (82, 100, 60)),
    "round": (0.10, (42, 45, 28)),
    "hooked": (0.09, (8, 95, 55)),
    "knuckle": (0.09, (80, 8, 5)),
}
"""Share, and degrees of flexion of the three joints, of what a finger does."""
_ALIKE = ((0.30, 0), (0.20, 1), (0.15, 2))
"""Share of hands in which all fingers from this one on do the same."""
_CURLED_TWIST = (8.0, 1.0, -5.0, -16.0)
"""Degrees at the knuckle of a curled finger, near those of the recorded fists: tips close towards the palm's middle."""
_CLOSED, _FAN = np.array([2.0, 0.0, 0.0, -2.0]), np.array([-13.0, -2.5, 9.0, 20.0])
"""Degrees of spread of straight fingers side by side, and of an open hand."""
_FANNED = 0.4
"""Share of hands that spread between these two; in the others every finger goes where it can."""
_SPREAD_RANGES = np.array([(-13.0, 8.0), (-11.0, 9.0), (-9.0, 11.0), (-6.0, 22.0)])
_THUMBS = (
    ((12, 0, -3), (14, 0), (15, 0)),  # at ease
    ((28, -9, -7), (7, 0), (4, 0)),  # beside the index finger
    ((-17, -1, 10), (-5, 0), (-4, 0)),  # out
    ((-14, -22, 0), (-8, 0), (-12, 0)),  # up
    ((12, 34, 0), (4, 0), (6, 0)),  # before the palm
    ((39, 27, 10), (38, 8), (49, 0)),  # across a fist
    ((35, -2, 5), (43, 0), (46, 0)),  # folded on the palm
    ((32, 22, 1), (7, 0), (-18, 0)),  # on the tip of the index finger
    ((46, 26, -3), (12, 0), (-17, 0)),  # of the middle finger
    ((53, 27, -3), (20, 0), (-10, 0)),  # of the ring finger
    ((56, -16, -15), (41, 0), (26, 0)),  # of the little finger
)
"""Degrees of flexion, spread (and twist) of the three joints, those on fingertips by inverse kinematics on the body."""
_BETWEEN = 1 / 3
"""Share of thumbs that stand between two of these."""
_SCATTER = 5.0
"""Degrees, of most angles."""


def postures(count: int, random: np.random.Generator) -> Float[np.ndarray, "n 45"]:
    """So many postures, radians."""
    return np.radians(np.stack([_posture(random).ravel() for _ in range(count)]))


def _posture(random: np.random.Generator) -> Float[np.ndarray, "5 3 3"]:
    angles = np.zeros((len(FINGERS), 3, 3))
    bends, spread = _finger_bends(random), _spread(random)
    for i, finger in enumerate(_LONG):
        joints = angles[FINGERS.index(finger)]
        together, against = random.normal(0, _SCATTER, 2)
        joints[:, FLEXION] = _BENDS[bends[i]][1]
        joints[:, FLEXION] += together * np.array([1, 1, 0.6]) + 0.7 * against * np.array([1, -1, -0.6])
        joints[0, SPREAD] = spread[i]
        if bends[i] == "curled":
            joints[0, SPREAD] = random.normal(0, 0.6 * _SCATTER)
            joints[0, TWIST] = _CURLED_TWIST[i] + random.normal(0, 0.8 * _SCATTER)
    angles[FINGERS.index("thumb")] = _thumb(random)
    return angles


def _finger_bends(random: np.random.Generator) -> list[str]:
    bends = list(random.choice(list(_BENDS), len(_LONG), p=[share for share, _ in _BENDS.values()]))
    shares = [share for share, _ in _ALIKE]
    first = random.choice([*(first for _, first in _ALIKE), len(_LONG) - 1], p=[*shares, 1 - sum(shares)])
    return bends[:first] + [bends[first]] * (len(_LONG) - first)


def _spread(random: np.random.Generator) -> Float[np.ndarray, "4"]:
    if random.random() < _FANNED:
        return _CLOSED + (_FAN - _CLOSED) * random.random()
    return random.uniform(*_SPREAD_RANGES.T)


def _thumb(random: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    one, other = (_THUMBS[k] for k in random.choice(len(_THUMBS), 2, replace=False))
    share = random.random() if random.random() < _BETWEEN else 0.0
    angles = np.zeros((3, 3))
    for k in range(3):
        angles[k, : len(one[k])] = (1 - share) * np.array(one[k]) + share * np.array(other[k])
    angles[:, FLEXION] += random.normal(0, _SCATTER, 3)
    angles[0, SPREAD] += random.normal(0, _SCATTER)
    return angles
