"""The Complex Motion: sitting down cross-legged on the floor, and standing up again.

Written for the free body's mean shape, with the right foot crossing in front; `Build` and `Manner` fit it to a person.
World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from evaluation.synthetic.acting.script import (
    SIDES,
    ArmKey,
    Build,
    FootKey,
    Hazard,
    Key,
    Script,
    hanging,
    mirrored,
    mirrored_hazards,
)
from fitting_core.keypoints import Side

_ACTIVE_SECONDS = 6.6
"""All of it but the rest on the floor."""
_DOWN, _UP = 3.4, 3.6
"""When the person has sat down; when they start to rise, if the rest on the floor is left out. Seconds."""
_MIDDLE = (_DOWN + _UP) / 2
_ON_HANDS = (1.5, 5.0)
"""Between them turns aside are to the hand that supports."""


@dataclass(frozen=True, kw_only=True)
class Manner:
    """How one person does it."""

    mirror: bool
    """The left foot crosses in front."""
    down: str
    """Which hand supports on the way down."""
    up: str
    """The same for the way up."""
    rest: float
    """Share of the whole that the person rests on the floor."""
    haste: float
    """How much longer the way down takes against the way up, each against the usual."""
    reach: float
    """How far from the seat the hands support, against the usual."""
    bow: float
    """How far the trunk bends forward, against the usual."""
    look: float
    """Degrees that the head turns aside while sitting."""

    @staticmethod
    def draw(rng: np.random.Generator) -> "Manner":
        """One person's by chance."""
        return Manner(
            mirror=bool(rng.random() < 0.5),
            down=str(rng.choice(list(_HANDS))),
            up=str(rng.choice(list(_HANDS))),
            rest=rng.uniform(0.12, 0.24),
            haste=rng.uniform(0.9, 1.1),
            reach=rng.uniform(0.92, 1.08),
            bow=rng.uniform(0.9, 1.1),
            look=rng.uniform(-18, 18),
        )


_HANDS = {"right": 1.0, "left": -1.0}
"""That support, and which way the trunk then turns."""


def cross_legged(build: Build, seconds: float, rng: np.random.Generator) -> tuple[Script, list[Hazard]]:
    """A person's way of sitting down and standing up, and where detectors fail on it.

    Args:
        build: Of the person.
        seconds: Of the whole.
        rng: Source of chance.
    """
    manner = Manner.draw(rng)
    clock = _Clock(seconds, manner)
    script = Script(
        seconds=seconds,
        arms={side: [replace(k, time=clock(k.time)) for k in _arm(side, build, manner)] for side in SIDES},
        hips_path=[(clock(t), build.leg * np.array(v)) for t, v in _HIPS_PATH],
        hips_turn=_turned(_HIPS_TURN, manner, clock),
        spine_turn=_turned(_SPINE_TURN, manner, clock),
        head_turn=[
            (t, np.add(v, (0, manner.look * (_DOWN < u < _UP), 0)))
            for (t, v), (u, _) in zip(_turned(_HEAD_TURN, manner, clock), _HEAD_TURN, strict=True)
        ],
        feet={side: _foot(keys, build, clock) for side, keys in _FEET.items()},
        on_floor=[(clock(t), v) for t, v in _ON_FLOOR],
    )
    hazards = [replace(h, start=clock(h.start), stop=clock(h.stop)) for h in _HAZARDS]
    return (mirrored(script), mirrored_hazards(hazards)) if manner.mirror else (script, hazards)


class _Clock:
    """From the script's times to the person's."""

    def __init__(self, seconds: float, manner: Manner) -> None:
        self.pause = manner.rest * seconds
        down, up = _MIDDLE * manner.haste, (_ACTIVE_SECONDS - _MIDDLE) / manner.haste
        pace = (seconds - self.pause) / (down + up)
        self.down, self.up = pace * manner.haste, pace / manner.haste

    def __call__(self, time: float) -> float:
        moving = self.down * min(time, _MIDDLE) + self.up * max(time - _MIDDLE, 0.0)
        return moving + self.pause * min(max((time - _DOWN) / (_UP - _DOWN), 0.0), 1.0)


