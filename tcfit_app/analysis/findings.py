"""What can look wrong about a frame of a fit: one function for each kind, and the table of them.

A value is judged against the same clip. Its score is how far it lies above the median, in units of a threshold: five
robust standard deviations, or a distance that no reviewer would mind if that is larger. From 1 on it is reported.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, JOINTS
from fitting_core.fit.observations import PAIRED, SEEN, unswapped
from tcfit_app.analysis.body_regions import KEYPOINT_OF_JOINT, REGION_OF, REGIONS, spoken, spoken_bone
from tcfit_app.analysis.posed_fit import GROUPS, PosedFit

_SIGMAS = 5.0
_MAD_TO_SIGMA = 1.4826
_MOST = 3.0
"""Times the least distance: so far a clip's own median and spread can excuse a value. The neck's offset from the body's
is 90 mm in each frame, and nothing to look at; half of a clip that is far off is."""
_OFF_MM = {"body": 40.0, "hands": 20.0, "face": 20.0}
"""Reprojection errors below are nothing to look at, whatever the median; lengths at the pelvis' distance."""
_DETECTION_JUMP_MM = 60.0
"""Distance of a detection from the middle of the ones before and after it, likewise."""
_JUMP = 40.0
"""m/s^2: what a joint must reach to be worth a look, four times the acceleration of free fall."""
_LEAST_JUMP_MM = 12.0
"""mm/frame^2: no less is a jump at high frame rates, where the joints' noise is as large as their acceleration."""
_HANDS = JOINT["left_index1"]
"""The first of the fingers' joints."""
_MANY = JOINT["right_wrist"] // 2
"""More joints than these, of all but the fingers, are the whole body."""
_USUAL, _LOW = 0.4, 0.4
"""A region's confidence is low below this share of what it has around that frame, if it has at least so much there."""
_AROUND = 25
"""Frames."""
_SWAP_MM = 150.0
"""By which each of the telling keypoints must come nearer to the fit, on average, when its side is changed."""
_SWAP_SCORE, _FAILED_SCORE = 3.0, 5.0
_COST_RATIO = 1.5
"""Times the usual cost by which a frame must exceed it."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something about one frame."""

    frame: int
    score: float
    """From 1 on."""
    reason: str
    """A few words for the user."""
    joints: tuple[int, ...]
    """Keypoints that it concerns, the worst first."""


def scores(values: Float[np.ndarray, "T K"], least: Float[np.ndarray, "T K"] | float) -> Float[np.ndarray, "T K"]:
    """How suspicious values are, each column against its own median; 0 for NaN.

    Args:
        values: Larger is worse; NaN where there is none.
        least: Distance from the median that must be exceeded at least.
    """
    known = np.isfinite(values)
    filled = np.where(known.any(0), values, 0)  # Columns without any value have no median.
    middle = np.nanmedian(filled, 0)
    sigma = _MAD_TO_SIGMA * np.nanmedian(abs(filled - middle), 0)
    threshold = np.clip(_SIGMAS * sigma, least, _MOST * least)
    return np.where(known, (filled - np.minimum(middle, _MOST * least)) / threshold, 0)


def _pixels_per_mm(fit: PosedFit) -> Float[np.ndarray, "T 1"]:
    """Of a length across the view at the pelvis' distance."""
    focal = sum(fit.clip.camera.focal) / 2
    return focal / np.maximum(fit.root[:, 2:], 0.1) / 1e3


def _reprojection(fit: PosedFit) -> Iterator[Finding]:
    least = np.empty((1, kp.COUNT))
    for name, group in GROUPS.items():
        least[:, group] = _OFF_MM[name]
    found = scores(fit.errors, least * _pixels_per_mm(fit))
    for frame, joints in _above(found):
        yield _off(frame, joints, found[frame], fit.errors[frame])


def _off(frame: int, joints: list[int], found: np.ndarray, errors: np.ndarray) -> Finding:
    worst = joints[0]
    region = REGION_OF[worst]
    same = [joint for joint in joints if REGION_OF[joint] == region]
    whole = worst >= kp.HANDS.start and len(same) > 2
    subject = f"{region} is up to" if whole else f"{spoken(worst)} is"
    largest = errors[same].max() if whole else errors[worst]
    others = len(joints) - (len(same) if whole else 1)
    more = f" ({others} more)" if others else ""
    return Finding(
        frame=frame, score=float(found[worst]), reason=f"{subject} {largest:.0f} px off{more}", joints=tuple(joints)
    )


def _detection_jumps(fit: PosedFit) -> Iterator[Finding]:
    keypoints = fit.clip.keypoints
    jumps = np.full(keypoints.confidence.shape, np.nan)
    if len(fit) > 2:
        off_middle = np.linalg.norm(np.diff(keypoints.xy, 2, axis=0), axis=-1) / 2
        seen = keypoints.confidence > SEEN
        jumps[1:-1] = np.where(seen[:-2] & seen[1:-1] & seen[2:], off_middle, np.nan)
    found = scores(jumps, _DETECTION_JUMP_MM * _pixels_per_mm(fit))
    for frame, joints in _above(found):
        reason = f"{spoken(joints[0])} detection jumps {jumps[frame, joints[0]]:.0f} px"
        yield Finding(frame=frame, score=float(found[frame, joints[0]]), reason=reason, joints=tuple(joints))


def _jumps(fit: PosedFit) -> Iterator[Finding]:
    least = max(1e3 * _JUMP / fit.clip.frame_rate**2, _LEAST_JUMP_MM)
    found = scores(fit.jumps, least)
    for frame, bones in _above(found):
        worst = bones[0]
        concerned = dict.fromkeys(joint for bone in bones if (joint := KEYPOINT_OF_JOINT[bone]) is not None)
        reason = f"{_jumping(bones)} {fit.jumps[frame, worst]:.0f} mm/frame²"
        yield Finding(frame=frame, score=float(found[frame, worst]), reason=reason, joints=tuple(concerned))


