"""A detector of body keypoints whose errors were measured on real detections, and not imagined."""

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float
from scipy.signal import lfilter

from fitting_core.keypoints import BODY, BODY_25, COUNT, INDEX, Keypoints

_HEAD = ("nose", "right_eye", "left_eye", "right_ear", "left_ear")
_SOLES = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("big_toe", "small_toe", "heel"))
_HIPS = ("mid_hip", "left_hip", "right_hip")
_HINGES = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("elbow", "knee"))
_OUTLYING = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("wrist", "ankle"))
_LIMBS = (*_HINGES, *_OUTLYING, *_SOLES)


@dataclass(frozen=True, kw_only=True)
class MeasuredErrors:
    """How a detector errs; measured on OpenPose detections against a triangulated reference of two views.

    Lengths are metres at the body, standard deviations along the image's x and y each.
    """

    lasting: float = 0.012
    """Error that stays for a whole clip."""
    lasting_of_hips: float = 0.03
    lasting_of_soles: float = 0.03
    lasting_of_head: float = 0.01
    changing: float = 0.012
    """Error that comes and goes, wrists included."""
    changing_of_hinges: float = 0.02
    """Of elbows and knees."""
    changing_of_hips: float = 0.02
    changing_of_soles: float = 0.025
    memory: tuple[tuple[float, float], ...] = ((0.6, 0.12), (0.15, 0.025))
    """Shares of the changing error's variance with the seconds after which they are forgotten; the rest is new in every
    frame. Measured autocorrelation: 0.6 after 1/60 s, 0.3 after 5/60, 0.15 after 10/60."""
    outlying: float = 0.03
    """Share of the frames in which a wrist or ankle is somewhere else."""
    outlying_by: tuple[float, float] = (0.05, 0.4)
    outlying_seconds: tuple[float, float] = (1 / 30, 0.2)
    """How long that lasts. Not measured."""
    confidence: float = 0.65
    confidence_spread: float = 0.1
    confidence_of_soles: tuple[float, float] = (0.4, 0.6)
    confidence_of_hidden: float = 0.3
    """Of a limb behind the trunk or another limb."""
    noise_of_hidden: float = 2.0
    """By how much the changing error of hidden points is larger."""
    confidence_of_turned: tuple[float, float] = (0.1, 0.2)
    """Of points of a head that is turned away."""
    lost_of_turned: tuple[float, float] = (0.1, 1.0)
    """Share of the frames in which nose and far eye of a head that is turned away are not found; by clip."""


MEASURED = MeasuredErrors()


def detected(
    xy: Float[np.ndarray, "T 137 2"],
    seen: Bool[np.ndarray, "T 137"],
    inside: Bool[np.ndarray, "T 137"],
    pixels_per_metre: Float[np.ndarray, "T 137"],
    *,
    frame_rate: float,
    rng: np.random.Generator,
    errors: MeasuredErrors = MEASURED,
) -> Keypoints:
    """Body keypoints as that detector finds them; it finds no hands and no face.

    Args:
        xy: The true keypoints, pixels.
        seen: Which of them nothing hides.
        inside: Which lie in the image; others are not found.
        pixels_per_metre: At each keypoint.
        frame_rate: Frames per second.
        rng: Source of all chance.
        errors: How it errs.
    """
    frames, hidden = len(xy), ~seen[:, BODY]
    noise = _remembered(rng, (frames, len(BODY_25), 2), frame_rate, errors)
    noise *= _by_point(errors.changing, _changing(errors))[:, None]
    noise *= np.where(hidden, errors.noise_of_hidden, 1.0)[..., None]
    noise += rng.standard_normal((len(BODY_25), 2)) * _by_point(errors.lasting, _lasting(errors))[:, None]
    noise += _outliers(rng, frames, frame_rate, errors)
    confidence = _confidence(rng, hidden, frame_rate, errors)
    confidence *= inside[:, BODY] & ~_lost(rng, hidden, frame_rate, errors)
    found, doubt = np.zeros((frames, COUNT, 2)), np.zeros((frames, COUNT))
    found[:, BODY] = xy[:, BODY] + noise * pixels_per_metre[:, BODY, None]
    doubt[:, BODY] = confidence
    return Keypoints(xy=np.where(doubt[..., None] > 0, found, 0.0), confidence=doubt)


