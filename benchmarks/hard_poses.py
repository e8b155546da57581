"""Poses that monocular fits find hard, as a table: where hands and feet are, and how trunk and head are turned.

Level axes: x to the person's left, y up, z forward, metres, with the pelvis joint at the origin. Limbs are written for
the left side; the right side mirrors x, so that a negative x always means "across to the other side".
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Leg:
    """Where a foot is and where the knee points, in the level axes."""

    ankle: Vector
    """From the pelvis joint."""
    knee: Vector = (0.1, 0.0, 1.0)
    """Direction in which the knee lies off the line from hip to ankle."""
    toes: Vector | None = (0.15, 0.0, 1.0)
    """Direction in which they point; None: the ankle is at rest."""
    sole: Vector = (0.0, -1.0, 0.0)
    """Direction that the sole faces."""


@dataclass(frozen=True)
class Arm:
    """Where a hand is and where the elbow points, in the chest's axes."""

    wrist: Vector
    """From the middle between the shoulders."""
    elbow: Vector = (0.6, -0.8, -0.35)
    fingers: Vector | None = None
    """Direction of straight fingers; None: in line with the forearm."""
    palm: Vector | None = None
    """Direction that the palm faces; None: as the forearm turns it."""
    shape: str = "relaxed"
    """One of handshapes.HANDSHAPES."""


Limb = TypeVar("Limb", Leg, Arm)


@dataclass(frozen=True, kw_only=True)
class HardPose:
    """One pose. Turns are (pitch forward, yaw to the left, roll to the right) in degrees."""

    name: str
    category: str
    legs: tuple[Leg, Leg]
    """Left, right."""
    arms: tuple[Arm, Arm]
    hips: Vector = (0.0, 0.0, 0.0)
    spine: Vector = (0.0, 0.0, 0.0)
    """Spread over the three spine joints."""
    head: Vector = (0.0, 0.0, 0.0)
    """Spread over neck and head."""
    whole: Vector = (0.0, 0.0, 0.0)
    """Turn of the finished figure."""
    from_behind: bool = False
    """Also seen from behind."""


def _both(limb: Limb) -> tuple[Limb, Limb]:
    return limb, limb


_STAND = _both(Leg((0.10, -0.905, 0.0)))
_HANG = Arm((0.215, -0.505, 0.045), (0.35, -0.1, -1.0))
_HANGING = _both(_HANG)
_CHAIR_LEG = Leg((0.13, -0.53, 0.36), (0.1, 0.6, 1.0))
_CHAIR = _both(_CHAIR_LEG)
_ON_THIGH = Arm((0.14, -0.37, 0.24), (0.8, -0.3, -0.6), (-0.2, -0.3, 1.0), (0.0, -1.0, -0.3))
_ON_THIGHS = _both(_ON_THIGH)
_TAILOR = (
    Leg((-0.12, -0.13, 0.27), (1.0, 0.15, 0.55), None),
    Leg((-0.04, -0.13, 0.38), (1.0, 0.15, 0.55), None),
)
_STRETCHED = Leg((0.11, -0.10, 0.84), (0.2, 1.0, 0.0), (0.15, 1.0, 0.25), (0.0, -0.2, 1.0))
_KNEELING = Leg((0.12, -0.50, -0.385), (0.0, -1.0, 1.0), (0.0, -0.6, -1.0), (0.0, 1.0, -0.6))
_HEELS = Leg((0.10, -0.235, -0.135), (0.1, -0.3, 1.0), (-0.1, -0.45, -1.0), (0.0, 1.0, -0.45))
_HEELS_BACK = replace(_HEELS, ankle=(0.10, -0.255, -0.235))
_SQUAT = Leg((0.19, -0.27, 0.13), (0.55, 0.6, 1.0), (0.5, 0.0, 1.0))
_READY: dict[str, Any] = dict(fingers=(-0.75, 0.2, 0.6), palm=(-0.2, -0.6, -0.75))
_ACROSS = Arm((-0.13, -0.215, 0.20), (1.0, -0.9, 0.1), (-1.0, 0.25, 0.0), (0.0, -0.3, -1.0))


