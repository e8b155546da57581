"""Where keypoints are in space, from all views of them."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from fitting_core import keypoints as kp
from fitting_core.clip import Clip, OtherView
from fitting_core.fit.evidence.observations import PointsInSpace
from fitting_core.fit.views.track import Track
from fitting_core.keypoint_noise import DETECTOR_TITLES, OPENPOSE, noise_deviations
from fitting_core.metrics import similarity

_WIDENED = 1.5
"""Factor on the deviations, whose errors last over frames: a keypoint then weighs as much in depth as its detection
does in the image."""
_PLACED = 0.005
"""Standard deviation of a keypoint that a person placed, metres."""
_MOST_APART = 0.08
"""Metres from the rays at which views disagree: the lifter counts instead, as without other views."""
_SURER = 0.2
"""Difference in confidence by which another view outvotes the first where they disagree."""
_ACROSS = 0.04
"""Standard deviation of the lifter's points across the viewing ray, metres."""
_NEAREST = 0.2
"""Metres before the first camera."""
_TORSO = [kp.INDEX[n] for n in ("neck", "right_shoulder", "left_shoulder", "mid_hip", "right_hip", "left_hip")]
_BODY = kp.BODY.stop


def points_in_space(clip: Clip) -> PointsInSpace:
    """Keypoints of a clip with other views that are related to it."""
    first = Track(clip)
    mine = _Seen(np.zeros(3), *first.at(first.times), _noise(clip))
    others, bodies = list[_Seen](), [(first.lifted.points, first.lifted.up)]
    lifted, spread = np.zeros((len(clip), _BODY, 3)), np.full((len(clip), _BODY, 3), np.inf)
    for view in clip.views:
        relation, other = view.relation, _track(view)
        assert relation is not None, "views of a clip are related to it"
        times = first.times + relation.offset
        rays, confidence, placed = other.at(times)
        place = -relation.shift @ relation.turn
        others.append(_Seen(place, rays @ relation.turn, confidence, placed, _noise(view.clip)))
        shown = confidence[:, :_BODY] > 0
        body, depth = other.lifted_at(times)
        variance = np.stack([np.full_like(depth, _ACROSS**2)] * 2 + [depth**2], -1)
        lifted[shown], spread[shown] = (body @ relation.turn)[shown], np.sqrt(variance @ relation.turn**2)[shown]
        bodies.append((body @ relation.turn, other.lifted.up[other.nearest(times)] @ relation.turn))
    points, deviation = _triangulated([mine, *others])
    outvoted = (mine.confidence > 0) & ~np.isfinite(deviation[..., 2]) & ~mine.placed
    outvoted &= np.any([other.placed | (other.confidence > mine.confidence + _SURER) for other in others], axis=0)
    if outvoted.any():
        mine = replace(mine, confidence=np.where(outvoted, 0.0, mine.confidence))
        points, deviation = _triangulated([mine, *others])
    up = np.mean([_carried(up, body, points, deviation) for body, up in bodies], axis=0)
    pelvis = _pelvis(points, deviation, first)
    deviation = np.where(np.isfinite(pelvis)[:, None], deviation, np.inf)
    points = np.where(np.isfinite(deviation), points - np.nan_to_num(pelvis)[:, None], 0.0)
    # A rotation between the views that is off moves points in proportion to their distance from the pelvis.
    turn = np.radians(max(view.relation.rotation_deviation for view in clip.views if view.relation is not None))
    deviation = np.hypot(deviation, turn * np.linalg.norm(points, axis=-1, keepdims=True))
    alone = (mine.confidence[:, :_BODY] == 0)[..., None] & ~np.isfinite(deviation[:, :_BODY])
    points[:, :_BODY] = np.where(alone, lifted, points[:, :_BODY])
    deviation[:, :_BODY] = np.where(alone, spread, deviation[:, :_BODY])
    return PointsInSpace(points=points, deviation=deviation, outvoted=outvoted, up=up)