def _lasting(errors: MeasuredErrors) -> dict[tuple[str, ...], float]:
    return {_HIPS: errors.lasting_of_hips, _SOLES: errors.lasting_of_soles, _HEAD: errors.lasting_of_head}


def _changing(errors: MeasuredErrors) -> dict[tuple[str, ...], float]:
    return {_HIPS: errors.changing_of_hips, _SOLES: errors.changing_of_soles, _HINGES: errors.changing_of_hinges}


def _by_point(usual: float, others: dict[tuple[str, ...], float]) -> Float[np.ndarray, "25"]:
    values = np.full(len(BODY_25), usual)
    for names, value in others.items():
        values[_indices(names)] = value
    return values


def _indices(names: tuple[str, ...]) -> list[int]:
    return [INDEX[name] for name in names]


def _remembered(
    rng: np.random.Generator, shape: tuple[int, ...], frame_rate: float, errors: MeasuredErrors
) -> np.ndarray:
    """Noise of unit variance with the measured memory, along the first axis."""
    fresh = 1 - sum(share for share, _ in errors.memory)
    noise = np.sqrt(fresh) * rng.standard_normal(shape)
    for share, seconds in errors.memory:
        kept = np.exp(-1 / (frame_rate * seconds))
        new = rng.standard_normal(shape)
        new[1:] *= np.sqrt(1 - kept**2)
        noise += np.sqrt(share) * lfilter([1.0], [1.0, -kept], new, axis=0)
    return noise


def _outliers(
    rng: np.random.Generator, frames: int, frame_rate: float, errors: MeasuredErrors
) -> Float[np.ndarray, "T 25 2"]:
    """Errors of wrists and ankles in bursts, each to one side."""
    away = np.zeros((frames, len(BODY_25), 2))
    low, high = (seconds * frame_rate for seconds in errors.outlying_seconds)
    begins = errors.outlying / ((low + high) / 2)
    for point in _indices(_OUTLYING):
        # Bursts that began before the first frame count too.
        for start in np.flatnonzero(rng.random(frames + int(high)) < begins) - int(high):
            end, angle = start + rng.uniform(low, high), rng.uniform(0, 2 * np.pi)
            way = rng.uniform(*errors.outlying_by) * np.array([np.cos(angle), np.sin(angle)])
            away[max(start, 0) : max(round(end), 0), point] = way
    return away


def _confidence(
    rng: np.random.Generator, hidden: Bool[np.ndarray, "T 25"], frame_rate: float, errors: MeasuredErrors
) -> Float[np.ndarray, "T 25"]:
    mood = _remembered(rng, hidden.shape, frame_rate, errors)
    share = _uniform(mood)
    found = errors.confidence + errors.confidence_spread * mood
    soles, head, limbs = _indices(_SOLES), _indices(_HEAD), _indices(_LIMBS)
    found[:, soles] = _within(errors.confidence_of_soles, share[:, soles])
    behind = errors.confidence_of_hidden * (0.8 + 0.4 * share[:, limbs])
    found[:, limbs] = np.where(hidden[:, limbs], behind, found[:, limbs])
    turned = _within(errors.confidence_of_turned, share[:, head])
    found[:, head] = np.where(hidden[:, head], turned, found[:, head])
    return found.clip(0.05, 0.98)


def _lost(
    rng: np.random.Generator, hidden: Bool[np.ndarray, "T 25"], frame_rate: float, errors: MeasuredErrors
) -> Bool[np.ndarray, "T 25"]:
    """Nose and eyes of heads that are turned away, in stretches."""
    mood = _uniform(_remembered(rng, hidden.shape, frame_rate, errors))
    lost = np.zeros(hidden.shape, bool)
    face = _indices(_HEAD[:3])
    lost[:, face] = hidden[:, face] & (mood[:, face] < rng.uniform(*errors.lost_of_turned))
    return lost


_NORMAL = np.vectorize(NormalDist().cdf)


def _uniform(mood: np.ndarray) -> np.ndarray:
    """Numbers from 0 to 1, alike where the normal ones are."""
    return _NORMAL(mood)


def _within(limits: tuple[float, float], share: np.ndarray) -> np.ndarray:
    return limits[0] + (limits[1] - limits[0]) * share
