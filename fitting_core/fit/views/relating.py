"""How other views relate to the first clip, or why they do not."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fitting_core import keypoints as kp
from fitting_core.camera import matrix_of, vector_of
from fitting_core.clip import Clip, OtherView, Relation
from fitting_core.errors import InputError
from fitting_core.fit.views.pose import PairOfRays, Pose, alike, misses
from fitting_core.fit.views.track import Track

_MOST_COST = 1.8
"""Of a pose whose rays meet: right ones of synthetic and real pairs had 0.7 to 1.5, wrong ones 0.8 to 2.6."""
_LEAST_ALIKE = 0.6
"""Of motions that are the same: right ones had 0.67 to 0.98, wrong ones up to 0.52, but for one of 0.71."""
_LEAST_MOTION = 1.2
"""In standard deviations of the keypoints' noise: with less, the offset cannot be determined."""
_MOST_DISAGREEMENT = 0.015
"""Radians."""
_MOST_UNSURE = 15.0
"""Degrees by which the direction from camera to camera may be unsure."""
_MOST_DISTANT = 1.6
"""Ratio of the distance from camera to camera to what the lifter says of it, or of that to the distance."""
_SAME_OFFSET = 0.03
"""Seconds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    pose: Pose
    alike: float
    motion: tuple[float, float]

    @property
    def score(self) -> float:
        """Less is better: short overlaps with few keypoints meet well anywhere, but move differently."""
        return self.pose.cost / max(self.alike, 0.05)


def related(clip: Clip, views: Sequence[OtherView] = ()) -> Clip:
    """The clip with other views of its person, each related to it.

    Args:
        clip: The first view, at its frame rate; its views that are not related yet, are.
        views: Further ones; those with a relation keep it.

    Raises:
        InputError: A view does not show the same person at the same time, or it cannot be determined.
    """
    views = (*clip.views, *views)
    if all(view.relation for view in views):
        return replace(clip, views=views)
    first = Track(clip)
    return replace(clip, views=tuple(view if view.relation else _related(first, view) for view in views))


def _related(first: Track, view: OtherView) -> OtherView:
    names = f"{view.clip.name} as another view of {first.clip.name}"
    for clip in (first.clip, view.clip):
        if clip.camera.path is not None:
            raise InputError(f"{names}: the camera of {clip.name} moves; expected cameras that stand still.")
        if len(clip) < 2:
            raise InputError(f"{names}: {clip.name} has {len(clip)} frame; expected two clips of some seconds.")
    if view.times is not None and (len(view.times) != len(view.clip) or not (np.diff(view.times) > 0).all()):
        raise InputError(f"{names}: {len(view.times)} times for {len(view.clip)} frames; expected one each, rising.")
    other = Track(view.clip, view.times)
    for track in (first, other):
        if not (track.confidence[:, :25] > 0).any():
            raise InputError(f"{names}: {track.clip.name} shows no person.")
    best = min(_poses(first, other), key=lambda found: found.score, default=None)
    if best is None:
        raise InputError(f"{names}: at no offset in time do both show the person for a second. Use longer videos.")
    relation = _relation(first, other, best.pose)
    if reason := _doubt(first, other, best, relation):
        raise InputError(f"{names}: {reason}")
    of_lenses = _changes_with_lenses(first, other, best.pose)
    turn, way, late = np.hypot(best.pose.deviations, of_lenses).tolist()
    relation = replace(relation, rotation_deviation=turn, direction_deviation=way, offset_deviation=late)
    return replace(view, relation=relation)


def _changes_with_lenses(first: Track, other: Track, pose: Pose) -> Float[np.ndarray, "3"]:
    """By how much the pose changes if estimated focal lengths are one standard deviation longer: rotation and
    direction in degrees, offset in seconds. Rays of two views hardly tell their focal lengths."""
    pairs = [(_longer(first), other), (first, _longer(other))]
    changes = [
        PairOfRays(one, two, pose.rotation, pose.offset).refined().apart_from(pose)
        for one, two in pairs
        if one is not None and two is not None
    ]
    return np.linalg.norm(changes or np.zeros((1, 3)), axis=0)


def _longer(track: Track) -> Track | None:
    """With a focal length that is one standard deviation longer; None if it is not an estimate."""
    camera = track.clip.camera
    if camera.focal_deviation is None:
        return None
    focal = tuple(length * np.exp(camera.focal_deviation) for length in camera.focal)
    return Track(replace(track.clip, camera=replace(camera, focal=focal)), track.times)


def _poses(first: Track, other: Track) -> Iterator[_Found]:
    """From the likeliest offsets; none again where three starts have led to the same."""
    offsets = list[float]()
    for offset, rotation in candidates(first, other):
        pair = PairOfRays(first, other, rotation, offset)
        if not pair.enough:
            continue
        pose = pair.refined()
        correlation, *motion = alike(first, other, pose)
        yield _Found(pose=pose, alike=correlation, motion=(motion[0], motion[1]))
        offsets.append(pose.offset)
        if len(offsets) >= 3 and np.ptp(offsets) < _SAME_OFFSET:
            return


def _relation(first: Track, other: Track, pose: Pose) -> Relation:
    times = first.times
    rays, weights = first.smoothed_at(times)
    others, sure = other.smoothed_at(times + pose.offset)
    miss = abs(misses(rays, others, pose.rotation, pose.direction, (1.0, 1.0)))[weights * sure > 0]
    turn, way, late = pose.deviations.tolist()
    ups = pose.rotation @ _up(first), _up(other)
    return Relation(
        rotation=matrix_of(pose.rotation),
        translation=vector_of(pose.direction * pose.distance),
        offset=pose.offset,
        rotation_deviation=turn,
        direction_deviation=way,
        offset_deviation=late,
        disagreement=float(np.median(miss)) if len(miss) else float("inf"),
        overlap=max(0.0, min(first.duration, other.duration - pose.offset) - max(0.0, -pose.offset)),
        vertical_off=float(np.degrees(np.arccos(np.clip(ups[0] @ ups[1], -1, 1)))),
    )


def _up(track: Track) -> Float[np.ndarray, "3"]:
    """Against gravity in camera space: from the pictures if they tell, else the lifter's."""
    vertical = track.clip.camera.vertical
    up = np.array(vertical.up) if vertical is not None else track.lifted.up.mean(0)
    return up / max(float(np.linalg.norm(up)), 1e-9)


