"""Possible problems in a frame of a fit: one function for each kind, and the table of them.

A value is judged relative to the same clip. Its score is the distance above the median in units of a threshold: five
robust standard deviations, or if larger a distance that no reviewer would mind. From a score of 1 it is reported.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter, uniform_filter1d

from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, JOINTS
from fitting_core.fit.evidence.kept_offsets import with_kept
from fitting_core.fit.evidence.observations import lifted_keypoints
from fitting_core.fit.evidence.sides import PAIRED, unswapped
from fitting_core.frame_runs import runs_where
from fitting_core.image_border import seen_confidence
from fitting_core.keypoints import SEEN, Keypoints
from tcfit_app.analysis.body_regions import KEYPOINT_OF_JOINT, LIMB_OF, REGION_OF, REGIONS, spoken, spoken_bone
from tcfit_app.analysis.posed_fit import PosedFit

_SIGMAS = 5.0
_MAD_TO_SIGMA = 1.4826
_MOST = 3.0
"""Multiple of the least distance up to which a clip's own median and spread can excuse a value. The neck is 90 mm from
the body's in every frame, which is nothing to review; a fit that is far off in half of the clip is."""
_OFF_MM = {"body": 45.0, "hands": 30.0, "face": 40.0}
"""Smaller reprojection errors are not worth reviewing, for any median; as lengths at the pelvis' distance."""
_STEADY_MM, _STEADY_MOST = 15.0, 2.0
"""Mean distance of a part from its keypoints over some time that is worth reviewing, and its largest score."""
_STEADY_SECONDS, _STEADY_FRAMES = 0.5, 9
"""For how long, at the least. A frame's own error may be three times as large without being seen (`_OFF_MM`)."""
_STEADY_PARTS: dict[str, dict[str, tuple[int, ...]]] = {
    **{
        end: {side: (kp.INDEX[f"{side}_{end}"],) for side in ("left", "right")}
        for end in ("elbow", "wrist", "knee", "ankle")
    },
    "hand": {side: REGIONS[f"{side} hand"] for side in ("left", "right")},
    "face": {"": REGIONS["face"]},
}
"""Parts whose place matters to the eye, by side. Shoulders and hips lie inside the body, where detectors differ."""
_DETECTION_JUMP_MM = 60.0
"""Distance of a detection from the midpoint of the ones before and after it, likewise."""
_JUMP = 70.0
"""m/s^2: the least acceleration worth reviewing: 82 % of the tuning half's entries are right, from 40 on half."""
_LEAST_JUMP_MM = 12.0
"""mm/frame^2: the same at high frame rates, where the joints' noise is as large as their acceleration."""
_AROUND_IT = "from the frames around it"
WHOLE = "whole body"
"""What a finding without keypoints, or about many limbs, is about."""
_MANY_LIMBS = 4
"""From this many of the six limbs (with head and torso), a finding is of the whole body."""
_HANDS = JOINT["left_index1"]
"""The first of the fingers' joints."""
LIMB_OF_BONE = {bone: "torso" if joint is None else LIMB_OF[joint] for bone, joint in enumerate(KEYPOINT_OF_JOINT)}
"""Of each SMPL-X joint."""
_MANY = JOINT["right_wrist"] // 2
"""More joints than this, not counting fingers, are the whole body."""
_USUAL, _LOW = 0.3, 0.15
"""A region's confidence is low if below this fraction of its usual value around that frame, if that is so much."""
_AROUND = 75
"""Frames: a part lost for less than half of them is missed."""
_STILL = 0.05
"""Fraction of a keypoint's usual movement per frame below which it stands still. Noise alone moves it more."""
_STILL_FRAMES, _STILL_JOINTS = 5, 2
"""Minimum frames and keypoints of a frozen limb."""
_OTHERS_TRAVEL_MM = 40.0
"""How far the rest of the body gets meanwhile, at the least. Of a person who stands still, noise and the grid of a
heat map (1.3 px of 640) move keypoints by less than half of that."""
_STILL_MOST = 2.0
"""Score of a limb frozen for so long that longer makes no difference."""
_SWAP_MM = 150.0
"""Minimum average factor by which the informative keypoints must come closer to the fit when sides are exchanged."""
_SWAP_SCORE, _SWAPPED_BACK_SCORE, _FAILED_SCORE = 3.0, 1.0, 5.0
"""Already corrected by the fit: worth reviewing, but needs no correction."""
_DEPTH = 0.25
"""Minimum expected depth error in metres: 86 % of the tuning half's entries are right, from 0.2 on 40 %."""
_ONLY_UNSURE = 0.8
"""Relative score of a depth that is uncertain but not off: 15 % of these are over 0.15 m off, of the others 45 %."""
_ENDS = [kp.INDEX[f"{side}_{name}"] for name in ("elbow", "wrist", "knee", "ankle") for side in ("left", "right")]
"""Limb keypoints, whose depth and loss matter individually: the others are constrained by their neighbours."""
_LEG_ENDS = [joint for joint in _ENDS if LIMB_OF[joint].endswith("leg")]
"""All still: the person stands, as with a still foot under a moving knee. A limb is frozen if both its ends are."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A possible problem in one frame."""

    frame: int
    score: float
    """From 1."""
    reason: str
    """A sentence for users: what is seen, in which unit, compared with what."""
    joints: tuple[int, ...]
    """Keypoints concerned, worst first."""
    lasting: range | None = None
    """The frames of what lasts, which all have this finding."""

    @property
    def about(self) -> frozenset[str]:
        """The limbs concerned, or WHOLE."""
        limbs = frozenset(LIMB_OF[joint] for joint in self.joints)
        return limbs if 0 < len(limbs) < _MANY_LIMBS else frozenset({WHOLE})


