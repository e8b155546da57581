"""The Complex Motion: sitting down cross-legged on the floor, and standing up again.

Written for the free body's mean shape, with the right foot crossing in front; `Build` and `Manner` fit it to a person.
World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting_core.evaluation.build import Build
from fitting_core.evaluation.hazards import Hazard
from fitting_core.evaluation.motion import Key
from fitting_core.evaluation.script import ArmKey, FootKey, Script, mirrored

_ACTIVE_SECONDS = 6.6
"""All of it but the rest on the floor."""
_DOWN, _UP = 3.4, 3.6
"""When the person has sat down; when they start to rise, if the rest on the floor is left out. Seconds."""


@dataclass(frozen=True, kw_only=True)
class Manner:
    """How one person does it."""

    mirror: bool
    """The left foot crosses in front."""
    rest: float
    """Share of the whole that the person rests on the floor."""
    reach: float
    """How far from the seat the hand supports, against the usual."""
    bow: float
    """How far the trunk bends forward, against the usual."""
    look: float
    """Degrees that the head turns aside while sitting."""

    @staticmethod
    def draw(rng: np.random.Generator) -> "Manner":
        """One person's by chance."""
        return Manner(
            mirror=bool(rng.random() < 0.5),
            rest=rng.uniform(0.12, 0.24),
            reach=rng.uniform(0.92, 1.08),
            bow=rng.uniform(0.9, 1.1),
            look=rng.uniform(-18, 18),
        )


def cross_legged(build: Build, seconds: float, rng: np.random.Generator) -> tuple[Script, list[Hazard]]:
    """Somebody's way of sitting down and standing up, and where detectors fail on it.

    Args:
        build: Of the person.
        seconds: Of the whole.
        rng: Source of chance.
    """
    manner = Manner.draw(rng)
    clock = _Clock(seconds, manner.rest)
    script = Script(
        seconds=seconds,
        arms={"left": _left_arm(build, clock), "right": _right_arm(build, manner, clock)},
        hips_path=[(clock(t), build.leg * np.array(v)) for t, v in _HIPS_PATH],
        hips_turn=_bent(_HIPS_TURN, manner.bow, clock),
        spine_turn=_bent(_SPINE_TURN, manner.bow, clock),
        head_turn=[(clock(t), np.add(v, (0, manner.look * (_DOWN - 0.1 < t < _UP), 0))) for t, v in _HEAD_TURN],
        feet={side: _foot(keys, build, clock) for side, keys in _FEET.items()},
        on_floor=[(clock(t), v) for t, v in _ON_FLOOR],
    )
    hazards = [replace(h, start=clock(h.start), stop=clock(h.stop)) for h in _HAZARDS]
    if manner.mirror:
        return mirrored(script), [replace(h, groups=tuple(_OTHER_SIDE.get(g, g) for g in h.groups)) for h in hazards]
    return script, hazards


class _Clock:
    """From the script's times to the person's."""

    def __init__(self, seconds: float, rest: float) -> None:
        self.pause = rest * seconds
        self.pace = (seconds - self.pause) / _ACTIVE_SECONDS

    def __call__(self, time: float) -> float:
        return time * self.pace + self.pause * float(np.clip((time - _DOWN) / (_UP - _DOWN), 0, 1))


def _bent(keys: Sequence[Key], bow: float, clock: _Clock) -> list[Key]:
    return [(clock(t), np.multiply(v, (bow, 1, 1))) for t, v in keys]


def _foot(keys: Sequence[FootKey], build: Build, clock: _Clock) -> list[FootKey]:
    return [
        replace(key, time=clock(key.time), place=(build.leg * key.place[0], build.leg * key.place[1])) for key in keys
    ]


