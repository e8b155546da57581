"""What a performance is written in: keyframes of trunk, arms, feet and face.

World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting_core.synthetic.acting.keyframes import Key

Vector = tuple[float, float, float]
SIDES = {"left": 1.0, "right": -1.0}
"""Each side with the sign of its x."""


@dataclass(frozen=True)
class ArmKey:
    """An arm at one time. Written for the left arm; the right one mirrors x."""

    time: float
    wrist: Vector
    """From the anchor, metres. On the floor y is the height of the hand's lowest point."""
    fingers: Vector
    """World direction of the straight fingers."""
    palm: Vector
    """World direction that the palm faces."""
    shape: str
    """One of HANDSHAPES."""
    elbow: Vector = (0.6, -0.8, -0.35)
    """World direction in which the elbow points."""
    anchor: str = "chest"
    """What the wrist is counted from: "chest", the middle between the shoulders in the chest's axes; "knee", the arm's
    own side's, in the world's axes; "floor", the world itself."""


@dataclass(frozen=True)
class FootKey:
    """A foot at one time. Written for the left foot; the right one mirrors x."""

    time: float
    place: tuple[float, float]
    """x and z of the outer ball of the foot (below the root of the little toe), which stays where a foot rolls."""
    yaw: float = 9.0
    """Degrees that the toes point outward."""
    roll: float = 0.0
    """Degrees that the foot lies on its outer edge; the sole faces inward at 90."""
    heel: float = 0.0
    """Degrees that the heel is raised, with the toes flat on the floor."""
    lift: float = 0.0
    """Height of the foot's lowest point, metres."""
    knee: Vector = (0.22, 0.0, 1.0)
    """World direction in which the knee points."""


STANDING = (FootKey(0.0, (0.172, 0.16)),)


@dataclass(frozen=True, kw_only=True)
class Script:
    """A performance. Turns: pitch (forward), yaw (to the person's left) and roll (to the person's right), degrees."""

    seconds: float
    arms: Mapping[str, Sequence[ArmKey]]
    """By side."""
    hips_path: Sequence[Key] = ((0.0, (0.0, 0.0, 0.0)),)
    """Of the pelvis joint, from where it is when the person stands upright."""
    hips_turn: Sequence[Key] = ((0.0, (0.0, 0.0, 0.0)),)
    spine_turn: Sequence[Key] = ((0.0, (0.0, 0.0, 0.0)),)
    head_turn: Sequence[Key] = ((0.0, (0.0, 0.0, 0.0)),)
    feet: Mapping[str, Sequence[FootKey]] = field(default_factory=lambda: dict.fromkeys(SIDES, STANDING))
    """By side."""
    on_floor: Sequence[Key] = ((0.0, (0.0,)),)
    """1 while the person sits on the floor: the hips then take the height at which the seat touches it."""
    jaw_degrees: Sequence[Key] = ((0.0, (0.0,)),)
    face: Mapping[str, Sequence[Key]] = field(default_factory=dict)
    """Strength (0 to 1) over time of gestures of fitting_core.synthetic.acting.gestures."""


def mirrored(script: Script) -> Script:
    """The same performance in a mirror: left and right change places."""

    def keys(track: Sequence[Key], signs: Vector) -> Sequence[Key]:
        return [(time, np.multiply(value, signs)) for time, value in track]

    turns = {name: keys(getattr(script, name), (1, -1, -1)) for name in ("hips_turn", "spine_turn", "head_turn")}
    swapped = {
        name: {"left": getattr(script, name)["right"], "right": getattr(script, name)["left"]}
        for name in ("arms", "feet")
    }
    return replace(script, hips_path=keys(script.hips_path, (-1, 1, 1)), **turns, **swapped)


@dataclass(frozen=True)
class Failure:
    """A stretch in which the detector fails."""

    kind: str
    """One of FAILURES in fitting_core.synthetic.simulated_detector."""
    start: float
    stop: float
    """Seconds; the frame at `stop` is fine again."""
    groups: tuple[str, ...]
    """Names of keypoints or their beginnings, as in fitting_core.keypoints.NAMES."""
