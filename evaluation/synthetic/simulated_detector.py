"""What a keypoint detector would make of a clip whose truth is known: noise, doubt, and the usual failures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from evaluation.synthetic.acting.script import Failure, wander
from fitting_core.camera import Camera
from fitting_core.keypoints import BODY_25, COUNT, GROUPS, INDEX, LEFT_HAND, RIGHT_HAND, Keypoints

MISSING = 0.05
"""Points of lower confidence are not reported, as with OpenPose."""
_FLESH_MM = {
    "shoulder": 110, "elbow": 80, "wrist": 90, "hip": 190, "knee": 100, "ankle": 80, "neck": 120, "eye": 30, "ear": 35,
    "nose": 25, "toe": 40, "heel": 120,
}  # fmt: skip
"""How deep below the skin keypoints lie at most, by part of their name: what is in front of that hides them."""
_FLESH_OF_GROUP = {"body": 100, "left_hand": 30, "right_hand": 30, "face": 22}


@dataclass(frozen=True)
class _Quality:
    confidence: float
    """Of a point in full view."""
    noise: float
    """Standard deviation in pixels of such a point, in an image of 720 pixels height."""


_QUALITY = {
    "body": _Quality(0.88, 1.7), "left_hand": _Quality(0.80, 1.0), "right_hand": _Quality(0.80, 1.0),
    "face": _Quality(0.86, 0.6),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Detector:
    """How good a detector is; the values here are those of the demo clip."""

    noise: float = 1.0
    """Against the usual."""
    confidence: float = 1.0
    """Against the usual."""
    hidden: float = 0.3
    """Share of the confidence that is left where a point is out of view."""
    guess: float = 0.0
    """Standard deviation of a further error of body and hands out of view, which lasts; pixels at 720 pixels height."""
    lost: float = 0.0
    """Share of the frames out of view in which a point of body or hands is not reported at all."""
    bias: float = 0.0
    """Standard deviation of an error of each body point that stays for the whole clip; pixels at 720 pixels height."""


def flesh() -> Float[np.ndarray, "137"]:
    """How far in front of each keypoint its own skin can be, metres."""
    depth = np.zeros(COUNT)
    for name, group in GROUPS.items():
        depth[group] = _FLESH_OF_GROUP[name]
    for i, name in enumerate(BODY_25):
        depth[i] = next((mm for part, mm in _FLESH_MM.items() if name.endswith(part)), depth[i])
    return depth / 1000


def flesh_of(points: Float[np.ndarray, "137 3"], vertices: Float[np.ndarray, "V 3"]) -> Float[np.ndarray, "137"]:
    """The same for one shape, metres: stout people's keypoints lie deeper than `flesh` says.

    Args:
        points: Keypoints in the rest pose, z forward, metres.
        vertices: Of the rest pose.
    """
    depth = flesh()
    for i in range(len(BODY_25)):
        around = np.linalg.norm(vertices[:, :2] - points[i, :2], axis=1) < _AROUND
        skin = vertices[around, 2].max(initial=points[i, 2])
        depth[i] = max(depth[i], _ASLANT * (skin - points[i, 2]))
    return depth


_AROUND = 0.03
"""Metres beside a keypoint within which the skin in front of it is looked for."""
_ASLANT = 1.25
"""How much more flesh a keypoint has in front of it when seen aslant."""


def visible(
    points: Float[np.ndarray, "137 3"],
    depth: Float[np.ndarray, "H W"],
    camera: Camera,
    own: Float[np.ndarray, "137"] | None = None,
) -> Bool[np.ndarray, "137"]:
    """Which keypoints nothing but their own flesh hides.

    Args:
        points: Camera space, metres.
        depth: Image of the whole scene, metres.
        camera: Its size is the image's.
        own: Flesh in front of each, metres; None: `flesh`.
    """
    distance = np.where(points[:, 2:] > 0, points[:, 2:], np.inf)
    xy = points[:, :2] / distance * camera.focal + camera.center
    column, row = np.floor(xy).astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < camera.size[0]) & (row < camera.size[1])
    nearest = np.full(COUNT, np.inf)
    nearest[inside] = depth[row[inside], column[inside]]
    return inside & (nearest > points[:, 2] - (flesh() if own is None else own))


def detect(
    xy: Float[np.ndarray, "T 137 2"],
    seen: Bool[np.ndarray, "T 137"],
    exists: Bool[np.ndarray, "137"],
    *,
    frame_rate: float,
    height: int,
    failures: Sequence[Failure],
    rng: np.random.Generator,
    detector: Detector = Detector(),
) -> Keypoints:
    """Keypoints as detected.

    Confidence is high in full view, falls where a point is hidden or fast, and wanders. Noise grows as confidence
    falls; most of it lasts for some frames, as a detector's error does, the rest is new in each. Then the failures.

    Args:
        xy: The true keypoints in pixels.
        seen: Whether each is in view.
        exists: Keypoints that the body has; the others are never reported.
        frame_rate: Frames per second.
        height: Of the image, pixels.
        failures: Stretches in which something goes wrong.
        rng: Source of all chance.
        detector: How good it is.
    """
    times = np.arange(len(xy)) / frame_rate
    view = _view(seen, times)
    confidence = detector.confidence * _confidence(xy, view, times, height, detector.hidden, rng) * exists
    slow = wander(rng, times, 2 * COUNT, seconds=0.12).reshape(xy.shape)
    noise = 0.8 * slow + 0.6 * rng.standard_normal(xy.shape)
    doubt = (1 - confidence)[..., None]
    scale = detector.noise * _per_point(lambda quality: quality.noise)[:, None] * height / 720
    found = xy + noise * scale * (0.6 + 4 * doubt**2)
    if detector != Detector():
        found += _lasting(view, times, detector, rng) * height / 720
        confidence[_lost(view, times, detector.lost, rng)] = 0.0
    for failure in failures:
        frames = np.flatnonzero((times >= failure.start - 1e-9) & (times < failure.stop - 1e-9))
        if len(frames):
            FAILURES[failure.kind](found, confidence, frames, failure.groups, rng)
    missing = confidence < MISSING
    found[missing], confidence[missing] = 0.0, 0.0
    # As files of detectors have them: no more digits than they are good for.
    return Keypoints(xy=np.round(found, 3), confidence=np.round(confidence, 4))


def _per_point(value: Callable[[_Quality], float]) -> Float[np.ndarray, "137"]:
    result = np.zeros(COUNT)
    for name, group in GROUPS.items():
        result[group] = value(_QUALITY[name])
    return result


def _view(seen: np.ndarray, times: np.ndarray) -> Float[np.ndarray, "T 137"]:
    """How far points are in view, 0 to 1: it takes a detector some frames to lose and to find one."""
    step = times[1] - times[0] if len(times) > 1 else 1.0
    return gaussian_filter1d(seen.astype(float), 0.06 / step, axis=0, mode="nearest")


def _lasting(
    view: np.ndarray, times: np.ndarray, detector: Detector, rng: np.random.Generator
) -> Float[np.ndarray, "T 137 2"]:
    """Errors that last, in pixels at 720 pixels height: of body points always, of what is out of view more."""
    guess = wander(rng, times, 2 * COUNT, seconds=0.35).reshape(len(times), COUNT, 2)
    for hand in (LEFT_HAND, RIGHT_HAND):
        # A hand out of view is guessed as a whole.
        guess[:, hand] = 0.3 * guess[:, hand] + 0.95 * guess[:, hand.start, None]
    guess *= _GUESSED[:, None]
    bias = np.zeros((COUNT, 2))
    bias[GROUPS["body"]] = rng.standard_normal((len(BODY_25), 2))
    return detector.guess * (1 - view)[..., None] * guess + detector.bias * bias


def _lost(view: np.ndarray, times: np.ndarray, share: float, rng: np.random.Generator) -> Bool[np.ndarray, "T 137"]:
    """Points out of view that are not reported; a hand is lost as a whole."""
    mood = wander(rng, times, COUNT, seconds=0.3)
    for hand in (LEFT_HAND, RIGHT_HAND):
        mood[:, hand] = mood[:, hand.start, None]
    mood[:, GROUPS["face"]] = np.inf
    return (view < 0.5) & (mood < NormalDist().inv_cdf(share) if share > 0 else False)


_LIMB = ("elbow", "wrist", "hip", "knee", "ankle")
_GUESSED = np.ones(COUNT)
"""How large the errors of guesses are: what is on the trunk, the head or a foot in view can hardly be elsewhere."""
_GUESSED[GROUPS["body"]] = [1.0 if name.endswith(_LIMB) else 0.4 for name in BODY_25]
_GUESSED[GROUPS["face"]] = 0.0


def _confidence(
    xy: np.ndarray, view: np.ndarray, times: np.ndarray, height: int, hidden: float, rng: np.random.Generator
) -> Float[np.ndarray, "T 137"]:
    step = times[1] - times[0] if len(times) > 1 else 1.0
    speed = np.linalg.norm(np.gradient(xy, step, axis=0), axis=2) / height if len(xy) > 1 else np.zeros(xy.shape[:2])
    best = _per_point(lambda quality: quality.confidence)
    # A point that crosses the image's height in 1.5 s is blurred enough to halve the confidence.
    confidence = best * (hidden + (1 - hidden) * view) / (1 + (speed / 0.7) ** 2)
    return np.clip(confidence + 0.05 * wander(rng, times, COUNT, seconds=0.2), 0.0, 1.0)


def _indices(names: Sequence[str]) -> np.ndarray:
    """Keypoints of some names or groups."""
    found = [np.arange(COUNT)[GROUPS[name]] if name in GROUPS else np.array([INDEX[name]]) for name in names]
    return np.concatenate(found)


def _drop(xy: np.ndarray, confidence: np.ndarray, frames: np.ndarray, names: Sequence[str], _: object) -> None:
    """Not found at all."""
    confidence[np.ix_(frames, _indices(names))] = 0.0


def _swap(xy: np.ndarray, confidence: np.ndarray, frames: np.ndarray, names: Sequence[str], _: object) -> None:
    """Left taken for right, with all the confidence in the world."""
    left, right = _sides(names)
    for values in (xy, confidence):
        values[np.ix_(frames, np.concatenate([left, right]))] = values[np.ix_(frames, np.concatenate([right, left]))]


def _sides(names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """The left and right keypoints of limbs."""
    parts = {"arms": ("elbow", "wrist"), "legs": ("knee", "ankle", "big_toe", "small_toe", "heel")}
    pairs = [(INDEX[f"left_{p}"], INDEX[f"right_{p}"]) for name in names for p in parts[name]]
    if "arms" in names:
        pairs += zip(range(COUNT)[LEFT_HAND], range(COUNT)[RIGHT_HAND], strict=True)
    left, right = np.array(pairs).T
    return left, right


def _occlude(
    xy: np.ndarray, confidence: np.ndarray, frames: np.ndarray, names: Sequence[str], rng: np.random.Generator
) -> None:
    """Guessed: far off, together, and with little confidence; some not at all."""
    points = _indices(names)
    inside = np.sin(np.pi * (np.arange(len(frames)) + 0.5) / len(frames))
    xy[np.ix_(frames, points)] += inside[:, None, None] * rng.normal(0.0, 18.0, (1, 1, 2))
    confidence[np.ix_(frames, points)] *= (1 - 0.75 * inside)[:, None]
    lost = rng.random((len(frames), len(points))) < 0.3 * inside[:, None]
    confidence[np.ix_(frames, points)] *= ~lost


FAILURES: dict[str, Callable[..., None]] = {"dropped": _drop, "swapped": _swap, "occluded": _occlude}
"""By kind; each changes positions and confidences in place, at some frames and names."""