_SEAT = -0.30
"""z of the pelvis on the floor."""
_ASIDE = 0.13
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
    (0.0, (0, 0, 0)), (0.7, (2, 6, -2)), (1.2, (6, 3, 0)), (1.6, (32, -4, 3)), (2.0, (36, -12, 10)),
    (2.4, (8, -6, 5)), (2.7, (-10, 0, 2)), (3.2, (-12, 0, 0)), (3.75, (-10, 0, 0)), (4.15, (18, -8, 5)),
    (4.4, (34, -12, 8)), (4.8, (44, -8, 4)), (5.2, (26, 0, 0)), (5.6, (5, 3, 0)), (6.0, (2, 3, -1)), (6.6, (0, 0, 0)),
)  # fmt: skip
_SPINE_TURN: Sequence[Key] = (
    (0.0, (0, 0, 0)), (0.7, (5, -3, 2)), (1.2, (8, -2, 0)), (1.6, (24, -6, 4)), (2.0, (26, -14, 12)),
    (2.4, (26, -12, 10)), (2.8, (18, -4, 3)), (3.3, (17, 0, 0)), (3.7, (17, 0, 0)), (4.15, (32, -10, 8)),
    (4.5, (34, -10, 8)), (4.9, (28, -4, 3)), (5.3, (16, 0, 0)), (5.7, (4, 0, 0)), (6.6, (0, 0, 0)),
)  # fmt: skip
_HEAD_TURN: Sequence[Key] = (
    (0.0, (0, 0, 0)), (0.5, (22, 4, 0)), (1.1, (14, 2, 0)), (1.6, (-6, -8, 0)), (2.0, (-8, -22, -4)),
    (2.4, (-10, -16, -2)), (2.8, (0, 0, 0)), (3.3, (-2, 0, 0)), (3.7, (-2, 0, 0)), (4.1, (8, -14, 0)),
    (4.5, (-12, -8, 0)), (4.9, (-22, 0, 0)), (5.4, (2, 4, 0)), (5.8, (18, 4, 0)), (6.2, (2, 0, 0)), (6.6, (0, 0, 0)),
)  # fmt: skip

_KNEE_AHEAD, _KNEE_OPEN, _KNEE_LOW = (0.15, 0.0, 1.0), (0.55, 0.2, 0.8), (0.9, 0.5, 0.45)
_LEFT_BALL, _RIGHT_BALL, _CROSSED_BALL = (0.125, 0.16), (0.125, 0.16), (-0.215, 0.40)
_FEET = {
    "left": (
        FootKey(0.0, _LEFT_BALL, knee=_KNEE_AHEAD),
        FootKey(1.15, _LEFT_BALL, knee=_KNEE_AHEAD),
        FootKey(1.6, _LEFT_BALL, roll=8, knee=_KNEE_OPEN),
        FootKey(2.1, _LEFT_BALL, roll=45, yaw=5, knee=_KNEE_LOW),
        FootKey(2.5, _LEFT_BALL, roll=68, yaw=0, knee=_KNEE_LOW),
        FootKey(4.2, _LEFT_BALL, roll=68, yaw=0, knee=_KNEE_LOW),
        FootKey(4.6, _LEFT_BALL, roll=45, yaw=5, knee=_KNEE_LOW),
        FootKey(5.1, _LEFT_BALL, roll=8, knee=_KNEE_OPEN),
        FootKey(5.5, _LEFT_BALL, knee=_KNEE_AHEAD),
    ),
    "right": (
        FootKey(0.0, _RIGHT_BALL, knee=_KNEE_AHEAD),
        FootKey(0.42, _RIGHT_BALL, knee=_KNEE_AHEAD),
        FootKey(0.68, (-0.02, 0.36), yaw=-6, lift=0.07, knee=_KNEE_AHEAD),
        FootKey(0.98, _CROSSED_BALL, yaw=-20, knee=_KNEE_AHEAD),
        FootKey(1.15, _CROSSED_BALL, yaw=-20, knee=_KNEE_AHEAD),
        FootKey(1.6, _CROSSED_BALL, yaw=-20, roll=8, knee=_KNEE_OPEN),
        FootKey(2.1, _CROSSED_BALL, yaw=-24, roll=45, knee=_KNEE_LOW),
        FootKey(2.5, _CROSSED_BALL, yaw=-28, roll=68, knee=_KNEE_LOW),
        FootKey(4.2, _CROSSED_BALL, yaw=-28, roll=68, knee=_KNEE_LOW),
        FootKey(4.6, _CROSSED_BALL, yaw=-24, roll=45, knee=_KNEE_LOW),
        FootKey(5.1, _CROSSED_BALL, yaw=-20, roll=8, knee=_KNEE_OPEN),
        FootKey(5.5, _CROSSED_BALL, yaw=-20, knee=_KNEE_AHEAD),
        FootKey(5.62, _CROSSED_BALL, yaw=-20, knee=_KNEE_AHEAD),
        FootKey(5.9, (-0.02, 0.36), yaw=-6, lift=0.07, knee=_KNEE_AHEAD),
        FootKey(6.2, _RIGHT_BALL, knee=_KNEE_AHEAD),
    ),
}
_PALM_DOWN: dict[str, Any] = dict(palm=(0.0, -1.0, 0.0), shape="flat")