def scores(values: Float[np.ndarray, "T K"], least: Float[np.ndarray, "T K"] | float) -> Float[np.ndarray, "T K"]:
    """How suspicious values are, each column relative to its own median; 0 for NaN.

    Args:
        values: Larger is worse; NaN where missing.
        least: Minimum distance from the median to exceed.
    """
    known = np.isfinite(values)
    filled = np.where(known.any(0), values, 0)  # columns without any value have no median
    middle = np.nanmedian(filled, 0)
    sigma = _MAD_TO_SIGMA * np.nanmedian(abs(filled - middle), 0)
    threshold = np.clip(_SIGMAS * sigma, least, _MOST * least)
    return np.where(known, (filled - np.minimum(middle, _MOST * least)) / threshold, 0)


def _pixels_per_mm(fit: PosedFit) -> Float[np.ndarray, "T 1"]:
    """Of a length perpendicular to the view at the pelvis' distance."""
    focal = sum(fit.clip.camera.focal) / 2
    return focal / np.maximum(fit.root[:, 2:], 0.1) / 1e3


def _reprojection(fit: PosedFit) -> Iterator[Finding]:
    fit = fit.with_own_sides
    least = np.empty((1, kp.COUNT))
    for group, most in ((kp.BODY, _OFF_MM["body"]), (kp.HANDS, _OFF_MM["hands"]), (kp.FACE, _OFF_MM["face"])):
        least[:, group] = most
    found = scores(fit.errors, least * _pixels_per_mm(fit))
    for frame, joints in _above(found):
        for part in _by_limb(joints):
            yield _off(frame, part, found[frame], fit.errors[frame])


def _off(frame: int, joints: list[int], found: np.ndarray, errors: np.ndarray) -> Finding:
    worst = joints[0]
    region = REGION_OF[worst]
    same = [joint for joint in joints if REGION_OF[joint] == region]
    whole = worst >= kp.HANDS.start and len(same) > 2
    subject, others = (region, len(joints) - len(same)) if whole else (spoken(worst), len(joints) - 1)
    largest = errors[joints if others else same if whole else worst].max()
    if others:
        other = next(joint for joint in joints if joint != worst and not (whole and joint in same))
        also = spoken(other) if others == 1 else f"{others} more"
        reason = f"{subject} and {also} are up to {largest:.0f} px from their keypoints"
    else:
        reason = f"{subject} is {'up to ' if whole else ''}{largest:.0f} px from its keypoint{'s' if whole else ''}"
    return Finding(frame=frame, score=float(found[worst]), reason=reason, joints=tuple(joints))


