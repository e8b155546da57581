"""Where the people of a scene walk: the ways by which one is taken for another."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

SECONDS = 7.0
EDGE = 6.0
"""Metres beside the middle at which nobody is in the image any more, whatever the depth here."""
_TURN_SECONDS = 0.3
"""How long somebody takes to change speed."""
_AT_ONCE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """Where one person goes on the floor, metres: x to the right in the image, z towards the camera."""

    x: Float[np.ndarray, "T"]
    z: Float[np.ndarray, "T"]


Scene = Callable[[np.random.Generator, Float[np.ndarray, "T"]], list[Way]]


def _along(times: np.ndarray, knots: list[tuple[float, float]]) -> Float[np.ndarray, "T"]:
    """Straight from (second, place) to the next, with corners that take time."""
    at, places = np.array(knots).T
    around = np.linspace(-1, 1, 9) * _TURN_SECONDS
    return np.mean([np.interp(times + shift, at, places) for shift in around], axis=0)


def _depths(rng: np.random.Generator, count: int) -> list[float]:
    """People a step or more apart in depth, in any order."""
    steps = np.concatenate([[0.0], np.cumsum(rng.uniform(0.35, 1.2, count - 1))])
    return list(rng.permutation(steps - steps.mean()))


def _walk(times: np.ndarray, middle: float, speed: float, z: float) -> Way:
    """Through the image at one speed, in its middle at a time."""
    return Way(x=speed * (times - middle), z=np.full(len(times), z))


def _stand(rng: np.random.Generator, times: np.ndarray, x: float, z: float) -> Way:
    sway = _along(times, [(t, x + rng.normal(0, 0.08)) for t in np.arange(0.0, SECONDS + 1, 1.5)])
    return Way(x=sway, z=np.full(len(times), z))


def crossing(rng: np.random.Generator, times: np.ndarray) -> list[Way]:
    """Two walk towards each other and past."""
    one, other = _depths(rng, 2)
    meet = SECONDS / 2 + rng.uniform(-0.8, 0.8)
    return [
        _walk(times, meet, rng.uniform(0.7, 1.5), one),
        _walk(times, meet + rng.uniform(-0.4, 0.4), -rng.uniform(0.7, 1.5), other),
    ]


def behind(rng: np.random.Generator, times: np.ndarray) -> list[Way]:
    """One stands, and another passes behind."""
    side = rng.choice([-1.0, 1.0])
    passes = _walk(times, SECONDS / 2, side * rng.uniform(0.6, 1.4), -rng.uniform(0.5, 1.2))
    return [_stand(rng, times, rng.uniform(-0.5, 0.5), 0.4), passes]


def meeting(rng: np.random.Generator, times: np.ndarray) -> list[Way]:
    """Two walk up to each other until one hides the other, stay, and go back the way they came."""
    one, other = _depths(rng, 2)
    begins, stays = rng.uniform(2.0, 2.8), rng.uniform(0.2, 1.2)

    def way(side: float, z: float) -> Way:
        far, near = side * rng.uniform(1.8, 2.8), side * rng.uniform(-0.05, 0.2)
        knots = [(0.0, far), (begins, near), (begins + stays, near), (2 * begins + stays, far)]
        return Way(x=_along(times, knots), z=np.full(len(times), z))

    return [way(-1.0, one), way(1.0, other)]


def overtaking(rng: np.random.Generator, times: np.ndarray) -> list[Way]:
    """Two go the same way, and the faster passes the slower."""
    one, other = _depths(rng, 2)
    side, slow = rng.choice([-1.0, 1.0]), rng.uniform(0.3, 0.6)
    fast = slow + rng.uniform(0.4, 0.9)
    return [
        _walk(times, SECONDS / 2, side * slow, one),
        _walk(times, SECONDS / 2 + rng.uniform(-0.5, 0.5), side * fast, other),
    ]


def _out_and_back(rng: np.random.Generator, times: np.ndarray, side: float, z: float, *, back_on: float) -> Way:
    """Out of the image on one side, and in again on one."""
    speed = rng.uniform(1.6, 2.4)
    start = side * rng.uniform(0.5, 1.5)
    leaves = rng.uniform(0.3, 0.8)
    out = leaves + (EDGE - abs(start)) / speed
    back = out + (rng.uniform(0.2, 1.5) if back_on == side else rng.uniform(1.0, 2.2))
    knots = [
        (0.0, start),
        (leaves, start),
        (out, side * EDGE),
        (out + _AT_ONCE, back_on * EDGE),
        (back, back_on * EDGE),
    ]
    return Way(x=_jump(times, [*knots, (back + 5.0 / speed, back_on * (EDGE - 5.0))]), z=np.full(len(times), z))


def _jump(times: np.ndarray, knots: list[tuple[float, float]]) -> Float[np.ndarray, "T"]:
    """Straight lines with sharp corners: who walks round the camera is out of the image meanwhile."""
    at, places = np.array(knots).T
    return np.interp(times, at, places)


def leaving(rng: np.random.Generator, times: np.ndarray) -> list[Way]:
    """One stands; another leaves and comes back on the same side."""
    side = rng.choice([-1.0, 1.0])
    one, other = _depths(rng, 2)
    return [
        _stand(rng, times, -side * rng.uniform(0.3, 1.0), one),
        _out_and_back(rng, times, side, other, back_on=side),
    ]


def rounding(rng: np.random.Generator, times: np.ndarray) -> list[Way]:
    """One stands; another leaves and comes back on the other side."""
    side = rng.choice([-1.0, 1.0])
    one, other = _depths(rng, 2)
    return [_stand(rng, times, rng.uniform(-0.3, 0.3), one), _out_and_back(rng, times, side, other, back_on=-side)]


def both_leaving(rng: np.random.Generator, times: np.ndarray) -> list[Way]:
    """Two leave and come back, each on either side."""
    one, other = _depths(rng, 2)
    return [
        _out_and_back(rng, times, -1.0, one, back_on=float(rng.choice([-1.0, 1.0]))),
        _out_and_back(rng, times, 1.0, other, back_on=float(rng.choice([-1.0, 1.0]))),
    ]


def three(rng: np.random.Generator, times: np.ndarray) -> list[Way]:
    """Three walk through the image, each in any direction."""
    ways = []
    for z in _depths(rng, 3):
        speed = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.4)
        ways.append(_walk(times, SECONDS / 2 + rng.uniform(-1.2, 1.2), speed, z))
    return ways


SCENES: dict[str, Scene] = {
    "crossing": crossing,
    "behind": behind,
    "meeting": meeting,
    "overtaking": overtaking,
    "leaving": leaving,
    "rounding": rounding,
    "both leaving": both_leaving,
    "three": three,
}
"""By name."""
