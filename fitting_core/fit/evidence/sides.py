"""Left and right limbs swapped by a detector in some frames, detected from how they attach to the trunk.

A limb is judged by its motion relative to its root (an arm's shoulder, a leg's hip), so that the limbs of a person who
turns are expected to exchange places when the trunk's sides do. The trunk itself is not judged: where a detector swaps
a whole person's left and right, limbs and trunk agree and stay.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from fitting_core.keypoints import INDEX, LEFT_HAND, RIGHT_HAND, SEEN, Keypoints

_HAND = [LEFT_HAND.start + i for i in range(21)], [RIGHT_HAND.start + i for i in range(21)]
PAIRED = {
    "arms": ([INDEX["left_elbow"], INDEX["left_wrist"]], [INDEX["right_elbow"], INDEX["right_wrist"]], _HAND),
    "legs": (
        [INDEX[f"left_{n}"] for n in ("knee", "ankle", "big_toe", "small_toe", "heel")],
        [INDEX[f"right_{n}"] for n in ("knee", "ankle", "big_toe", "small_toe", "heel")],
        ([], []),
    ),
}
"""Left and right keypoints of a pair of limbs, the first two of which decide whether it is swapped."""


def _both(part: str) -> list[int]:
    return [INDEX[f"left_{part}"], INDEX[f"right_{part}"]]


_TRUNK = {"arms": ("shoulder", "hip"), "legs": ("hip", "shoulder")}
"""The limbs' roots, and substitutes for the trunk's sides where the roots are not visible."""
_HEAD = ("ear", "eye")
_CLEAR = 0.5
"""Fraction of a pair's usual distance above which its order in the image is clear: it faces within 60 degrees towards
or away from the camera. A spine cannot twist so far that two pairs of the trunk are clear and in different order."""
_PRICE = 0.7
"""Minimum saving of a swap: this fraction of the distance between the two sides, summed over the deciding keypoints. A
swap in a motionless body saves 2."""
_FLOOR = 0.05
"""And this fraction of the trunk's length: otherwise noise would favour swaps where limbs overlap. During tuning, 0.1
found 3 % fewer of the swaps in hard detections."""
_UNREST = 0.5
"""And this fraction of the limbs' motion between frames at that time: at low frame rates they jump anyway."""
_AROUND = 4
"""Steps before and after used for that."""
_AT_ENDS = 0.5
"""Fraction of the price for a swap that lasts to an end of the clip. Without it, 7 of 1000 frames were exchanged
wrongly around swaps in hard detections, with it 4."""
_DEPTH_OF_DOUBT = 1.0
"""Trunk lengths of motion per unit of confidence: a limb hidden by the body stays the uncertain one."""
_STRETCH = 1.15
"""Relative to the usual maximum length of an upper bone in the image."""
_ORDER = 0.1
"""Pixels charged per pixel by which limbs in the trunk's order would lose it. Without it, 20 of 1000 frames were
exchanged wrongly in hard detections, where a slow turn's motion is below the noise."""


def unswapped(keypoints: Keypoints) -> tuple[Keypoints, dict[str, Int[np.ndarray, "n"]]]:
    """Unswap left and right limbs where a detector swapped them for some frames.

    A swap makes both limbs jump across the body and back, and stretches the bones attached to the trunk. For each pair
    of limbs, dynamic programming finds the sequence of "as detected" and "swapped" with the least motion and
    stretching; a change must save clearly. "As detected" is what holds for most frames. Frames in which a person placed
    elbows and wrists (or knees and ankles) of both sides are unchanged. A single placed keypoint follows the others: it
    was nudged in place, not assigned a side.

    Returns:
        The corrected keypoints, and the frames that were unswapped, by pair.
    """
    xy, confidence, placed = keypoints.xy.copy(), keypoints.confidence.copy(), keypoints.placed.copy()
    depth = keypoints.told_depth.copy()
    arrays = xy, confidence, placed, depth
    swaps = {}
    for name, (left, right, others) in PAIRED.items():
        settled = np.all(keypoints.placed[:, [left[:2], right[:2]]], axis=(1, 2))
        frames = _swapped_frames(_limbs(keypoints, name, settled))
        frames = frames[~settled[frames]]
        if len(frames):
            _exchange(arrays, frames, left, right)
            _exchange(arrays, frames[_go_along(keypoints[frames])], *others)
            swaps[name] = frames
    if not swaps:
        return keypoints, swaps
    depth = None if keypoints.depth is None else depth
    return replace(keypoints, xy=xy, confidence=confidence, by_hand=placed, depth=depth), swaps


def unswapped_keypoint(keypoint: int, pairs: Collection[str]) -> int:
    """The body keypoint that replaces a body keypoint where these pairs of limbs are unswapped; otherwise itself."""
    for name, (left, right, _) in PAIRED.items():
        for one, other in ((left, right), (right, left)):
            if name in pairs and keypoint in one:
                return other[one.index(keypoint)]
    return keypoint