def _doubt(first: Track, other: Track, best: _Found, relation: Relation) -> str:
    """Why the relation is not believed; empty if it is."""
    pose, (one, two) = best.pose, best.motion
    if min(one, two) < _LEAST_MOTION and best.alike < _LEAST_ALIKE:
        still = first.clip.name if one < two else other.clip.name
        return (
            f"in {still} the person hardly moves in the {relation.overlap:.1f} s that both seem to show, so the offset "
            "in time cannot be found. Use a part in which both show a movement, such as a raised arm."
        )
    pixels = relation.disagreement * other.clip.camera.focal[0]
    if best.alike < _LEAST_ALIKE or pose.cost > _MOST_COST or relation.disagreement > _MOST_DISAGREEMENT:
        return (
            f"at the best offset in time ({pose.offset:+.2f} s) the movements are {max(best.alike, 0):.0%} alike, and "
            f"keypoints are {pixels:.0f} px from where {first.clip.name} puts them; expected the same person at the "
            "same time. Check that both were filmed at the same time, and follow the same person."
        )
    ratio = pose.distance / pose.likely_distance
    if pose.deviations[1] > _MOST_UNSURE or max(ratio, 1 / max(ratio, 1e-9)) > _MOST_DISTANT:
        return (
            "both show too few of the same body parts at once to find where the cameras stand. Use a part in which "
            "both show the whole body, or film from a smaller angle."
        )
    return ""


_RATE = 30.0
"""Bodies per second that are compared."""
_CANDIDATES = 6
_APART = 0.15
"""Seconds between candidates, at least."""
_VELOCITY = 0.3
"""Seconds: how far a body moves in that time counts as much as where it is."""
_LEAST_OVERLAP = 1.5
"""Seconds; half of the shorter clip if that is less."""


def candidates(first: Track, other: Track) -> list[tuple[float, Float[np.ndarray, "3 3"]]]:
    """The likeliest offsets in seconds, best first, with the rotation of the first camera's axes into the other's.

    For each offset the rotation that brings the bodies of both views together leaves the squared error

        sum |a|^2 + sum |b|^2 - 2 (s_1 + s_2 +- s_3)

    with s the singular values of sum b a^T (P. Schoenemann, Psychometrika 31, 1966); all sums are correlations over
    time, so the Fourier transform gives them for all offsets at once.
    """
    a, b = _bodies(first), _bodies(other)
    frames = _correlated(np.ones((len(a), 1)), np.ones((len(b), 1)))[:, 0].round()
    square_a, square_b = ((points**2).sum((1, 2))[:, None] for points in (a, b))
    sizes = _correlated(square_a, np.ones((len(b), 1))) + _correlated(np.ones((len(a), 1)), square_b)
    products = np.zeros((len(frames), 3, 3))
    for row in range(3):
        for column in range(3):
            products[:, row, column] = _correlated(a[..., column], b[..., row]).sum(1)
    u, s, vt = np.linalg.svd(products)
    sign = np.linalg.det(u @ vt)
    error = (sizes[:, 0] - 2 * (s[:, 0] + s[:, 1] + sign * s[:, 2])) / np.maximum(frames, 1)
    least = min(_LEAST_OVERLAP, 0.5 * min(first.duration, other.duration)) * _RATE
    error[frames < least] = np.inf
    offsets = np.arange(-(len(a) - 1), len(b)) / _RATE
    found: list[tuple[float, Float[np.ndarray, "3 3"]]] = []
    for i in np.argsort(error):
        if len(found) == _CANDIDATES or not np.isfinite(error[i]):
            break
        if all(abs(offsets[i] - offset) >= _APART for offset, _ in found):
            found.append((float(offsets[i]), u[i] @ np.diag([1.0, 1.0, sign[i]]) @ vt[i]))
    return found


def _bodies(track: Track) -> Float[np.ndarray, "F n 3"]:
    """Limbs around their middle, and their velocities, at _RATE."""
    times = np.arange(int(track.duration * _RATE) + 1) / _RATE
    points = track.lifted.points[:, kp.LIMBS].reshape(len(track.times), -1)
    points = np.stack([np.interp(times, track.times, column) for column in points.T], 1).reshape(len(times), -1, 3)
    points = points - points.mean(1, keepdims=True)
    if len(points) < 2:
        return points
    return np.concatenate([points, np.gradient(points, axis=0) * _RATE * _VELOCITY], 1)


def _correlated(a: Float[np.ndarray, "A n"], b: Float[np.ndarray, "B n"]) -> Float[np.ndarray, "O n"]:
    """sum over t of a[t] b[t + o], for offsets o from -(A - 1) to B - 1."""
    size = 1 << (len(a) + len(b)).bit_length()
    product = np.fft.irfft(np.fft.rfft(a, size, axis=0).conj() * np.fft.rfft(b, size, axis=0), size, axis=0)
    return np.concatenate([product[size - (len(a) - 1) :], product[: len(b)]])
