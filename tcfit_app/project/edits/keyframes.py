"""Keyframes of keypoints: frames between two of them are interpolated."""

from bisect import bisect_left, bisect_right

import numpy as np
from jaxtyping import Bool, Float

from tcfit_app.project.edits.corrected import Corrected

_SAME = 1e-6
"""Shifts smaller than this, in pixels, are rounding errors of sums: the keypoint is at its detection."""


LONGEST_GAP = 30
"""Maximum distance between two keyframes that are interpolated, in frames."""


def joined(now: Corrected, joints: tuple[int, ...], at: range, reach: int = LONGEST_GAP) -> range:
    """All frames that a change of these keypoints' keyframes in the frames `at` may change: `frames` of the edits.

    They end before the next keyframes on both sides. Keyframes farther away than `reach` count only if frames are
    already interpolated towards them.
    """
    start, stop, reach = at.start, at.stop, max(reach, 1)
    for joint in joints:
        key = now.key[:, joint]
        # Distant ones are searched for only along interpolated frames: a long clip has too many frames.
        before = key[: at.start] if _follows(now, joint, at.start - 1) else key[max(at.start - reach, 0) : at.start]
        after = key[at.stop :] if _follows(now, joint, at.stop) else key[at.stop : at.stop + reach]
        if before.any():
            start = min(start, at.start - int(before[::-1].argmax()))
        if after.any():
            stop = max(stop, at.stop + int(after.argmax()))
    return range(start, stop)


def _follows(now: Corrected, joint: int, frame: int) -> bool:
    """Whether the frame exists, and keyframes have moved the keypoint in it."""
    return 0 <= frame < len(now.records) and bool(now.shift[frame, joint].any())


def keyed(
    now: Corrected,
    detections: Corrected,
    frames: range,
    joints: tuple[int, ...],
    *,
    removed: int | None = None,
    placed: int | None = None,
    xy: Float[np.ndarray, "n 2"] | None = None,
) -> Corrected:
    """Keypoints in some frames after one of their keyframes was added, removed, or moved.

    Between two keyframes, detected positions keep their motion and are shifted by the interpolated shift of the two;
    those not detected or marked bad are interpolated linearly.

    Args:
        now: The whole clip before the change.
        detections: The whole clip before any edit.
        frames: Those that may change. The frames just outside are only read: keyframes that bound them.
        joints: The keyframe's keypoints.
        removed: The frame that is no longer a keyframe.
        placed: The frame that becomes a keyframe.
        xy: The positions in `placed`, pixels.
    """
    start, stop = max(frames.start - 1, 0), min(frames.stop + 1, len(now.xy))
    seen = tuple(range(start, stop))
    values, detected = now.at(seen, joints), detections.at(seen, joints)
    there = _there(values)
    base = np.where(there[..., None], values.xy - values.shift, 0.0)
    changed = sorted(frame - start for frame in (removed, placed) if frame is not None)
    for column in range(len(joints)):
        one, found = (Corrected(records=part.records[:, column]) for part in (values, detected))
        keys = np.flatnonzero(one.key).tolist()
        before, after = bisect_left(keys, changed[0]), bisect_right(keys, changed[-1])
        first = keys[before - 1] if before > 0 else changed[0]
        last = keys[after] if after < len(keys) else changed[-1]
        if removed is not None:
            one.key[removed - start] = False
        if placed is not None and xy is not None:
            row = placed - start
            one.xy[row], one.shift[row] = xy[column], xy[column] - base[row, column]
            one.confidence[row], one.bad[row], one.edited[row], one.key[row] = 1.0, False, True, True
            one.pinned[row] = False
        rows = slice(first, last + 1)
        one, found = (Corrected(records=part.records[rows]) for part in (one, found))
        _follow(one, found, there[rows, column], base[rows, column])
    inside = slice(frames.start - start, frames.stop - start)
    return Corrected(records=values.records[inside])


def carried(now: Corrected, joints: tuple[int, ...], frame: int, to: int) -> Float[np.ndarray, "n 2"]:
    """Positions of a keyframe's keypoints in another frame: the same offset from the detection, or without one the same
    place."""
    ends = now.at((frame, to), joints)
    there = _there(ends)
    shifted = ends.xy[1] - ends.shift[1] + ends.shift[0]
    return np.where((there[0] & there[1])[:, None], shifted, ends.xy[0])


def _there(values: Corrected) -> Bool[np.ndarray, "*any"]:
    """Whether it has a position without keyframes, and is not marked bad."""
    return (values.xy - values.shift).any(-1) & (values.confidence > 0) & ~values.bad


def _follow(one: Corrected, found: Corrected, there: Bool[np.ndarray, "n"], base: Float[np.ndarray, "n 2"]) -> None:
    """Interpolate frames between keyframes, and reset those no longer between any; one keypoint, in place.

    Args:
        one: Its current state, with keyframes.
        found: As detected.
        there: Whether it has a position without keyframes.
        base: That position, pixels; (0, 0) if it is missing.
    """
    keys, between = np.flatnonzero(one.key), ~one.key
    if len(keys):
        between[: keys[0]] = between[keys[-1] :] = False
    else:
        between[:] = False
    if between.any():
        rows = np.arange(len(base))
        path = _interpolated(rows, np.flatnonzero(there), base) if there.any() else base
        path = path + _interpolated(rows, keys, one.xy - path)
        one.xy[between], one.shift[between] = path[between], (path - base)[between]
        one.confidence[between & ~there] = 1.0
        one.bad[between], one.edited[between], one.pinned[between] = False, True, False
    back = ~between & ~one.key & one.shift.any(-1)
    if not back.any():
        return
    detected = np.all(abs(base - found.xy * (found.confidence > 0)[:, None]) < _SAME, axis=-1)
    one.xy[back], one.shift[back], one.edited[back] = base[back], 0.0, ~detected[back]
    same, gone = back & detected, back & ~there
    one.xy[same], one.confidence[same] = found.xy[same], found.confidence[same]
    one.confidence[gone] = 0.0


def _interpolated(rows: np.ndarray, known: np.ndarray, values: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    return np.stack([np.interp(rows, known, values[known, axis]) for axis in (0, 1)], 1)