def _steady(fit: PosedFit) -> Iterator[Finding]:
    """Parts that lie beside their keypoints in one direction for a while, which noise does not: its mean vanishes."""
    fit = fit.with_own_sides
    frames = max(_STEADY_FRAMES, round(_STEADY_SECONDS * fit.clip.frame_rate))
    offsets = np.where(fit.counted[..., None], fit.projected - fit.clip.keypoints.xy, np.nan)
    least = _STEADY_MM * _pixels_per_mm(fit)[:, 0]
    for name, sides in _STEADY_PARTS.items():
        own = [list(joints) for joints in sides.values()]
        means = np.stack([_running_mean(offsets[:, joints], frames, _STEADY_MOST * least) for joints in own], 1)
        lie = means > least[:, None]
        for run in runs_where(np.asarray(lie.any(1))):
            chosen = [i for i in range(len(own)) if lie[run.start : run.stop, i].mean() > 0.5]
            if len(run) < frames // 2 or not chosen:
                continue
            joints = [joint for i in chosen for joint in own[i]]
            subject = f"both {name}s stay" if len(chosen) > 1 else f"{[*sides][chosen[0]]} {name} stays".strip()
            its = "their keypoints" if len(chosen) > 1 else "its keypoints" if len(joints) > 1 else "its keypoint"
            pixels = np.nanmedian(np.linalg.norm(offsets[run.start : run.stop, joints], axis=-1))
            reason = f"{subject} about {pixels:.0f} px from {its}"
            for frame in run:
                score = max(1.0, float(means[frame, chosen].max() / least[frame]))
                yield Finding(frame=frame, score=score, reason=reason, joints=tuple(joints), lasting=run)


def _running_mean(
    offsets: Float[np.ndarray, "T K 2"], frames: int, most: Float[np.ndarray, "T"]
) -> Float[np.ndarray, "T"]:
    """Length of the mean offset of some keypoints over some frames, of which each counts `most` pixels at most, so that
    a few cannot make it; 0 where less than half of it is known."""
    count = np.isfinite(offsets[..., 0]).sum(1)
    mean = np.nan_to_num(offsets).sum(1) / np.maximum(count, 1)[:, None]
    mean *= np.minimum(1, most / np.maximum(np.linalg.norm(mean, axis=1), 1e-9))[:, None]
    there = uniform_filter1d((count > 0).astype(float), frames, mode="nearest")
    smooth = uniform_filter1d(mean, frames, axis=0, mode="nearest") / np.maximum(there, 0.5)[:, None]
    return np.where((count > 0) & (there >= 0.5), np.linalg.norm(smooth, axis=1), 0)


def _detection_jumps(fit: PosedFit) -> Iterator[Finding]:
    keypoints = fit.with_own_sides.clip.keypoints
    jumps = np.full(keypoints.confidence.shape, np.nan)
    if len(fit) > 2:
        off_middle = np.linalg.norm(np.diff(keypoints.xy, 2, axis=0), axis=-1) / 2
        seen = keypoints.confidence > SEEN
        jumps[1:-1] = np.where(seen[:-2] & seen[1:-1] & seen[2:], off_middle, np.nan)
    found = scores(jumps, _DETECTION_JUMP_MM * _pixels_per_mm(fit))
    for frame, joints in _above(found):
        for part in _by_limb(joints):
            reason = f"detected {spoken(part[0])} jumps {jumps[frame, part[0]]:.0f} px {_AROUND_IT}"
            yield Finding(frame=frame, score=float(found[frame, part[0]]), reason=reason, joints=tuple(part))


def _jumps(fit: PosedFit) -> Iterator[Finding]:
    least = max(1e3 * _JUMP / fit.clip.frame_rate**2, _LEAST_JUMP_MM)
    found = scores(fit.jumps, least)
    for frame, bones in _above(found):
        whole = sum(bone < _HANDS for bone in bones) > _MANY
        for part in [bones] if whole else _by_limb(bones, LIMB_OF_BONE):
            worst = part[0]
            concerned = dict.fromkeys(joint for bone in part if (joint := KEYPOINT_OF_JOINT[bone]) is not None)
            way = fit.jumps[frame, worst] / 2  # to the middle of its places before and after
            reason = f"{_jumping(worst, whole=whole)} {way:.0f} mm {_AROUND_IT}"
            yield Finding(frame=frame, score=float(found[frame, worst]), reason=reason, joints=tuple(concerned))


def _jumping(worst: int, *, whole: bool) -> str:
    """What jumps: a joint; a hand, whose fingers follow one wrist; or the whole body."""
    if whole:
        return "whole body jumps up to"
    return f"{JOINTS[worst].partition('_')[0]} hand jumps up to" if worst >= _HANDS else f"{spoken_bone(worst)} jumps"