def _exchange(arrays: Sequence[np.ndarray], frames: Int[np.ndarray, "n"], one: list[int], other: list[int]) -> None:
    there, back = np.array(one + other, int), np.array(other + one, int)
    for values in arrays:
        values[np.ix_(frames, there)] = values[np.ix_(frames, back)]


def _go_along(keypoints: Keypoints) -> Bool[np.ndarray, "T"]:
    """Whether hands change sides with their arms: not where they are detected at the other arm's wrist."""
    wrists, hands = _both("wrist"), [hand[0] for hand in _HAND]
    xy, seen = keypoints.xy, (keypoints.confidence[:, wrists + hands] > SEEN).all(1)
    straight, crossed = (np.linalg.norm(xy[:, wrists] - xy[:, h], axis=-1).sum(1) for h in (hands, hands[::-1]))
    return ~seen | (straight <= crossed)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Limbs:
    """A pair of limbs and its trunk, in the frames with evidence."""

    total: int
    """Number of frames of the clip."""
    frames: Int[np.ndarray, "F"]
    """The frames with evidence."""
    points: Float[np.ndarray, "F 2 n 3"]
    """Deciding keypoints (first the one nearest the trunk) of left and right: pixels, and the confidence as a third
    coordinate."""
    weight: Float[np.ndarray, "F n"]
    """The lower confidence of a keypoint's two sides; 0 where one is unknown."""
    roots: Float[np.ndarray, "F r 2 3"]
    """Left and right points of the trunk, pixels and 0; first the limbs' roots."""
    rooted: Bool[np.ndarray, "F r"]
    """Whether these are seen, and their sides trusted."""
    trunk: float
    """The trunk's usual length, pixels."""


def _limbs(keypoints: Keypoints, name: str, settled: Bool[np.ndarray, "T"]) -> _Limbs:
    left, right, _ = PAIRED[name]
    sides, roots = [left[:2], right[:2]], [_both(part) for part in _TRUNK[name]]
    confidence, believed, trunk = keypoints.confidence[:, sides], _believed(keypoints), _trunk(keypoints)
    weight = confidence.min(1)
    weight = np.where((weight > SEEN) & ~settled[:, None], weight, 0.0)
    frames = np.flatnonzero(weight.any(1))
    hanging = keypoints.xy[:, roots][frames]
    doubt = _DEPTH_OF_DOUBT * trunk * confidence[frames, ..., None]
    return _Limbs(
        total=len(keypoints),
        frames=frames,
        points=np.concatenate([keypoints.xy[:, sides][frames], doubt], -1),
        weight=weight[frames],
        roots=np.concatenate([hanging, np.zeros_like(hanging[..., :1])], -1),
        rooted=np.stack([believed[part] for part in _TRUNK[name]], 1)[frames],
        trunk=trunk,
    )


def _trunk(keypoints: Keypoints) -> float:
    """Pixels from neck to hips, the usual value where these are seen; 0 if they never are."""
    ends = [INDEX["neck"], INDEX["mid_hip"]]
    seen = (keypoints.confidence[:, ends] > SEEN).all(1)
    length = np.linalg.norm(keypoints.xy[seen, ends[0]] - keypoints.xy[seen, ends[1]], axis=1)
    return float(np.percentile(length, 90)) if len(length) else 0.0


def _believed(keypoints: Keypoints) -> dict[str, Bool[np.ndarray, "T"]]:
    """In which frames the sides of shoulders and hips are seen, and not contradicted by each other or by the face.

    Where shoulders and hips contradict each other, the pair consistent with the head is trusted.
    """
    seen, order = {}, {}
    for part in ("shoulder", "hip", *_HEAD):
        seen[part] = (keypoints.confidence[:, _both(part)] > SEEN).all(1)
        across = keypoints.xy[:, INDEX[f"left_{part}"], 0] - keypoints.xy[:, INDEX[f"right_{part}"], 0]
        usual = np.percentile(abs(across[seen[part]]), 90) if seen[part].any() else 0.0
        order[part] = np.sign(across) * (seen[part] & (abs(across) > _CLEAR * usual))
    head = np.where(order["ear"] != 0, order["ear"], order["eye"])
    contradicted = order["shoulder"] * order["hip"] < 0
    return {part: seen[part] & ~(contradicted & (order[part] != head)) for part in ("shoulder", "hip")}