def _hanging(time: float, build: Build, forward: float = 0.055) -> ArmKey:
    wrist = (0.235 + build.stout, -0.445 * build.arm, forward)
    return ArmKey(time, wrist, (0.06, -1.0, 0.42), (-1.0, 0.0, -0.15), "relaxed", (0.35, -0.1, -1.0))


def _on_knee(time: float) -> ArmKey:
    return ArmKey(
        time, (-0.05, 0.085, -0.06), (0.45, -0.35, 0.8), (0.0, -1.0, -0.2), "relaxed", (0.8, -0.6, -0.3), "knee"
    )


def _right_arm(build: Build, manner: Manner, clock: _Clock) -> list[ArmKey]:
    out, behind = (np.array((0.40, 0.17)) * manner.reach + (build.stout, 0)) * build.leg
    place = (float(out - _ASIDE * build.leg), 0.0, float(_SEAT * build.leg - behind))
    back: dict[str, Any] = dict(fingers=(0.75, 0.0, -0.6), elbow=(0.5, 0.2, -1.0), anchor="floor", **_PALM_DOWN)
    lowered: dict[str, Any] = back | dict(fingers=(0.6, -0.75, -0.35), palm=(-0.35, -0.6, -0.5), shape="relaxed")
    ahead = (place[0] + 0.02, 0.0, place[2] + 0.10)
    keys = [
        _hanging(0.0, build), _hanging(1.25, build),
        ArmKey(1.75, (place[0], 0.13, place[2] + 0.03), **lowered),
        ArmKey(2.0, place, **back), ArmKey(2.65, place, **back),
        ArmKey(2.82, (place[0] + 0.02, 0.07, place[2] + 0.06), **lowered),
        _on_knee(3.35), _on_knee(3.7),
        ArmKey(4.0, (ahead[0] + 0.02, 0.09, ahead[2] + 0.05), **lowered),
        ArmKey(4.2, ahead, **back), ArmKey(4.72, ahead, **back),
        ArmKey(4.88, (ahead[0], 0.10, ahead[2] + 0.04), **lowered),
        _hanging(5.5, build, 0.09), _hanging(6.6, build),
    ]  # fmt: skip
    return [replace(key, time=clock(key.time)) for key in keys]


def _left_arm(build: Build, clock: _Clock) -> list[ArmKey]:
    def ahead(time: float) -> ArmKey:
        wrist = (0.26 + build.stout, -0.28 * build.arm, 0.30 * build.arm)
        return ArmKey(time, wrist, (0.1, -0.5, 0.9), (-0.8, -0.6, 0.0), "relaxed", (0.9, -0.5, -0.3))

    keys = [
        _hanging(0.0, build), _hanging(1.1, build), ahead(1.8), ahead(2.2), _on_knee(2.9), _on_knee(3.9),
        ahead(4.5), ahead(4.8), _hanging(5.5, build, 0.09), _hanging(6.6, build),
    ]  # fmt: skip
    return [replace(key, time=clock(key.time)) for key in keys]


_FOOT_POINTS = ("ankle", "big_toe", "small_toe", "heel")
_OTHER_SIDE = {
    f"{a}_{part}": f"{b}_{part}"
    for a, b in (("left", "right"), ("right", "left"))
    for part in ("hand", "wrist", "elbow", *_FOOT_POINTS)
}
_LEFT_FOOT = tuple(f"left_{part}" for part in _FOOT_POINTS)
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
