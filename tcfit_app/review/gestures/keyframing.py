"""Which keypoints and frames follow when keypoints are moved in one frame."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX, LEFT_HAND, RIGHT_HAND
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.keyframes import LONGEST_GAP, joined
from tcfit_app.project.edits.kinds import MoveKey, MoveKeypoint, PlaceKey, RemoveKey
from tcfit_app.project.edits.space_edits import MAX_DEPTH, SetDepth

HANDS_OF = {INDEX["left_wrist"]: LEFT_HAND, INDEX["right_wrist"]: RIGHT_HAND}
"""By wrist among the body's keypoints, the hand that follows it; the hand's first keypoint is the same wrist."""


def with_hands(joints: tuple[int, ...], corrected: Corrected, frame: int) -> tuple[int, ...]:
    """Adds the keypoints of the hands whose wrists are among these, and the duplicates of those wrists.

    Only keypoints present in the frame are added.
    """
    present = corrected[frame].present
    along = [
        joint
        for wrist, hand in HANDS_OF.items()
        if wrist in joints or hand.start in joints
        for joint in (wrist, *range(hand.start, hand.stop))
        if joint not in joints and present[joint]
    ]
    return (*joints, *along)


def placed(
    corrected: Corrected, frame: int, joints: tuple[int, ...], xy: Float[ndarray, "n 2"], *, keyframes: bool
) -> MoveKeypoint | PlaceKey:
    """The edit that puts keypoints somewhere in one frame; as a keyframe, frames up to the next keyframes follow."""
    places = tuple((float(x), float(y)) for x, y in xy)
    if not keyframes:
        return MoveKeypoint(frames=(frame,), joints=joints, xy=(places,))
    return PlaceKey(frames=_around(corrected, joints, frame, frame), joints=joints, at=frame, xy=places)


def filled(
    depths_set: Float[ndarray, "F n"], frames: tuple[int, ...], depths: Float[ndarray, "m n"]
) -> tuple[tuple[int, ...], Float[ndarray, "M n"]]:
    """Depths of some frames, and interpolated ones up to the nearest frames in which depths were already set.

    Args:
        depths_set: Depths set in the whole clip, metres; NaN where none.
        frames: Ascending.
        depths: The new depths of these frames.
    """
    known = np.flatnonzero(np.isfinite(depths_set).all(1))
    before = max((f for f in known.tolist() if frames[0] - LONGEST_GAP <= f < frames[0]), default=frames[0])
    after = min((f for f in known.tolist() if frames[-1] < f <= frames[-1] + LONGEST_GAP), default=frames[-1])
    every = np.array(sorted({*frames, *range(before + 1, frames[0]), *range(frames[-1] + 1, after)}))
    ends = [*([before] if before < frames[0] else []), *frames, *([after] if after > frames[-1] else [])]
    values = np.stack([depths[frames.index(f)] if f in frames else depths_set[f] for f in ends])
    return tuple(every.tolist()), np.stack([np.interp(every, ends, column) for column in values.T], 1)


def keys_in(corrected: Corrected, joints: Iterable[int], frame: int) -> tuple[int, ...]:
    """Those with a keyframe in this frame. Raises InputError without any."""
    found = tuple(joint for joint in joints if corrected.key[frame, joint])
    if not found:
        raise InputError("None of the selected keypoints has a keyframe in this frame.")
    return found


def removed(corrected: Corrected, frame: int, joints: tuple[int, ...]) -> RemoveKey:
    """The edit that deletes a keyframe."""
    return RemoveKey(frames=_around(corrected, joints, frame, frame), joints=joints, at=frame)


def moved(corrected: Corrected, frame: int, to: int, joints: tuple[int, ...]) -> MoveKey:
    """The edit that moves a keyframe to another frame. Raises InputError if there is one already."""
    if corrected.key[to, list(joints)].any():
        raise InputError("There is already a keyframe: delete it first.")
    return MoveKey(frames=_around(corrected, joints, frame, to), joints=joints, at=frame, to=to)


def _around(corrected: Corrected, joints: tuple[int, ...], one: int, other: int) -> tuple[int, ...]:
    return tuple(joined(corrected, joints, range(min(one, other), max(one, other) + 1)))


def depth_edit(frames: tuple[int, ...], joints: tuple[int, ...], depths: Float[ndarray, "F n"]) -> SetDepth:
    """The edit that sets depths of keypoints, rounded to 0.1 mm and clipped to an edit's limits."""
    rows = np.round(np.clip(depths, -MAX_DEPTH, MAX_DEPTH), 4).tolist()
    return SetDepth(frames=frames, joints=joints, depth=tuple(map(tuple, rows)))
