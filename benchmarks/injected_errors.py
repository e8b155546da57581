"""Ten kinds of error, as detectors and fits make them, put into clips that are known to be right.

Lengths are in trunks: the median distance of the true neck from the true hips in the image.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.fit.evidence.sides import PAIRED
from fitting_core.keypoints import COUNT, INDEX, LEFT_HAND, RIGHT_HAND, Keypoints

_SEEN = 0.4
"""Confidence from which a point is in clear view: an error in what nobody sees is none."""
_OFTEN = 0.8
"""Share of an error's points and frames that are in clear view."""
_APART = 0.25
"""Trunks between left and right ends of limbs that are exchanged: nearer ones look alike either way."""
_MOVES = 0.1
"""Trunks by which keypoints must really move while they are frozen."""
_HANDS = {"left": tuple(range(COUNT)[LEFT_HAND]), "right": tuple(range(COUNT)[RIGHT_HAND])}
_ENDS = tuple((INDEX[f"{side}_{part}"],) for part in ("wrist", "ankle", "elbow", "knee") for side in ("left", "right"))
_ARMS = tuple((INDEX[f"{side}_elbow"], INDEX[f"{side}_wrist"], *_HANDS[side]) for side in ("left", "right"))
_LEGS = tuple(
    tuple(INDEX[f"{side}_{part}"] for part in ("knee", "ankle", "big_toe", "small_toe", "heel"))
    for side in ("left", "right")
)
_PAIRS = tuple((*left, *right, *others[0], *others[1]) for left, right, others in PAIRED.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """A clip's detections before anything was done to them."""

    keypoints: Keypoints
    trunk: float
    """Pixels."""
    others: Keypoints
    """Of somebody else in an image of the same size, for at least as many frames."""

    @property
    def clear(self) -> Bool[np.ndarray, "T 137"]:
        """Which points are in clear view."""
        return self.keypoints.confidence > _SEEN


@dataclass(frozen=True, kw_only=True, eq=False)
class Injected:
    """An error in some frames."""

    kind: str
    keypoints: Keypoints
    frames: range
    joints: tuple[int, ...]
    """Keypoints that are wrong."""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """How an error of a kind comes about."""

    frames: tuple[int, int]
    """It lasts at least and at most so many."""
    of: Sequence[tuple[int, ...]]
    """Groups of keypoints that it can be about; none: the whole body, as far as it is in view."""
    spoil: Callable[[Seen, np.ndarray, np.ndarray, np.random.Generator], Keypoints | None]
    """From frames and keypoints to the detections with the error; None where it would change nothing."""


def inject(kind: str, seen: Seen, rng: np.random.Generator) -> Injected | None:
    """Put one error of a kind into a clip, somewhere it matters; None where there is no such place."""
    how = ERRORS[kind]
    for frames, joints in _places(seen, how, rng):
        spoilt = how.spoil(seen, np.array(frames), np.array(joints), rng)
        if spoilt is not None:
            return Injected(kind=kind, keypoints=spoilt, frames=frames, joints=joints)
    return None


def clear_places(
    seen: Seen, frames: int, groups: Sequence[tuple[int, ...]], rng: np.random.Generator
) -> Iterator[tuple[range, tuple[int, ...]]]:
    """Where so many frames begin in which a group of keypoints is in clear view, and that group; in random order."""
    starts = [(start, group) for group in groups for start in range(2, len(seen.keypoints) - frames - 1)]
    for i in rng.permutation(len(starts)):
        start, group = starts[i]
        if seen.clear[start : start + frames, list(group)].mean() >= _OFTEN:
            yield range(start, start + frames), group


def _places(seen: Seen, how: Kind, rng: np.random.Generator) -> Iterator[tuple[range, tuple[int, ...]]]:
    frames = int(rng.integers(how.frames[0], how.frames[1] + 1))
    if how.of:
        yield from clear_places(seen, frames, how.of, rng)
        return
    for which, _ in clear_places(seen, frames, ((INDEX["neck"], INDEX["nose"]),), rng):
        yield which, tuple(np.flatnonzero(seen.clear[list(which)].mean(0) >= _OFTEN).tolist())


def _with(
    seen: Seen,
    frames: np.ndarray,
    joints: np.ndarray,
    xy: Float[np.ndarray, "F J 2"] | None,
    confidence: Float[np.ndarray, "F J"] | float | None = None,
) -> Keypoints:
    at = np.ix_(frames, joints)
    places, trust = seen.keypoints.xy.copy(), seen.keypoints.confidence.copy()
    if xy is not None:
        places[at] = np.where(trust[at][..., None] > 0, xy, places[at])
    if confidence is not None:
        trust[at] = confidence
        places[at] = np.where(trust[at][..., None] > 0, places[at], 0)
    return replace(seen.keypoints, xy=places, confidence=trust)


def _there(seen: Seen, frames: np.ndarray, joints: np.ndarray) -> Float[np.ndarray, "F J 2"]:
    return seen.keypoints.xy[np.ix_(frames, joints)]


def _way(seen: Seen, low: float, high: float, rng: np.random.Generator) -> Float[np.ndarray, "2"]:
    """A way in the image between so many trunks, in any direction; pixels."""
    angle, length = rng.uniform(0, 2 * np.pi), rng.uniform(low, high) * seen.trunk
    return length * np.array([np.cos(angle), np.sin(angle)])


def _swap(seen: Seen, frames: np.ndarray, joints: np.ndarray, _: np.random.Generator) -> Keypoints | None:
    """Left taken for right."""
    left, right, others = next(pair for pair in PAIRED.values() if pair[0][0] in joints)
    apart = np.linalg.norm(
        _there(seen, frames, np.array(left[:2])) - _there(seen, frames, np.array(right[:2])), axis=-1
    )
    if apart.mean() < _APART * seen.trunk:
        return None
    lefts, rights = np.array([*left, *others[0]]), np.array([*right, *others[1]])
    xy, confidence = seen.keypoints.xy.copy(), seen.keypoints.confidence.copy()
    for values, old in ((xy, seen.keypoints.xy), (confidence, seen.keypoints.confidence)):
        values[np.ix_(frames, lefts)] = old[np.ix_(frames, rights)]
        values[np.ix_(frames, rights)] = old[np.ix_(frames, lefts)]
    return replace(seen.keypoints, xy=xy, confidence=confidence)


def _drop(seen: Seen, frames: np.ndarray, joints: np.ndarray, _: np.random.Generator) -> Keypoints:
    """Not found."""
    return _with(seen, frames, joints, None, 0.0)


def _jump(seen: Seen, frames: np.ndarray, joints: np.ndarray, rng: np.random.Generator) -> Keypoints:
    """Somewhere else for a moment, with all confidence."""
    return _with(seen, frames, joints, _there(seen, frames, joints) + _way(seen, 0.3, 0.6, rng))


def _drift(seen: Seen, frames: np.ndarray, joints: np.ndarray, rng: np.random.Generator) -> Keypoints:
    """Farther and farther off, and back at once."""
    share = np.linspace(0, 1, len(frames))[:, None, None]
    return _with(seen, frames, joints, _there(seen, frames, joints) + share * _way(seen, 0.3, 0.5, rng))


def _wrong_person(seen: Seen, frames: np.ndarray, joints: np.ndarray, _: np.random.Generator) -> Keypoints:
    """Somebody else who is in the image too."""
    everybody = np.arange(COUNT)
    others = seen.others[: len(frames)]
    xy, confidence = seen.keypoints.xy.copy(), seen.keypoints.confidence.copy()
    xy[np.ix_(frames, everybody)], confidence[frames] = others.xy, others.confidence
    return replace(seen.keypoints, xy=xy, confidence=confidence)


def _frozen(seen: Seen, frames: np.ndarray, joints: np.ndarray, _: np.random.Generator) -> Keypoints | None:
    """Stays where it was, as with a tracker that has lost its frames."""
    there = _there(seen, frames, joints)
    still = np.broadcast_to(there[:1], there.shape)
    if np.linalg.norm(there - still, axis=-1).max(0).max() < _MOVES * seen.trunk:
        return None
    return _with(seen, frames, joints, still)


def _offset(seen: Seen, frames: np.ndarray, joints: np.ndarray, rng: np.random.Generator) -> Keypoints:
    """Beside where it is, all the time."""
    return _with(seen, frames, joints, _there(seen, frames, joints) + _way(seen, 0.2, 0.35, rng))


def _scale(seen: Seen, frames: np.ndarray, joints: np.ndarray, rng: np.random.Generator) -> Keypoints:
    """Too large or too small, as from a wrong crop."""
    there = _there(seen, frames, joints)
    factor = rng.uniform(1.2, 1.4) if rng.random() < 0.5 else rng.uniform(0.65, 0.8)
    middle = there.mean((0, 1))
    return _with(seen, frames, joints, middle + factor * (there - middle))


ERRORS = {
    "swap": Kind(frames=(3, 8), of=_PAIRS, spoil=_swap),
    "drop": Kind(frames=(8, 15), of=_ENDS, spoil=_drop),
    "jump": Kind(frames=(1, 2), of=_ENDS, spoil=_jump),
    "drift": Kind(frames=(15, 25), of=_ENDS, spoil=_drift),
    "wrong person": Kind(frames=(5, 10), of=(), spoil=_wrong_person),
    "frozen": Kind(frames=(10, 15), of=(*_ARMS, *_LEGS), spoil=_frozen),
    "hand lost": Kind(frames=(10, 20), of=tuple(_HANDS.values()), spoil=_drop),
    "offset": Kind(frames=(12, 18), of=(*_ARMS, *_LEGS), spoil=_offset),
    "scale": Kind(frames=(8, 15), of=(), spoil=_scale),
}
"""By name; "flip" is one in the fit, not in the detections."""


def trunk_of(truth: Float[np.ndarray, "T 137 2"]) -> float:
    """The unit of lengths, pixels."""
    return float(np.median(np.linalg.norm(truth[:, INDEX["neck"]] - truth[:, INDEX["mid_hip"]], axis=-1)))