def _turned(keys: Sequence[Key], manner: Manner, clock: _Clock) -> list[Key]:
    """Bent forward as the person does, and turned to the hands that support."""

    def factors(time: float) -> tuple[float, float, float]:
        if not _ON_HANDS[0] < time < _ON_HANDS[1]:
            return manner.bow, 1.0, 1.0
        aside = _HANDS[manner.down if time < _MIDDLE else manner.up]
        return manner.bow, aside, aside

    return [(clock(t), np.multiply(v, factors(t))) for t, v in keys]


def _foot(keys: Sequence[FootKey], build: Build, clock: _Clock) -> list[FootKey]:
    """Stout thighs cross with the feet farther from each other."""
    wider = {_CROSSED: np.array((1.0, 1.6)) * build.stout}

    def place(key: FootKey) -> tuple[float, float]:
        x, z = build.leg * np.array(key.place) + wider.get(key.place, 0.0)
        return float(x), float(z)

    return [replace(key, time=clock(key.time), place=place(key)) for key in keys]


_SEAT = -0.30
"""z of the pelvis on the floor."""
_ASIDE = 0.15
"""x of the pelvis there: between the crossed feet."""
_HIPS_PATH: Sequence[Key] = (
    (0.0, (0.0, -0.008, 0.0)), (0.4, (0.045, -0.012, 0.0)), (0.95, (0.08, -0.03, 0.05)), (1.2, (_ASIDE, -0.05, 0.06)),
    (1.6, (_ASIDE, -0.30, -0.08)), (2.0, (_ASIDE, -0.60, -0.21)), (2.4, (_ASIDE, -0.83, _SEAT)),
    (2.6, (_ASIDE, -0.86, _SEAT)), (4.15, (_ASIDE, -0.86, _SEAT)), (4.35, (_ASIDE, -0.84, _SEAT + 0.02)),
    (4.75, (_ASIDE, -0.58, -0.18)), (5.2, (_ASIDE, -0.25, -0.05)), (5.6, (_ASIDE, -0.05, 0.06)),
    (5.95, (0.08, -0.03, 0.04)), (6.3, (0.0, -0.01, 0.0)),
)  # fmt: skip
_ON_FLOOR: Sequence[Key] = ((2.25, (0.0,)), (2.5, (1.0,)), (4.15, (1.0,)), (4.4, (0.0,)))
_HIPS_TURN: Sequence[Key] = (
    (0.0, (0, 0, 0)), (0.6, (2, 6, -2)), (0.95, (3, 15, -2)), (1.25, (8, 14, 0)), (1.6, (30, -2, 3)),
    (1.95, (31, -12, 9)), (2.2, (18, -12, 11)), (2.45, (3, -7, 8)), (2.75, (-10, 0, 2)), (3.2, (-12, 0, 0)),
    (3.75, (-10, 0, 0)), (4.15, (2, -6, 5)), (4.4, (10, -9, 7)), (4.8, (33, -6, 4)), (5.2, (26, 8, 0)),
    (5.55, (6, 14, 0)), (5.8, (3, 13, -1)), (6.1, (2, 5, -1)), (6.6, (0, 0, 0)),
)  # fmt: skip
_SPINE_TURN: Sequence[Key] = (
    (0.0, (0, 0, 0)), (0.7, (5, -6, 2)), (1.2, (8, -9, 0)), (1.6, (22, -6, 4)), (2.0, (24, -14, 14)),
    (2.45, (24, -13, 14)), (2.8, (18, -5, 6)), (3.3, (17, 0, 0)), (3.7, (17, 0, 0)), (4.15, (24, -13, 17)),
    (4.5, (26, -12, 16)), (4.9, (24, -4, 3)), (5.3, (14, -5, 0)), (5.7, (4, -8, 0)), (6.6, (0, 0, 0)),
)  # fmt: skip
_HEAD_TURN: Sequence[Key] = (
    (0.0, (0, 0, 0)), (0.5, (22, 4, 0)), (1.1, (14, 2, 0)), (1.6, (-6, -8, 0)), (2.0, (-8, -22, -4)),
    (2.4, (-10, -16, -2)), (2.8, (0, 0, 0)), (3.45, (-2, 0, 0)), (3.55, (-2, 0, 0)), (4.1, (4, -14, 0)),
    (4.5, (-12, -8, 0)), (4.9, (-20, 0, 0)), (5.4, (2, 4, 0)), (5.8, (18, 4, 0)), (6.2, (2, 0, 0)), (6.6, (0, 0, 0)),
)  # fmt: skip