def _swapped_frames(limbs: _Limbs) -> Int[np.ndarray, "m"]:
    """Frames to swap: the cheapest path through two states, the more frequent one being "as detected".

    Frames without evidence follow their neighbours where these agree.
    """
    if len(limbs.frames) < 3:
        return limbs.frames[:0]
    saved, price = _changes(limbs)
    swapped = _unnatural(limbs)
    swapped[[0, -1]] += _AT_ENDS * price[[0, -1]]
    path = _cheapest(price[:, None] - saved, swapped).astype(float)
    everywhere = np.interp(np.arange(limbs.total), limbs.frames, path if path.mean() <= 0.5 else 1 - path)
    return np.flatnonzero(everywhere == 1)


def _changes(limbs: _Limbs) -> tuple[Float[np.ndarray, "F-1 2"], Float[np.ndarray, "F-1"]]:
    """How much motion a change to "swapped" and back between frames saves, and how much it must save; pixels.

    A change must save both absolutely and relative to the trunk: where only the trunk's sides jump, limbs stay.
    """
    weight = np.minimum(limbs.weight[1:], limbs.weight[:-1])
    middle = np.repeat(limbs.roots.mean(2, keepdims=True), 2, axis=2)
    itself = hanging = _movement(limbs, np.zeros_like(middle[:, 0]), weight)
    for r in reversed(range(limbs.roots.shape[1])):
        known = (limbs.rooted[1:, r] & limbs.rooted[:-1, r])[:, None, None]
        itself = np.where(known, _movement(limbs, middle[:, r], weight), itself)
        hanging = np.where(known, _movement(limbs, limbs.roots[:, r], weight), hanging)
    saved = np.minimum(*(way[:, :1, 0] - way[:, [0, 1], [1, 0]] for way in (itself, hanging)))
    apart = np.linalg.norm(limbs.points[:, 0] - limbs.points[:, 1], axis=-1)
    apart = np.minimum((weight * apart[1:]).sum(1), (weight * apart[:-1]).sum(1))
    unrest = _around(np.minimum(hanging[:, 0, 0], hanging[:, 0, 1])) * np.sqrt(np.diff(limbs.frames))
    return saved, _PRICE * apart + _FLOOR * limbs.trunk + _UNREST * unrest


def _movement(
    limbs: _Limbs, roots: Float[np.ndarray, "F 2 3"], weight: Float[np.ndarray, "F-1 n"]
) -> Float[np.ndarray, "F-1 2 2"]:
    """Motion of both limbs relative to some points, from each state to each, summed over the deciding keypoints."""
    states = np.stack([limbs.points, limbs.points[:, ::-1]], 1) - roots[:, None, :, None]
    way = np.linalg.norm(states[1:, None] - states[:-1, :, None], axis=-1).sum(3)
    return (way * weight[:, None, None]).sum(-1)


def _around(way: Float[np.ndarray, "S"]) -> Float[np.ndarray, "S"]:
    """The median of the steps around each."""
    padded = np.pad(way, _AROUND, mode="reflect" if len(way) > _AROUND else "edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1), axis=1)


def _unnatural(limbs: _Limbs) -> Float[np.ndarray, "F"]:
    """Evidence against limbs being swapped in a frame, pixels: excess length of upper bones compared with the limbs as
    detected, and elbows or knees that are in the trunk's order as detected."""
    points, roots = limbs.points[:, :, 0, :2], limbs.roots[:, 0, :, :2]
    known = limbs.rooted[:, 0] & (limbs.weight[:, 0] > 0)
    if not known.any():
        return np.zeros(len(points))
    lengths = np.stack([np.linalg.norm(side - roots, axis=-1) for side in (points, points[:, ::-1])], 1)
    longest = _STRETCH * np.percentile(lengths[known].max(-1).min(-1), 95)
    over = np.maximum(lengths - longest, 0).sum(-1)
    across = roots[:, 0] - roots[:, 1]
    ordered = ((points[:, 0] - points[:, 1]) * across).sum(-1) / np.maximum(np.linalg.norm(across, axis=-1), 1e-6)
    return known * limbs.weight[:, 0] * (over[:, 1] - over[:, 0] + _ORDER * np.maximum(ordered, 0))


def _cheapest(changes: Float[np.ndarray, "F-1 2"], swapped: Float[np.ndarray, "F"]) -> Int[np.ndarray, "F"]:
    """The states on the cheapest path: 0 as detected, 1 swapped.

    Args:
        changes: Costs of a change to "swapped", and back, between frames.
        swapped: Costs of "swapped" in a frame.
    """
    total, came_from = np.array([0.0, swapped[0]]), []
    for (there, back), cost in zip(changes, swapped[1:], strict=True):
        options = total[:, None] + np.array([[0.0, there], [back, 0.0]])
        came_from.append(options.argmin(0))
        total = options.min(0) + np.array([0.0, cost])
    state = [int(total.argmin())]
    for choice in reversed(came_from):
        state.append(int(choice[state[-1]]))
    return np.array(state[::-1])