def _low_confidence(fit: PosedFit) -> Iterator[Finding]:
    by_frame: dict[int, list[tuple[float, str, list[int]]]] = {}
    alone = {spoken(joint): (joint,) for joint in _ENDS}
    for region, joints in (REGIONS | alone).items():
        tracked = [joint for joint in joints if fit.tracked[joint]]
        if not tracked:
            continue
        confidence = fit.clip.keypoints.confidence[:, tracked].mean(1)
        usual = median_filter(confidence, _AROUND, mode="nearest")
        # Keypoints marked bad need no finding.
        most = SEEN if region in alone else np.inf
        low = (usual > _USUAL) & (confidence < np.minimum(_LOW * usual, most)) & ~fit.bad[:, tracked].any(1)
        for frame in np.flatnonzero(low).tolist():
            value = confidence[frame]
            seen = f"detected with confidence {value:.2f}, usually {usual[frame]:.2f}" if value > 0 else "not detected"
            reason = f"{region} is {seen}"
            score = (1 - value / usual[frame]) / (1 - _LOW)
            by_frame.setdefault(frame, []).append((float(score), reason, tracked))
    for frame, parts in by_frame.items():
        empty = not fit.clip.keypoints.confidence[frame].any()
        of_limb: dict[str, list[tuple[float, str, list[int]]]] = {}
        for part in sorted(parts, key=lambda part: -part[0]):
            of_limb.setdefault(WHOLE if empty else LIMB_OF[part[2][0]], []).append(part)
        for own in of_limb.values():
            yield _lost(frame, own, empty=empty)


def _lost(frame: int, parts: list[tuple[float, str, list[int]]], *, empty: bool) -> Finding:
    """Parts with their scores, reasons and keypoints, worst first."""
    score, reason, _ = parts[0]
    more = f"; {len(parts) - 1} more {'parts are' if len(parts) > 2 else 'part is'} lost" if len(parts) > 1 else ""
    joints = tuple(joint for _, _, tracked in parts for joint in tracked)
    return Finding(frame=frame, score=score, reason="no person is detected" if empty else reason + more, joints=joints)


def _swaps(fit: PosedFit) -> Iterator[Finding]:
    none = np.empty(0, int)
    for name, (left, right, others) in PAIRED.items():
        by_detector = {*unswapped(fit.clip.keypoints)[1].get(name, none).tolist(), *_crossed(fit, left[:2], right[:2])}
        put_right = {*fit.swapped_back.get(name, none).tolist()}
        joints = (*left, *right, *others[0], *others[1])
        for frame in sorted(by_detector | put_right):
            score, reason = _SWAP_SCORE, f"left and right {name} may be swapped"
            if frame in put_right:
                score, reason = _SWAPPED_BACK_SCORE, f"left and right {name} were swapped; the fit has corrected it"
            yield Finding(frame=frame, score=score, reason=reason, joints=joints)


def _crossed(fit: PosedFit, left: list[int], right: list[int]) -> list[int]:
    """Frames in which exchanging left and right would fit clearly better."""
    seen = (fit.clip.keypoints.confidence[:, left + right] > SEEN).all(1)
    xy, projected = fit.clip.keypoints.xy, fit.projected
    straight = np.linalg.norm(xy[:, left + right] - projected[:, left + right], axis=-1).sum(1)
    crossed = np.linalg.norm(xy[:, left + right] - projected[:, right + left], axis=-1).sum(1)
    # Sums over all four; for a body behind the camera NaN, for which every comparison is false.
    better = (crossed < 0.5 * straight) & (straight - crossed > 2 * len(left) * _SWAP_MM * _pixels_per_mm(fit)[:, 0])
    return np.flatnonzero(seen & better).tolist()


def _depths(fit: PosedFit) -> Iterator[Finding]:
    """Limbs whose depth the image does not determine, or that are far from the lifter's estimate; except for depths set
    by a person.

    The expected error combines both: the distance between fit and lifter, and the lifter's uncertainty.
    """
    keypoints = unswapped(fit.clip.keypoints)[0]
    lifted = lifted_keypoints(keypoints, fit.clip.camera, fit.clip.frame_rate)
    size = fit.size or 1.0
    points, deviations = with_kept(keypoints.kept, size * lifted.points, size * lifted.depth_deviation)
    farther = fit.points[:, _ENDS, 2] - fit.root[:, None, 2] - points[:, _ENDS, 2]
    unsure = deviations[:, _ENDS, 2]
    seen = seen_confidence(keypoints, fit.clip.camera)[:, _ENDS] > SEEN
    seen &= np.isnan(keypoints.told_depth[:, _ENDS])
    found = np.where(seen & np.isfinite(farther), np.hypot(farther, unsure), 0) / _DEPTH
    found *= np.where(abs(farther) > unsure, 1.0, _ONLY_UNSURE)
    limb_of = {column: LIMB_OF[joint] for column, joint in enumerate(_ENDS)}
    for frame, columns in ((frame, part) for frame, all_of in _above(found) for part in _by_limb(all_of, limb_of)):
        worst = columns[0]
        off, most = 100 * farther[frame, worst], 100 * np.hypot(farther, unsure)[frame, worst]
        joint = spoken(_ENDS[worst])
        where = "farther away" if off > 0 else "nearer"
        apart = f"{joint} is {abs(off):.0f} cm {where} than its keypoints suggest"
        reason = (
            apart if abs(off) > 100 * unsure[frame, worst] else f"depth of the {joint} is uncertain by {most:.0f} cm"
        )
        joints = tuple(_ENDS[column] for column in columns)
        yield Finding(frame=frame, score=float(found[frame, worst]), reason=reason, joints=joints)