@lru_cache(maxsize=4)  # views stay the same while the first clip is corrected
def _track(view: OtherView) -> Track:
    return Track(view.clip, view.times)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a view shows at the first one's frames, in the first camera's axes."""

    place: Float[np.ndarray, "3"]
    rays: Float[np.ndarray, "T 137 3"]
    confidence: Float[np.ndarray, "T 137"]
    placed: Bool[np.ndarray, "T 137"]
    noise: Float[np.ndarray, "137"]
    """Metres."""


def _noise(clip: Clip) -> Float[np.ndarray, "137"]:
    return noise_deviations(clip.detector if clip.detector in DETECTOR_TITLES else OPENPOSE) / 1e3


def _triangulated(views: list[_Seen]) -> tuple[Float[np.ndarray, "T 137 3"], Float[np.ndarray, "T 137 3"]]:
    """Points nearest to the rays of all views that show them, and their deviations along the first camera's axes.

    The squared distance of a point X from the ray c + s d is (X - c)^T (I - d d^T) (X - c); its sum over rays, each
    divided by its variance, is X^T A X - 2 b^T X + ..., so X = A^-1 b, with covariance A^-1.
    """
    count = views[0].confidence.shape
    matrix, side, shown = np.zeros((*count, 3, 3)), np.zeros((*count, 3)), np.zeros(count, int)
    across = list[np.ndarray]()
    for view in views:
        flat = np.eye(3) - view.rays[..., :, None] * view.rays[..., None, :]
        weight = (view.confidence > 0) / np.where(view.placed, _PLACED, view.noise) ** 2
        matrix += weight[..., None, None] * flat
        side += weight[..., None] * (flat @ view.place)
        shown += view.confidence > 0
        across.append(flat)
    matrix[shown < 2] = np.eye(3)
    covariance = np.linalg.inv(matrix + 1e-9 * np.eye(3))
    points = (covariance @ side[..., None])[..., 0]
    good: Bool[np.ndarray, "T 137"] = (shown >= 2) & (points[..., 2] > _NEAREST)
    for flat, view in zip(across, views, strict=True):
        apart = np.linalg.norm((flat @ (points - view.place)[..., None])[..., 0], axis=-1)
        good &= (view.confidence == 0) | (apart < _MOST_APART)
    deviation = _WIDENED * np.sqrt(np.diagonal(covariance, axis1=2, axis2=3))
    return points, np.where(good[..., None], deviation, np.inf)


def _carried(
    up: Float[np.ndarray, "T 3"],
    body: Float[np.ndarray, "T 25 3"],
    points: Float[np.ndarray, "T 137 3"],
    deviation: Float[np.ndarray, "T 137 3"],
) -> Float[np.ndarray, "T 3"]:
    """The lifter's up direction, turned with its body onto the located points.

    The lifter judges it by how the body stands, so that a body that leans too far back in depth takes it along.
    """
    carried = up.copy()
    for part in (_TORSO, kp.LIMBS):
        known = np.asarray(np.isfinite(deviation[:, part]).all((1, 2)))
        turn = similarity(body[known][:, part], points[known][:, part], scaled=False).rotation
        carried[known] = (turn @ up[known, :, None])[..., 0]
    return carried


def _pelvis(
    points: Float[np.ndarray, "T 137 3"], deviation: Float[np.ndarray, "T 137 3"], first: Track
) -> Float[np.ndarray, "T 3"]:
    """Of frames in which the torso is located: where the lifter's torso lies best on it; NaN for others."""
    known = np.asarray(np.isfinite(deviation[:, _TORSO]).all(-1))
    torso, lifted = points[:, _TORSO], first.lifted.points[:, _TORSO]
    whole, pelvis = np.asarray(known.all(1)), np.full((len(points), 3), np.nan)
    if whole.any():
        pelvis[whole] = similarity(lifted[whole], torso[whole], scaled=False).translation
    some = np.asarray(known.any(1)) & ~whole
    share = known[some, :, None] / known[some].sum(1)[:, None, None]
    pelvis[some] = (share * (torso - lifted)[some]).sum(1)
    return pelvis
