"""The script of the demo clip: signing while standing, then sitting down. Tables of keyframes, nothing else.

World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from collections.abc import Sequence
from typing import Any

from evaluation.synthetic.acting.script import ArmKey, Failure, Key, Script

SECONDS = 5.8
BETAS = (0.5, -0.7, 0.4, -0.3, 0.3, 0.2, -0.2, 0.1, 0.0, 0.1)


_HANGING: dict[str, Any] = dict(
    wrist=(0.235, -0.445, 0.055), fingers=(0.06, -1.0, 0.42), palm=(-1.0, 0.0, -0.15), shape="relaxed",
                elbow=(0.35, -0.1, -1.0))  # fmt: skip
_ON_THIGH: dict[str, Any] = dict(
    wrist=(-0.015, 0.142, -0.21), fingers=(-0.22, -0.12, 1.0), palm=(0.0, -1.0, -0.1), shape="relaxed",
                 elbow=(0.75, -0.5, -0.5), anchor="knee")  # fmt: skip
_READY: dict[str, Any] = dict(
    wrist=(0.15, -0.30, 0.27), fingers=(-0.75, 0.2, 0.6), palm=(-0.2, -0.6, -0.75), shape="relaxed"
)
_FINGERS_UP_IN: dict[str, Any] = dict(fingers=(-0.5, 0.9, 0.2), palm=(-0.15, 0.0, -1.0), shape="spread")
_FINGERS_UP_OUT: dict[str, Any] = dict(fingers=(0.22, 1.0, 0.3), palm=(0.1, -0.3, 1.0), shape="spread")

_RIGHT_ARM: Sequence[ArmKey] = (
    ArmKey(0.00, **_HANGING),
    ArmKey(0.16, **_HANGING),
    ArmKey(0.42, (0.25, -0.16, 0.24), (-0.15, 0.45, 0.9), (-1.0, 0.0, 0.0), "relaxed", (0.8, -0.5, -0.3)),
    # "hello": a flat hand from the temple outward
    ArmKey(0.70, (0.27, 0.13, 0.15), (-0.72, 0.66, -0.18), (0.1, -0.55, 0.8), "flat", (0.9, -0.45, 0.1)),
    ArmKey(0.84, (0.27, 0.135, 0.15), (-0.72, 0.66, -0.18), (0.1, -0.55, 0.8), "flat", (0.9, -0.45, 0.1)),
    ArmKey(1.14, (0.37, 0.12, 0.25), (0.1, 0.98, 0.2), (0.0, -0.15, 1.0), "flat", (0.8, -0.7, 0.0)),
    ArmKey(1.28, (0.375, 0.12, 0.25), (0.12, 0.98, 0.2), (0.0, -0.15, 1.0), "flat", (0.8, -0.7, 0.0)),
    # "there": a pointing finger
    ArmKey(1.66, (0.12, -0.05, 0.33), (-0.78, 0.28, 0.55), (-0.2, -0.95, 0.15), "point", (0.6, -0.8, -0.2)),
    ArmKey(1.92, (0.10, -0.035, 0.345), (-0.78, 0.28, 0.55), (-0.2, -0.95, 0.15), "point", (0.6, -0.8, -0.2)),
    # "work": one fist taps on the other
    ArmKey(2.28, (-0.01, -0.09, 0.29), (-0.8, 0.05, 0.55), (0.0, -1.0, 0.0), "fist", (0.8, -0.6, -0.2)),
    ArmKey(2.42, (-0.01, -0.158, 0.30), (-0.8, -0.05, 0.55), (0.0, -1.0, 0.0), "fist", (0.8, -0.6, -0.2)),
    ArmKey(2.56, (-0.01, -0.10, 0.29), (-0.8, 0.05, 0.55), (0.0, -1.0, 0.0), "fist", (0.8, -0.6, -0.2)),
    ArmKey(2.72, (-0.01, -0.158, 0.30), (-0.8, -0.05, 0.55), (0.0, -1.0, 0.0), "fist", (0.8, -0.6, -0.2)),
    # "finished": spread hands turn from facing the signer to facing outward
    ArmKey(3.05, (0.14, -0.12, 0.27), **_FINGERS_UP_IN),
    ArmKey(3.13, (0.14, -0.115, 0.27), **_FINGERS_UP_IN),
    ArmKey(3.29, (0.205, -0.11, 0.29), (-0.15, 1.0, 0.3), (-1.0, -0.15, 0.1), "spread"),
    ArmKey(3.46, (0.27, -0.10, 0.30), **_FINGERS_UP_OUT),
    ArmKey(3.62, (0.275, -0.105, 0.30), **_FINGERS_UP_OUT),
    ArmKey(4.10, (0.23, -0.27, 0.26), (-0.15, -0.35, 1.0), (-0.4, -0.9, 0.0), "relaxed", (0.6, -0.7, -0.5)),
    ArmKey(4.85, **_ON_THIGH),
    ArmKey(5.80, **_ON_THIGH),
)
_LEFT_ARM: Sequence[ArmKey] = (
    ArmKey(0.00, **_HANGING),
    ArmKey(1.30, **_HANGING),
    ArmKey(1.80, **_READY),
    ArmKey(2.24, (0.14, -0.24, 0.28), (-0.85, 0.0, 0.5), (0.0, -1.0, 0.0), "fist", (0.8, -0.6, -0.2)),
    ArmKey(2.42, (0.14, -0.245, 0.28), (-0.85, 0.0, 0.5), (0.0, -1.0, 0.0), "fist", (0.8, -0.6, -0.2)),
    ArmKey(2.72, (0.14, -0.245, 0.28), (-0.85, 0.0, 0.5), (0.0, -1.0, 0.0), "fist", (0.8, -0.6, -0.2)),
    *_RIGHT_ARM[13:],
)
_ARMS = {"left": _LEFT_ARM, "right": _RIGHT_ARM}
# Pitch (forward), yaw (to the person's left), roll (to the person's right), degrees.
_HIPS_TURN: Sequence[Key] = (
    (0.0, (0, 0, 0)), (0.7, (0, -3, 1)), (1.7, (0, 4, -1)), (2.5, (2, 0, 0)), (3.5, (0, 0, 0)), (3.66, (2, 0, 0)),
    (4.05, (20, 0, 0)), (4.4, (28, 0, 0)), (4.85, (4, 0, 0)), (5.1, (-11, 0, 0)), (5.8, (-11, 0, 0)),
)  # fmt: skip
_SPINE_TURN: Sequence[Key] = (
    (0.0, (0, 0, 0)), (0.75, (-2, -6, 2)), (1.2, (0, -8, 3)), (1.75, (6, 10, -2)), (2.4, (7, 2, 0)), (3.1, (3, 0, 0)),
    (3.45, (-3, 0, 0)), (3.66, (2, 0, 0)), (4.05, (11, 0, 0)), (4.4, (16, 0, 0)), (4.9, (15, 0, 0)), (5.2, (9, 0, 0)),
    (5.8, (8, 3, 0)),
)  # fmt: skip
_HEAD_TURN: Sequence[Key] = (
    (0.0, (0, 8, 0)), (0.7, (-3, 4, 5)), (1.2, (2, 16, 2)), (1.75, (-3, 22, -3)), (2.4, (10, 6, 2)), (2.75, (9, 6, 2)),
    (3.1, (0, 8, 0)), (3.45, (-6, 12, 0)), (3.7, (4, 6, 0)), (4.05, (-4, 4, 0)), (4.4, (-16, 4, 0)),
    (4.9, (-6, 8, 0)), (5.2, (2, 14, -2)), (5.38, (10, 14, -2)), (5.56, (1, 15, -3)), (5.8, (1, 15, -3)),
)  # fmt: skip
_HIPS_PATH: Sequence[Key] = (
    (0.0, (0.004, -0.005, 0)), (1.1, (-0.012, -0.006, 0)), (2.1, (0.012, -0.007, 0.006)), (3.2, (0, -0.005, 0)),
    (3.66, (0, -0.007, 0)), (4.05, (0, -0.10, -0.16)), (4.4, (0, -0.25, -0.31)), (4.85, (0, -0.385, -0.385)),
    (5.0, (0, -0.392, -0.388)), (5.2, (0, -0.385, -0.388)), (5.8, (0, -0.385, -0.388)),
)  # fmt: skip
_JAW_DEGREES: Sequence[Key] = (
    (0.0, (0,)), (0.6, (0,)), (0.82, (6,)), (1.0, (2,)), (1.2, (7,)), (1.4, (1,)), (1.62, (1,)), (1.8, (5,)),
    (2.0, (1,)), (2.3, (2,)), (2.45, (6,)), (2.6, (2,)), (2.75, (6,)), (2.95, (1,)), (3.4, (7,)), (3.65, (0,)),
    (5.8, (0,)),
)  # fmt: skip
_BLINKS = (0.45, 1.47, 2.98, 4.12, 5.02)
_FACE: dict[str, Sequence[Key]] = {
    "blink": [key for t in _BLINKS for key in ((t - 0.1, (0,)), (t, (1.1,)), (t + 0.14, (0,)))],
    "smile": (
        (0.0, (0.1,)), (0.55, (0.1,)), (0.95, (1,)), (1.5, (0.3,)), (2.4, (0,)), (3.2, (0.2,)), (3.5, (0.7,)),
        (3.9, (0.1,)), (5.0, (0.1,)), (5.45, (1,)), (5.8, (1,)),
    ),
    "raised_brows": (
        (0.6, (0,)), (0.85, (1,)), (1.3, (0.2,)), (1.75, (1,)), (2.1, (0,)), (3.2, (0,)), (3.45, (0.8,)), (3.8, (0,)),
    ),
    "lowered_brows": ((2.1, (0,)), (2.4, (1,)), (2.8, (0.8,)), (3.05, (0,))),
}  # fmt: skip


_RIGHT_LOWER_LEG = ("right_knee", "right_ankle", "right_big_toe", "right_small_toe", "right_heel")
FAILURES = (
    Failure("dropped", 0.56, 0.80, ("right_hand",)),
    Failure("dropped", 3.12, 3.48, ("left_hand",)),
    Failure("swapped", 2.36, 2.56, ("arms",)),
    Failure("occluded", 4.24, 4.76, _RIGHT_LOWER_LEG),
    Failure("dropped", 4.40, 4.64, ("right_hand",)),
)
SCRIPT = Script(
    seconds=SECONDS,
    arms=_ARMS,
    hips_path=_HIPS_PATH,
    hips_turn=_HIPS_TURN,
    spine_turn=_SPINE_TURN,
    head_turn=_HEAD_TURN,
    jaw_degrees=_JAW_DEGREES,
    face=_FACE,
)