_KNEE_AHEAD, _KNEE_OPEN, _KNEE_LOW = (0.15, 0.0, 1.0), (0.55, 0.2, 0.8), (0.82, 0.42, 0.62)
_KNEE_RISING = (0.7, 0.45, 0.7)
_BALL, _CROSSED = (0.12, 0.16), (-0.275, 0.43)
_STANDING = FootKey(0.0, _BALL, knee=_KNEE_AHEAD)
_SITTING = FootKey(0.0, _BALL, roll=66, yaw=0, knee=_KNEE_LOW)
_STANDING_CROSSED = FootKey(0.0, _CROSSED, yaw=-12, roll=4, knee=_KNEE_AHEAD)
_SITTING_CROSSED = FootKey(0.0, _CROSSED, yaw=-18, roll=66, knee=_KNEE_LOW)
_FEET = {
    "left": (
        _STANDING,
        replace(_STANDING, time=1.15),
        replace(_STANDING, time=1.6, roll=22, knee=_KNEE_OPEN),
        replace(_SITTING, time=2.1, roll=50, yaw=4, knee=_KNEE_RISING),
        replace(_SITTING, time=2.5),
        replace(_SITTING, time=4.2),
        replace(_SITTING, time=4.55, roll=48, yaw=4, knee=_KNEE_RISING),
        replace(_STANDING, time=5.1, roll=22, knee=_KNEE_OPEN),
        replace(_STANDING, time=5.5),
    ),
    "right": (
        _STANDING,
        replace(_STANDING, time=0.36),
        replace(_STANDING, time=0.54, heel=24),
        replace(_STANDING, time=0.60, heel=24, lift=0.015),
        FootKey(0.74, (-0.04, 0.37), yaw=-2, heel=8, lift=0.07, knee=_KNEE_AHEAD),
        replace(_STANDING_CROSSED, time=0.92, lift=0.025),
        replace(_STANDING_CROSSED, time=1.0),
        replace(_STANDING_CROSSED, time=1.15),
        replace(_STANDING_CROSSED, time=1.6, yaw=-14, roll=26, knee=_KNEE_OPEN),
        replace(_SITTING_CROSSED, time=2.1, yaw=-16, roll=50, knee=_KNEE_RISING),
        replace(_SITTING_CROSSED, time=2.5),
        replace(_SITTING_CROSSED, time=4.2),
        replace(_SITTING_CROSSED, time=4.55, yaw=-16, roll=48, knee=_KNEE_RISING),
        replace(_STANDING_CROSSED, time=5.1, yaw=-14, roll=26, knee=_KNEE_OPEN),
        replace(_STANDING_CROSSED, time=5.5),
        replace(_STANDING_CROSSED, time=5.6),
        replace(_STANDING_CROSSED, time=5.74, heel=20),
        replace(_STANDING_CROSSED, time=5.80, heel=20, lift=0.015),
        FootKey(5.94, (-0.03, 0.35), yaw=-2, heel=6, lift=0.06, knee=_KNEE_AHEAD),
        replace(_STANDING, time=6.14, lift=0.025),
        replace(_STANDING, time=6.22),
    ),
}


def _arm(side: Side, build: Build, manner: Manner) -> list[ArmKey]:
    """An arm that supports the body, or balances it, on the way down and on the way up."""
    keys = [hanging(0.0, build), hanging(1.15, build)]
    keys += _landing(side, 1.9, build, manner) if side == manner.down else _balancing(1.7, 2.25, build)
    keys += [_on_knee(3.42, build), _on_knee(3.6, build)]
    keys += _rising(side, 4.0, build, manner) if side == manner.up else _balancing(4.3, 4.85, build)
    return [*keys, hanging(5.45, build, 0.09), hanging(6.6, build)]


def _on_knee(time: float, build: Build) -> ArmKey:
    wrist, elbow = (-0.05, 0.12 + 0.3 * build.stout, -0.07), (0.8, -0.6, -0.3)
    return ArmKey(time, wrist, (0.4, -0.12, 0.85), (0.0, -1.0, -0.1), "relaxed", elbow, "knee")


