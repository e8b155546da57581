"""What a performance is written in: keyframes of trunk, arms, feet and face, the build that they are fitted to, and
where a detector fails.

World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from fitting_core.body.model import JOINT, BodyModel, other_side
from fitting_core.keypoints import Side

Key = tuple[float, Sequence[float] | np.ndarray]
"""A time in seconds and the value there."""


def through(keys: Sequence[Key], times: Float[np.ndarray, "T"], *, smoothing: float = 0.04) -> Float[np.ndarray, "T D"]:
    """Values at `times` (seconds, evenly spaced) of a smooth path through the keys, held before and after them.

    Between keys the path is a monotone cubic: it rests where two neighbouring keys agree or where it turns back,
    and never overshoots. A Gaussian of `smoothing` seconds then takes the jumps out of its acceleration, as muscles
    would; it rounds a key of that length off.
    """
    at = np.array([time for time, _ in keys])
    values = np.array([value for _, value in keys], float)
    assert (np.diff(at) > 0).all(), "keys must be in the order of time"
    if len(keys) == 1:
        return np.tile(values, (len(times), 1))
    path = PchipInterpolator(at, values)(np.clip(times, at[0], at[-1]))
    if len(times) < 2 or smoothing == 0:
        return path
    return gaussian_filter1d(path, smoothing / (times[1] - times[0]), axis=0, mode="nearest")


def directions_through(
    keys: Sequence[Key], times: Float[np.ndarray, "T"], *, smoothing: float = 0.04
) -> Float[np.ndarray, "T 3"]:
    """Unit vectors on a smooth path through the keys' directions; neighbouring keys must not be opposite."""
    units = [(time, np.asarray(value, float) / np.linalg.norm(value)) for time, value in keys]
    path = through(units, times, smoothing=smoothing)
    return path / np.linalg.norm(path, axis=1, keepdims=True)


def wander(
    rng: np.random.Generator, times: Float[np.ndarray, "T"], size: int, *, seconds: float
) -> Float[np.ndarray, "T size"]:
    """Smooth random motion of unit variance whose values are alike over about that many seconds."""
    step = times[1] - times[0] if len(times) > 1 else 1.0
    sigma = seconds / step
    margin = int(4 * sigma) + 1
    noise = gaussian_filter1d(rng.standard_normal((len(times) + 2 * margin, size)), sigma, axis=0)
    # A Gaussian of width sigma leaves 1 / (2 sqrt(pi) sigma) of white noise's variance (a narrow one leaves all).
    return noise[margin : margin + len(times)] * np.sqrt(max(1.0, 2 * np.sqrt(np.pi) * sigma))


Vector = tuple[float, float, float]
SIDES: dict[Side, float] = {"left": 1.0, "right": -1.0}
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
    """Strength (0 to 1) over time of gestures of evaluation.synthetic.acting.performance."""


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
    """One of FAILURES in evaluation.synthetic.simulated_detector."""
    start: float
    stop: float
    """Seconds; the frame at `stop` is fine again."""
    groups: tuple[str, ...]
    """Names of keypoints or their beginnings, as in fitting_core.keypoints.NAMES."""


@dataclass(frozen=True)
class Hazard:
    """A stretch of a performance that is hard for a detector."""

    kind: str
    """Of the failure, one of FAILURES in evaluation.synthetic.simulated_detector."""
    start: float
    stop: float
    """Seconds."""
    groups: tuple[str, ...]
    """As of Failure."""
    likely: float = 1.0
    """Of a failure here, against the usual."""


@dataclass(frozen=True, kw_only=True)
class Mishaps:
    """How often hazards turn into failures, and for how long."""

    chance: float
    """That there is a failure in a hazard's stretch."""
    seconds: tuple[float, float]
    """Shortest and longest failure; none outlasts its stretch."""


def mirrored_hazards(hazards: Sequence[Hazard]) -> list[Hazard]:
    """Where a detector fails on the performance in a mirror."""
    return [replace(hazard, groups=tuple(map(other_side, hazard.groups))) for hazard in hazards]


def failures(hazards: Sequence[Hazard], mishaps: Mishaps, rng: np.random.Generator) -> list[Failure]:
    """Failures by chance. The same source of chance gives at least the failures of lower chances, and longer ones."""
    found = []
    for hazard in hazards:
        happens, length, place = rng.random(3)
        if happens < mishaps.chance * hazard.likely:
            shortest, longest = mishaps.seconds
            seconds = min(shortest + length * (longest - shortest), hazard.stop - hazard.start)
            start = hazard.start + place * (hazard.stop - hazard.start - seconds)
            found.append(Failure(hazard.kind, start, start + seconds, hazard.groups))
    return found


_LEG, _ARM, _HALF_WIDTH = 0.820, 0.496, 0.195
"""Of the free neutral body's mean shape, for which scripts are written, metres."""


@dataclass(frozen=True, kw_only=True)
class Build:
    """A body's measures against those of the free neutral body's mean shape."""

    leg: float
    """Ratio of the lengths from hip to ankle."""
    arm: float
    """Ratio of the lengths from shoulder to wrist."""
    stout: float
    """How much wider half the hips are, metres."""

    @staticmethod
    def of(body: BodyModel, betas: Sequence[float]) -> "Build":
        """Measures of a shape in the rest pose."""
        shaped = body.with_shape(betas)
        joints = shaped.rest_joints
        bone = [np.linalg.norm(joints[JOINT[a]] - joints[JOINT[b]]) for a, b in _BONES]
        hips = shaped.template[abs(shaped.template[:, 1] - joints[JOINT["left_hip"], 1]) < 0.05]
        return Build(
            leg=float(bone[0] + bone[1]) / _LEG,
            arm=float(bone[2] + bone[3]) / _ARM,
            stout=float(abs(hips[:, 0]).max()) - _HALF_WIDTH,
        )


_BONES = (
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
)


def hanging(time: float, build: Build, forward: float = 0.055) -> ArmKey:
    """An arm that hangs beside the body, its wrist this far ahead, in metres."""
    wrist = (0.235 + build.stout, -0.445 * build.arm, forward)
    return ArmKey(time, wrist, (0.06, -1.0, 0.42), (-1.0, 0.0, -0.15), "relaxed", (0.35, -0.1, -1.0))