def _standing(name: str, category: str, arms: Sequence[Arm], *, from_behind: bool = False, **turns: Vector) -> HardPose:
    return HardPose(
        name=name, category=category, legs=_STAND, arms=(arms[0], arms[1]), from_behind=from_behind, **turns
    )


_CROSSED_LEGS = [
    HardPose(name="ankles crossed, standing", category="legs crossed, standing", arms=_HANGING,
             legs=(Leg((-0.09, -0.90, 0.07), (0.1, 0.0, 1.0), (0.3, 0.0, 1.0)), Leg((-0.03, -0.905, -0.05)))),
    HardPose(name="legs crossed, arms crossed", category="legs crossed, standing",
             legs=(Leg((-0.06, -0.905, -0.06)), Leg((-0.14, -0.89, 0.09), (0.2, 0.0, 1.0))),
             arms=(_ACROSS, replace(_ACROSS, wrist=(-0.12, -0.25, 0.23))), spine=(3, 0, 0)),
    HardPose(name="one foot at the other knee", category="legs crossed, standing",
             legs=(Leg((-0.06, -0.50, 0.06), (1.0, 0.2, 0.5), (0.1, -1.0, 0.1), (-1.0, 0.0, 0.0)),
                   Leg((0.02, -0.91, 0.0))),
             arms=_both(Arm((0.0, 0.43, 0.06), (1.0, -0.2, 0.1), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), "flat"))),
    HardPose(name="scissor step", category="legs crossed, standing", arms=_HANGING,
             legs=(Leg((-0.07, -0.84, 0.24)), Leg((-0.05, -0.86, -0.22), toes=(0.1, -0.4, 1.0), sole=(0, -1, -0.4)))),
]  # fmt: skip
_ON_A_CHAIR = [
    HardPose(name="chair, upright", category="chair", legs=_CHAIR, arms=_ON_THIGHS, spine=(4, 0, 0)),
    HardPose(name="chair, knee over knee", category="chair", hips=(-8, 0, 0), spine=(10, 0, 0),
             legs=(Leg((-0.19, -0.36, 0.50), (0.0, 1.0, 0.7), (-0.3, -0.5, 1.0), (0.0, -1.0, -0.5)),
                   Leg((0.05, -0.53, 0.36), (0.0, 0.6, 1.0))),
             arms=(Arm((-0.02, -0.31, 0.30), (0.8, -0.6, -0.3), (-0.5, -0.3, 0.9), (0, -1, -0.3)),
                   Arm((0.02, -0.34, 0.28), (0.8, -0.6, -0.3), (-0.6, -0.3, 0.8), (0, -1, -0.3)))),
    HardPose(name="chair, ankle on knee", category="chair", hips=(-10, 0, 0), spine=(8, 0, 0),
             legs=(Leg((-0.15, 0.0, 0.36), (1.0, 0.25, 0.5), None), _CHAIR_LEG),
             arms=_ON_THIGHS),
    HardPose(name="chair, ankles crossed", category="chair", hips=(-10, 0, 0), spine=(12, 0, 0), arms=_ON_THIGHS,
             legs=(Leg((-0.06, -0.51, 0.52), (0.4, 0.6, 1.0)), Leg((-0.04, -0.52, 0.45), (0.4, 0.6, 1.0)))),
    HardPose(name="chair, elbows on thighs", category="chair", hips=(18, 0, 0), spine=(35, 0, 0), head=(-25, 0, 0),
             legs=_both(Leg((0.16, -0.53, 0.36), (0.3, 0.6, 1.0))),
             arms=_both(Arm((0.03, -0.20, 0.34), (0.7, -0.9, 0.2), (-0.7, 0.0, 0.7), (0.0, -0.6, -0.6)))),
    HardPose(name="chair, leaning back, hands behind head", category="chair", hips=(-22, 0, 0), spine=(6, 0, 0),
             head=(12, 0, 0), legs=_both(Leg((0.14, -0.50, 0.50), (0.2, 0.8, 0.8))),
             arms=_both(Arm((0.09, 0.19, -0.02), (1.0, 0.2, 0.1), (-1.0, 0.1, -0.2), (0.0, 0.3, 1.0)))),
]  # fmt: skip
_ON_THE_FLOOR = [
    HardPose(name="cross-legged, hands on knees", category="floor", hips=(-14, 0, 0), spine=(18, 0, 0), legs=_TAILOR,
             arms=_both(Arm((0.27, -0.33, 0.19), (0.7, -0.5, -0.6)))),
    HardPose(name="cross-legged, hands in lap", category="floor", hips=(-16, 0, 0), spine=(26, 0, 0), legs=_TAILOR,
             head=(10, 0, 0),
             arms=_both(Arm((0.05, -0.38, 0.20), (0.9, -0.4, -0.3), (-0.9, -0.1, 0.5), (0, 0.8, -0.5)))),
    HardPose(name="cross-legged, signing", category="floor", hips=(-12, 0, 0), spine=(14, 0, 0), legs=_TAILOR,
             arms=(Arm((0.15, -0.12, 0.28), fingers=(-0.3, 0.9, 0.4), palm=(-0.9, 0.0, -0.3), shape="flat"),
                   Arm((0.08, -0.20, 0.32), **_READY))),
    HardPose(name="legs stretched, hands on thighs", category="floor", hips=(-10, 0, 0), spine=(22, 0, 0),
             legs=_both(_STRETCHED),
             arms=_both(Arm((0.13, -0.33, 0.27), (0.8, -0.4, -0.5), (-0.1, -0.3, 1), (0, -1, -0.3)))),
    HardPose(name="legs stretched, leaning back", category="floor", hips=(-32, 0, 0), spine=(10, 0, 0), head=(10, 0, 0),
             legs=_both(_STRETCHED),
             arms=_both(Arm((0.30, -0.41, -0.16), (0.5, 0.0, -1.0), (0.4, -0.5, -0.8), (0.0, -0.9, 0.5)))),
    HardPose(name="knees hugged", category="floor", hips=(-28, 0, 0), spine=(52, 0, 0), head=(5, 0, 0),
             legs=_both(Leg((0.09, -0.10, 0.38), (0.1, 1.0, 0.4))),
             arms=(Arm((-0.05, -0.17, 0.38), (1.0, -0.5, 0.0), (-1.0, 0.0, 0.1), (0, 0, -1)),
                   Arm((-0.03, -0.21, 0.39), (1.0, -0.5, 0.0), (-1.0, 0.0, 0.1), (0, 0, -1)))),
    HardPose(name="legs folded to one side", category="floor", hips=(-4, 0, -6), spine=(10, 10, 8),
             legs=(Leg((-0.12, -0.12, 0.20), (1.0, 0.0, 0.9), None),
                   Leg((0.32, -0.16, -0.08), (0.1, -0.1, 1.0), None)),
             arms=(Arm((0.38, -0.30, 0.02), (0.4, 0.0, -1.0), (0.7, -0.6, 0.3), (-0.3, -0.8, 0.0)), _ON_THIGH)),
    HardPose(name="one leg stretched, one bent", category="floor", hips=(-22, 0, 0), spine=(30, 0, 0),
             legs=(_STRETCHED, Leg((0.12, -0.10, 0.46), (0.1, 1.0, 0.4))),
             arms=(Arm((0.30, -0.41, -0.12), (0.5, 0.0, -1.0), (0.5, -0.6, -0.6), (0, -0.9, 0.4)),
                   Arm((0.06, -0.08, 0.36), (0.9, -0.6, 0.0), (-0.3, -0.6, 0.8), (0, -0.9, -0.4)))),
]  # fmt: skip
_KNEELING_AND_SQUATTING = [
    HardPose(name="kneeling upright", category="kneeling", legs=_both(_KNEELING), arms=_HANGING),
    HardPose(name="kneeling, sitting on heels", category="kneeling", legs=_both(_HEELS), arms=_ON_THIGHS,
             hips=(-4, 0, 0), spine=(8, 0, 0)),
    HardPose(name="on one knee", category="kneeling", spine=(12, 0, 0),
             legs=(Leg((0.12, -0.53, 0.37), (0.1, 0.6, 1.0)), _KNEELING),
             arms=(Arm((0.10, -0.33, 0.32), (0.8, -0.4, -0.4), (-0.3, -0.1, 1), (0, -1, 0)), _HANG)),
    HardPose(name="kneeling, reaching down", category="kneeling", legs=_both(_HEELS_BACK), hips=(28, 0, 0),
             spine=(34, 0, 0), head=(-15, 0, 0),
             arms=_both(Arm((0.16, -0.20, 0.40), (0.8, 0.0, -0.7), (0.0, -0.1, 1.0), (0.0, -1.0, 0.5)))),
    HardPose(name="deep squat", category="squatting", hips=(12, 0, 0), spine=(34, 0, 0), head=(-25, 0, 0),
             legs=_both(_SQUAT),
             arms=_both(Arm((0.03, -0.26, 0.34), (0.9, -0.3, -0.2), (-0.8, 0.0, 0.6), (-0.2, -0.6, -0.6)))),
    HardPose(name="half squat, arms forward", category="squatting", hips=(28, 0, 0), spine=(8, 0, 0), head=(-20, 0, 0),
             legs=_both(Leg((0.17, -0.58, 0.12), (0.3, 0.2, 1.0), (0.3, 0.0, 1.0))),
             arms=_both(Arm((0.17, 0.05, 0.51), (0.7, -0.8, 0.0), (0.0, 0.1, 1.0), (0.0, -1.0, 0.1)))),
    HardPose(name="lunge", category="squatting", spine=(5, 0, 0),
             legs=(Leg((0.10, -0.62, 0.46)),
                   Leg((0.11, -0.66, -0.50), (0.1, -0.3, 1.0), (0.1, -0.8, 0.7), (0, -0.7, -0.8))),
             arms=_both(Arm((0.25, -0.36, -0.03), (1.0, 0.1, -0.4), (-0.6, -0.4, 0.6), (-0.6, -0.3, -0.6)))),
]  # fmt: skip
_ARMS_HIDDEN = [
    _standing("hands clasped behind the back", "arms behind", from_behind=True, spine=(-3, 0, 0),
              arms=_both(Arm((0.03, -0.36, -0.16), (1.0, 0.1, -0.5), (-0.8, -0.6, -0.1), (0.0, 0.2, -1.0)))),
    _standing("one arm behind the back", "arms behind", from_behind=True,
              arms=(Arm((-0.02, -0.28, -0.17), (1.0, -0.2, -0.4), (-1.0, 0.2, 0.0), (0.0, 0.0, -1.0)), _HANG)),
    _standing("hands on the back of the hips", "arms behind", from_behind=True, spine=(-6, 0, 0),
              arms=_both(Arm((0.15, -0.38, -0.11), (0.9, 0.1, -0.9), (-0.8, -0.7, 0.0), (0.0, 0.1, 1.0)))),
    _standing("hands behind the head", "arms behind", from_behind=True,
              arms=_both(Arm((0.09, 0.19, -0.03), (1.0, 0.2, 0.1), (-1.0, 0.1, -0.2), (0.0, 0.3, 1.0)))),
    _standing("arms crossed", "arms crossed", arms=(_ACROSS, replace(_ACROSS, wrist=(-0.12, -0.25, 0.23)))),
    _standing("hugging oneself", "arms crossed",
              arms=(Arm((-0.16, -0.09, 0.17), (0.8, -1.0, 0.3), (-0.9, 0.3, -0.3), (0.3, 0.0, -1.0)),
                    Arm((-0.15, -0.13, 0.20), (0.8, -1.0, 0.3), (-0.9, 0.3, -0.3), (0.3, 0.0, -1.0)))),
    _standing("hands on hips", "hands on hips", from_behind=True,
              arms=_both(Arm((0.25, -0.36, 0.0), (1.0, 0.1, -0.4), (-0.6, -0.4, 0.6), (-0.6, -0.3, -0.6)))),
    _standing("one hand on hip, leaning", "hands on hips", from_behind=True, hips=(0, 0, 5), spine=(0, 5, -8),
              arms=(Arm((0.25, -0.36, 0.0), (1.0, 0.1, -0.4), (-0.6, -0.4, 0.6), (-0.6, -0.3, -0.6)), _HANG)),
]  # fmt: skip
_HANDS_HIGH = [
    _standing("hands at the cheeks", "hands at the face",
              arms=_both(Arm((0.10, 0.07, 0.17), (0.7, -1.0, 0.3), (0.0, 1.0, -0.15), (-1.0, 0.0, -0.3), "flat"))),
    _standing("hand at the chin", "hands at the face", spine=(4, 0, 0), head=(8, 0, 0),
              arms=(Arm((0.01, 0.03, 0.20), (0.6, -1.0, 0.1), (-0.2, 1.0, -0.1), (-0.6, 0.0, -0.8)),
                    Arm((-0.10, -0.24, 0.22), (1.0, -0.6, 0.0), (-1.0, 0.1, 0.1), (0, -0.9, -0.4)))),
    _standing("phone at the ear", "hands at the face", head=(0, 0, -8),
              arms=(Arm((0.14, 0.11, 0.11), (0.6, -1.0, 0.4), (-0.2, 1.0, -0.15), (-1.0, -0.2, 0.0), "fist"), _HANG)),
    _standing("hand shading the eyes", "hands at the face",
              arms=(_HANG, Arm((0.16, 0.21, 0.18), (1.0, -0.4, 0.1), (-1.0, 0.2, 0.1), (0.0, -0.9, -0.4), "flat"))),
    _standing("hand over the mouth", "hands at the face", head=(5, 0, 0),
              arms=(Arm((0.08, 0.07, 0.20), (0.8, -1.0, 0.2), (-0.9, 0.4, -0.1), (0.0, 0.0, -1.0), "flat"), _HANG)),
    _standing("arms straight up", "overhead", from_behind=True,
              arms=_both(Arm((0.20, 0.55, 0.02), (0.9, 0.0, -0.4)))),
    _standing("hands clasped overhead", "overhead",
              arms=_both(Arm((0.05, 0.42, 0.06), (1.0, -0.2, 0.1), (-0.5, 1.0, 0.0), (-1.0, -0.5, -0.3)))),
    _standing("one arm up, waving", "overhead",
              arms=(Arm((0.36, 0.30, 0.10), (1.0, -0.6, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), "spread"), _HANG)),
    _standing("arms forward", "overhead", arms=_both(Arm((0.17, 0.0, 0.53), (0.7, -0.8, 0.0)))),
]  # fmt: skip
_SIGNING = [
    _standing("signing: hands up, palms in", "signing",
              arms=_both(Arm((0.14, -0.12, 0.27), fingers=(-0.5, 0.9, 0.2), palm=(-0.15, 0.0, -1.0), shape="spread"))),
    _standing("signing: fist on fist", "signing",
              arms=(Arm((0.10, -0.24, 0.28), (0.8, -0.6, -0.2), (-0.85, 0.0, 0.5), (0.0, -1.0, 0.0), "fist"),
                    Arm((0.02, -0.15, 0.28), (0.8, -0.6, -0.2), (-0.8, 0.0, 0.55), (0.0, -1.0, 0.0), "fist"))),
    _standing("signing: pointing ahead", "signing", spine=(4, 0, 0),
              arms=(Arm((0.15, -0.30, 0.27), **_READY),
                    Arm((0.12, -0.05, 0.36), (0.6, -0.8, -0.2), (-0.3, 0.2, 1.0), (-0.3, -0.9, 0.2), "point"))),
    _standing("signing: fingertips touch", "signing",
              arms=_both(Arm((0.11, -0.10, 0.25), (0.9, -0.7, 0.0), (-0.8, 0.7, 0.2), (-0.5, -0.7, -0.2), "flat"))),
    _standing("signing: one hand at the temple", "signing",
              arms=(_HANG, Arm((0.24, 0.10, 0.15), (0.9, -0.7, 0.1), (-0.72, 0.66, -0.18), (0.1, -0.55, 0.8), "flat"))),
]  # fmt: skip
_UPRIGHT = [
    _standing("standing, arms hanging", "standing", _HANGING, from_behind=True),
    HardPose(name="walking", category="standing", from_behind=True, spine=(3, 6, 0),
             legs=(Leg((0.09, -0.86, 0.26), toes=(0.1, 0.3, 1.0), sole=(0, -1, 0.3)),
                   Leg((0.09, -0.84, -0.30), toes=(0.1, -0.5, 1.0), sole=(0, -1, -0.5))),
             arms=(Arm((0.20, -0.48, -0.14), (0.3, 0.0, -1.0)), Arm((0.19, -0.44, 0.24), (0.4, -0.3, -1.0)))),
    HardPose(name="bowing, hands at the knees", category="standing", hips=(40, 0, 0), spine=(35, 0, 0),
             head=(-10, 0, 0), legs=_both(Leg((0.12, -0.87, -0.10))),
             arms=_both(Arm((0.18, -0.26, 0.36), (0.9, 0.2, -0.5), (-0.1, -0.6, 0.8), (0.0, -0.6, -0.8)))),
]  # fmt: skip
_SUPINE, _PRONE = (-90.0, 0.0, 0.0), (90.0, 0.0, 0.0)
_LYING = [
    replace(_standing("lying on the back", "lying", _HANGING), whole=_SUPINE),
    HardPose(name="lying on the back, knees up", category="lying", whole=_SUPINE,
             legs=_both(Leg((0.12, -0.48, -0.02), (0.1, 0.0, 1.0), (0.1, -1.0, 0.0), (0.0, 0.0, -1.0))),
             arms=_both(Arm((0.06, -0.28, 0.16), (1.0, -0.3, -0.3), (-0.9, -0.2, 0.1), (0, 0, -1)))),
    HardPose(name="lying face down, head on hands", category="lying", whole=_PRONE, head=(-12, 0, 0),
             legs=_both(Leg((0.12, -0.905, 0.0), toes=(0.0, -1.0, 0.25), sole=(0.0, -0.25, -1.0))),
             arms=_both(Arm((0.06, 0.10, 0.14), (1.0, -0.2, 0.3), (-0.9, 0.3, 0.0), (0, 0, 1)))),
    HardPose(name="lying on the side, curled up", category="lying", whole=(0.0, 0.0, -90.0), spine=(35, 0, 0),
             head=(15, 0, 0), legs=(Leg((0.06, -0.42, 0.20), (0.0, 0.5, 1.0), (0, -1, 0.5), (0, -0.5, -1)),
                                    Leg((0.06, -0.46, 0.12), (0.0, 0.5, 1.0), (0, -1, 0.5), (0, -0.5, -1))),
             arms=(Arm((0.05, 0.02, 0.24), (0.6, -0.8, 0.2), (-0.3, 0.9, 0.2), (-1, 0, 0)),
                   Arm((0.05, -0.10, 0.30), (0.6, -0.8, 0.2), (-0.3, 0.6, 0.6), (-1, 0, 0)))),
]  # fmt: skip

HARD_POSES: Sequence[HardPose] = (
    *_UPRIGHT, *_CROSSED_LEGS, *_ON_A_CHAIR, *_ON_THE_FLOOR, *_KNEELING_AND_SQUATTING, *_ARMS_HIDDEN, *_HANDS_HIGH,
    *_SIGNING, *_LYING,
)  # fmt: skip
"""All of them; `standing` ones are easy, for comparison."""