def _balancing(start: float, stop: float, build: Build) -> list[ArmKey]:
    """The arm is held out ahead."""
    wrist = (0.24 + build.stout, 0.17 * build.arm, 0.41 * build.arm)
    ahead = ArmKey(start, wrist, (-0.1, 0.1, 1.0), (-0.7, -0.7, 0.0), "relaxed", (0.9, -0.6, -0.2))
    return [ahead, replace(ahead, time=stop)]


_FLAT: dict[str, Any] = dict(
    fingers=(0.72, 0.0, 0.7), palm=(0.0, -1.0, 0.0), shape="flat", elbow=(0.9, 0.2, -0.8), anchor="floor"
)
_LOWERED: dict[str, Any] = _FLAT | dict(fingers=(0.25, -0.95, 0.05), palm=(-0.9, -0.3, -0.2), shape="relaxed")
_REACHING: dict[str, Any] = _FLAT | dict(fingers=(0.2, -0.5, 0.85), palm=(-0.6, -0.75, -0.2), shape="relaxed")
_OVER: dict[str, Any] = _FLAT | dict(fingers=(0.1, -0.4, 0.9), palm=(-0.5, -0.8, -0.3), shape="relaxed")


def _landing(side: Side, time: float, build: Build, manner: Manner) -> list[ArmKey]:
    """The hand goes down to the floor behind the seat, and then past the thigh to the knee."""
    x, z = _support(side, build, manner, (0.37, 0.05))
    return [
        ArmKey(time, (x, 0.13, z + 0.03), **_LOWERED),
        ArmKey(time + 0.19, (x, 0.02, z), **_FLAT),
        ArmKey(time + 0.25, (x, 0.0, z), **_FLAT),
        ArmKey(time + 0.80, (x, 0.0, z), **_FLAT),
        ArmKey(time + 0.86, (x, 0.02, z), **_FLAT),
        ArmKey(time + 1.0, (x + 0.02, 0.09, z + 0.06), **_LOWERED),
        ArmKey(time + 1.22, (x + 0.08, 0.30, z + 0.20), **_OVER),
    ]


def _rising(side: Side, time: float, build: Build, manner: Manner) -> list[ArmKey]:
    """The hand goes from the knee past the thigh to the floor beside the seat, and pushes off."""
    x, z = _support(side, build, manner, (0.42, 0.04))
    return [
        ArmKey(time - 0.17, (x + 0.08, 0.30, z + 0.12), **_OVER),
        ArmKey(time - 0.01, (x + 0.02, 0.10, z + 0.05), **_REACHING),
        ArmKey(time + 0.14, (x, 0.02, z), **_FLAT),
        ArmKey(time + 0.20, (x, 0.0, z), **_FLAT),
        ArmKey(time + 0.72, (x, 0.0, z), **_FLAT),
        ArmKey(time + 0.78, (x, 0.02, z), **_FLAT),
        ArmKey(time + 0.92, (x, 0.10, z + 0.04), **_LOWERED),
    ]


def _support(side: Side, build: Build, manner: Manner, place: tuple[float, float]) -> tuple[float, float]:
    """x and z (for the left side, metres) where a hand supports; `place`: outward and ahead of the seat's middle."""
    out = place[0] * manner.reach + build.stout + SIDES[side] * _ASIDE
    return float(build.leg * out), float(build.leg * (_SEAT + place[1]))


_LEFT_FOOT = tuple(f"left_{part}" for part in ("ankle", "big_toe", "small_toe", "heel"))
_HAZARDS = (
    Hazard("swapped", 0.75, 1.5, ("legs",)),
    Hazard("swapped", 1.5, 2.3, ("legs",)),
    Hazard("dropped", 1.9, 2.8, ("right_hand",)),
    Hazard("dropped", 1.9, 2.7, ("right_wrist", "right_elbow", "right_hand")),
    Hazard("occluded", 2.0, 3.0, _LEFT_FOOT),
    Hazard("occluded", 3.0, 3.9, _LEFT_FOOT),
    Hazard("swapped", 2.9, 3.9, ("legs",)),
    Hazard("dropped", 3.2, 4.0, ("left_hand",)),
    Hazard("dropped", 4.0, 4.9, ("right_hand",)),
    Hazard("dropped", 4.2, 5.0, ("right_wrist", "right_elbow", "right_hand")),
    Hazard("swapped", 4.5, 5.6, ("legs",)),
    Hazard("occluded", 4.3, 5.1, _LEFT_FOOT),
)