def _frozen(fit: PosedFit) -> Iterator[Finding]:
    """Limbs whose detections stay in place while the rest of the body moves: a tracker has lost them."""
    keypoints, steps = fit.clip.keypoints, np.full(fit.clip.keypoints.confidence.shape, np.nan)
    seen = keypoints.confidence > SEEN
    ways = np.linalg.norm(np.diff(keypoints.xy, axis=0), axis=-1)
    steps[1:] = np.where(seen[1:] & seen[:-1], ways, np.nan)
    moving = np.isfinite(steps).any(0)
    usual = np.where(moving, np.nanmedian(np.where(moving, steps, 0), axis=0), 0)
    still, to_mm = steps < _STILL * usual, 1 / float(np.median(_pixels_per_mm(fit)))
    for limb in dict.fromkeys(LIMB_OF.values()):
        own = [joint for joint in LIMB_OF if LIMB_OF[joint] == limb]
        ends = [joint for joint in _ENDS if LIMB_OF[joint] == limb]
        others = [joint for joint in range(kp.BODY.stop) if LIMB_OF[joint] != limb and usual[joint] > 0]
        lost = still[:, ends].all(1) & (still[:, own].sum(1) >= _STILL_JOINTS)
        if limb.endswith("leg"):
            lost &= ~still[:, _LEG_ENDS].all(1)
        for run in runs_where(lost):
            frames = list(run)
            if len(run) < _STILL_FRAMES or not _travel(keypoints, frames, others) * to_mm > _OTHERS_TRAVEL_MM:
                continue
            joints = tuple(joint for joint in own if still[frames, joint].mean() > 0.5)
            reason = f"keypoints of the {limb} stand still for {len(run) + 1} frames while the body moves"
            for waited, frame in enumerate(frames):  # the longer, the farther off
                score = min(1 + waited / _STILL_FRAMES, _STILL_MOST)
                yield Finding(frame=frame, score=score, reason=reason, joints=joints)


def _travel(keypoints: Keypoints, frames: list[int], joints: list[int]) -> float:
    """How far keypoints get in some frames, in pixels: the median of them; NaN where none is seen."""
    chosen = np.ix_(frames, joints)
    seen = (keypoints.confidence[chosen] > SEEN)[..., None]
    low = np.where(seen, keypoints.xy[chosen], np.inf).min(0)
    high = np.where(seen, keypoints.xy[chosen], -np.inf).max(0)
    ways = np.linalg.norm(high - low, axis=-1)
    return float(np.median(ways[np.isfinite(ways)])) if np.isfinite(ways).any() else np.nan


def _failed(fit: PosedFit) -> Iterator[Finding]:
    for frame in () if fit.frame_cost is None else np.flatnonzero(~np.isfinite(fit.frame_cost)).tolist():
        yield Finding(frame=frame, score=_FAILED_SCORE, reason="the fit failed in this frame", joints=())


def _above(found: Float[np.ndarray, "T K"]) -> Iterator[tuple[int, list[int]]]:
    """Frames with a score of at least 1, and their columns with one, worst first."""
    for frame in np.flatnonzero((found >= 1).any(1)).tolist():
        order = np.argsort(-found[frame], kind="stable")
        yield frame, [int(column) for column in order if found[frame, column] >= 1]


def _by_limb(joints: list[int], limb_of: Mapping[int, str] = LIMB_OF) -> list[list[int]]:
    """Keypoints by limb, in their order; all together if the whole body is concerned."""
    found: dict[str, list[int]] = {}
    for joint in joints:
        found.setdefault(limb_of[joint], []).append(joint)
    return [joints] if len(found) >= _MANY_LIMBS else list(found.values())


FINDINGS: dict[str, Callable[[PosedFit], Iterator[Finding]]] = {
    "failed": _failed,
    "swap": _swaps,
    "reprojection": _reprojection,
    "steady": _steady,
    "jump": _jumps,
    "detection": _detection_jumps,
    "depth": _depths,
    "frozen": _frozen,
    "confidence": _low_confidence,
}
"""By kind. Of findings with equal scores the earlier kind is reported."""