def _jumping(bones: list[int]) -> str:
    """What jumps: a joint; a hand, whose fingers hang on one wrist; or all of the body at once."""
    worst = bones[0]
    if sum(bone < _HANDS for bone in bones) > _MANY:
        return "whole body jumps up to"
    return f"{JOINTS[worst].partition('_')[0]} hand jumps up to" if worst >= _HANDS else f"{spoken_bone(worst)} jumps"


def _low_confidence(fit: PosedFit) -> Iterator[Finding]:
    by_frame: dict[int, list[tuple[float, str, list[int]]]] = {}
    for region, joints in REGIONS.items():
        tracked = [joint for joint in joints if fit.tracked[joint]]
        if not tracked:
            continue
        confidence = fit.clip.keypoints.confidence[:, tracked].mean(1)
        usual = median_filter(confidence, _AROUND, mode="nearest")
        # A person who has marked keypoints as bad knows that they are.
        low = (usual > _USUAL) & (confidence < _LOW * usual) & ~fit.bad[:, tracked].any(1)
        for frame in np.flatnonzero(low).tolist():
            value = confidence[frame]
            reason = f"{region} confidence {value:.2f}" if value > 0 else f"{region} not detected"
            score = (1 - value / usual[frame]) / (1 - _LOW)
            by_frame.setdefault(frame, []).append((float(score), reason, tracked))
    for frame, parts in by_frame.items():
        yield _lost(
            frame, sorted(parts, key=lambda part: -part[0]), nobody=not fit.clip.keypoints.confidence[frame].any()
        )


def _lost(frame: int, parts: list[tuple[float, str, list[int]]], *, nobody: bool) -> Finding:
    """Parts with their scores, reasons and keypoints, the worst first."""
    score, reason, _ = parts[0]
    more = f" ({len(parts) - 1} more)" if len(parts) > 1 else ""
    joints = tuple(joint for _, _, tracked in parts for joint in tracked)
    return Finding(frame=frame, score=score, reason="nobody detected" if nobody else reason + more, joints=joints)


def _swaps(fit: PosedFit) -> Iterator[Finding]:
    by_detector = unswapped(fit.clip.keypoints)[1]
    for name, (left, right, others) in PAIRED.items():
        by_fit = _crossed(fit, left[:2], right[:2])
        frames = {*by_detector.get(name, np.empty(0, int)).tolist(), *by_fit}
        joints = (*left, *right, *others[0], *others[1])
        for frame in sorted(frames):
            yield Finding(frame=frame, score=_SWAP_SCORE, reason=f"{name} may be swapped", joints=joints)


def _crossed(fit: PosedFit, left: list[int], right: list[int]) -> list[int]:
    """Frames in which left and right would fit clearly better the other way round."""
    seen = (fit.clip.keypoints.confidence[:, left + right] > SEEN).all(1)
    xy, projected = fit.clip.keypoints.xy, fit.projected
    straight = np.linalg.norm(xy[:, left + right] - projected[:, left + right], axis=-1).sum(1)
    crossed = np.linalg.norm(xy[:, left + right] - projected[:, right + left], axis=-1).sum(1)
    # Sums over all four; a body behind the camera has NaN, which no comparison holds for.
    better = (crossed < 0.5 * straight) & (straight - crossed > 2 * len(left) * _SWAP_MM * _pixels_per_mm(fit)[:, 0])
    return np.flatnonzero(seen & better).tolist()


def _costs(fit: PosedFit) -> Iterator[Finding]:
    """Frames whose cost is not explained by their reprojection errors: an unlikely pose.

    The cost of the data term depends on how many keypoints there are (with hands it is five times as large), so what
    the squared errors of body, hands and face explain is taken off first, by least squares.
    """
    from scipy.optimize import nnls  # 0.15 s, which no app needs to start with

    if fit.frame_cost is None:
        return
    finite = np.isfinite(fit.frame_cost)
    for frame in np.flatnonzero(~finite).tolist():
        yield Finding(frame=frame, score=_FAILED_SCORE, reason="the fit failed here", joints=())
    if finite.sum() < _AROUND:
        return
    cost, frames = fit.frame_cost[finite], np.flatnonzero(finite)
    weighted = (np.nan_to_num(fit.errors[finite]) * fit.clip.keypoints.confidence[finite]) ** 2
    explaining = np.stack([np.ones(len(cost)), *(weighted[:, group].sum(1) for group in GROUPS.values())], 1)
    usual = np.maximum(explaining @ nnls(explaining, cost)[0], 1e-9)
    found = scores((cost - usual)[:, None], _COST_RATIO * usual[:, None])[:, 0]
    for i in np.flatnonzero(found >= 1).tolist():
        reason = f"unlikely pose: costs {cost[i] / usual[i]:.1f} times the usual"
        yield Finding(frame=int(frames[i]), score=float(found[i]), reason=reason, joints=())


def _above(found: Float[np.ndarray, "T K"]) -> Iterator[tuple[int, list[int]]]:
    """Frames with a score of at least 1, and its columns with such, the worst first."""
    for frame in np.flatnonzero((found >= 1).any(1)).tolist():
        order = np.argsort(-found[frame], kind="stable")
        yield frame, [int(column) for column in order if found[frame, column] >= 1]


FINDINGS: dict[str, Callable[[PosedFit], Iterator[Finding]]] = {
    "swap": _swaps,
    "reprojection": _reprojection,
    "jump": _jumps,
    "detection": _detection_jumps,
    "cost": _costs,
    "confidence": _low_confidence,
}
"""By kind. Of findings with the same score the earlier kind is told."""
