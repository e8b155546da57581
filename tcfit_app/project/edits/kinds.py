"""What a person can change about keypoints: one type for each kind of edit.

An edit says what was done and not what came out, so it is small and can be read in the log. Its outcome depends on the
keypoints as they were before it, and on nothing else.
"""

from dataclasses import replace
from typing import get_args

import msgspec
import numpy as np

from fitting_core.errors import InputError
from fitting_core.keypoints import BODY_25, COUNT, FACE, HANDS, INDEX, LEFT_HAND, NAMES
from fitting_core.video.frame_names import spans
from tcfit_app.project.edits.corrected import Corrected

_MAX_POSITION = 1e6
"""Pixels, as for detections."""

_HAND = LEFT_HAND.stop - LEFT_HAND.start
_OTHER_SIDE = {"left": "right", "right": "left"}


def _mirrored(joint: int) -> int:
    if joint >= HANDS.start:
        return joint + (_HAND if joint < LEFT_HAND.stop else -_HAND)
    side, _, rest = NAMES[joint].partition("_")
    return INDEX[f"{_OTHER_SIDE[side]}_{rest}"] if side in _OTHER_SIDE else joint


MIRRORED = {joint: _mirrored(joint) for joint in range(FACE.start)}
"""The same keypoint on the other side: of body and hands; the nose and its like mirror to themselves."""
SIDES = {
    "body": tuple(j for j in range(len(BODY_25)) if MIRRORED[j] != j),
    "hands": tuple(range(COUNT)[HANDS]),
    "arms": tuple(INDEX[f"{side}_{n}"] for side in _OTHER_SIDE for n in ("elbow", "wrist")),
    "legs": tuple(
        INDEX[f"{side}_{n}"] for side in _OTHER_SIDE for n in ("knee", "ankle", "big_toe", "small_toe", "heel")
    ),
}
"""Keypoints that can be swapped together, by a name for them. A detector that takes one limb for the other does so from
the elbow or knee on: shoulders and hips stay on their sides."""


class _Edit(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    frames: tuple[int, ...]
    """Which frames it changes, counted from the clip's first (0)."""
    joints: tuple[int, ...]
    """Which of the 137 keypoints it changes, in all of these frames."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        """What `frames` and `joints` become.

        Args:
            now: The whole clip before this edit.
            detections: The whole clip before any edit.
        """
        raise NotImplementedError

    def problem(self, length: int) -> str:
        """What is wrong with the fields of this kind of edit in a clip of `length` frames; empty if nothing."""
        return ""


class MoveKeypoint(_Edit, frozen=True, tag="move"):
    """Put keypoints where a person says they are. A keypoint marked bad counts again."""

    xy: tuple[tuple[tuple[float, float], ...], ...]
    """Pixels, for each of `frames` and in it for each of `joints`."""
    confidence: float = 1.0

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        shape = len(self.frames), len(self.joints)
        return _placed(np.array(self.xy, dtype=float), np.full(shape, self.confidence))

    def problem(self, length: int) -> str:
        if len(self.xy) != len(self.frames) or any(len(row) != len(self.joints) for row in self.xy):
            return f"xy has not one position for each of {len(self.frames)} frames and {len(self.joints)} keypoints"
        positions = [value for row in self.xy for point in row for value in point]
        if not all(abs(value) <= _MAX_POSITION for value in positions):
            return f"a position is not a number between -{_MAX_POSITION:g} and {_MAX_POSITION:g} pixels"
        return _confidence_problem(self.confidence)


class Nudge(_Edit, frozen=True, tag="nudge"):
    """Move keypoints a little from where they are; those not there, or marked bad, stay as they are."""

    by: tuple[float, float]
    """Pixels, x right, y down."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        here = now.at(self.frames, self.joints)
        return _chosen(here.present, _placed(here.xy + np.array(self.by), np.ones_like(here.confidence)), here)

    def problem(self, length: int) -> str:
        near = all(abs(value) <= _MAX_POSITION for value in self.by)
        return "" if near else f"the distance is not a number between -{_MAX_POSITION:g} and {_MAX_POSITION:g} pixels"


class MarkBad(_Edit, frozen=True, tag="mark_bad"):
    """Take keypoints out of the fit: their confidence is 0 until they are restored."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        here = now.at(self.frames, self.joints)
        return replace(here, bad=np.ones_like(here.bad))


class Restore(_Edit, frozen=True, tag="restore"):
    """Take back that keypoints are bad: they have the confidence again that they had before."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        here = now.at(self.frames, self.joints)
        return replace(here, bad=np.zeros_like(here.bad))


class SwapSides(_Edit, frozen=True, tag="swap_sides"):
    """Exchange left and right. `joints` names both sides (see SIDES); confidences and marks go along."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        other = now.at(self.frames, tuple(MIRRORED[joint] for joint in self.joints))
        return replace(other, edited=np.ones_like(other.edited))

    def problem(self, length: int) -> str:
        if face := [NAMES[j] for j in self.joints if j not in MIRRORED]:
            return f"{face[0]} belongs to the face, whose sides cannot be swapped"
        lone = [NAMES[j] for j in self.joints if MIRRORED[j] not in self.joints]
        return f"{lone[0]} is named without the same keypoint of the other side" if lone else ""


class CopyFrom(_Edit, frozen=True, tag="copy"):
    """Take keypoints from another frame. One that is not there, or marked bad, is then so here too."""

    source: int
    """The frame to copy from."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        one = now.at((self.source,), self.joints)
        source = Corrected(**{name: np.repeat(array, len(self.frames), 0) for name, array in vars(one).items()})
        return replace(_placed(source.xy, np.where(source.confidence > 0, 1.0, 0.0)), bad=source.bad)

    def problem(self, length: int) -> str:
        return "" if 0 <= self.source < length else f"it copies from frame {self.source}"


class Interpolate(_Edit, frozen=True, tag="interpolate"):
    """Put keypoints on the straight line between two frames; those that one of the two lacks stay as they are."""

    first: int
    """A frame before all of `frames`."""
    last: int
    """A frame after them."""

    @staticmethod
    def between(first: int, last: int, joints: tuple[int, ...]) -> "Interpolate":
        """Fill all frames between two."""
        return Interpolate(frames=tuple(range(first + 1, last)), joints=joints, first=first, last=last)

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        here, ends = now.at(self.frames, self.joints), now.at((self.first, self.last), self.joints)
        share = (np.array(self.frames) - self.first)[:, None, None] / (self.last - self.first)
        line = _placed((1 - share) * ends.xy[0] + share * ends.xy[1], np.ones_like(here.confidence))
        return _chosen(np.broadcast_to(ends.present.all(0), here.bad.shape), line, here)

    def problem(self, length: int) -> str:
        if not 0 <= self.first < min(self.frames) <= max(self.frames) < self.last < length:
            return f"the frames to fill do not lie between frames {self.first} and {self.last} of the clip"
        return ""


class Reset(_Edit, frozen=True, tag="reset"):
    """Back to what was detected."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        return detections.at(self.frames, self.joints)


class SetConfidence(_Edit, frozen=True, tag="set_confidence"):
    """Say how sure keypoints are, without moving them. One marked bad counts again; one that is nowhere stays so."""

    confidence: float

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        here = now.at(self.frames, self.joints)
        return _chosen(here.confidence > 0, _placed(here.xy, np.full_like(here.confidence, self.confidence)), here)

    def problem(self, length: int) -> str:
        return _confidence_problem(self.confidence)


Edit = MoveKeypoint | Nudge | MarkBad | Restore | SwapSides | CopyFrom | Interpolate | Reset | SetConfidence
KINDS: dict[str, type[Edit]] = {kind.__struct_config__.tag: kind for kind in get_args(Edit)}
"""Every kind of edit by its name in the log; a new one is a class above and its name in Edit."""


def check(edit: Edit, length: int) -> None:
    """Refuse an edit that makes no sense in a clip of `length` frames.

    Raises:
        InputError: Frames or keypoints that do not exist or come twice, none at all, or wrong values.
    """
    problem = (
        _choice_problem(edit.frames, length, f"the clip has frames 0 to {length - 1}", "frame")
        or _choice_problem(edit.joints, COUNT, f"keypoints have numbers 0 to {COUNT - 1}", "keypoint")
        or edit.problem(length)
    )
    if problem:
        kind = str(edit.__struct_config__.tag).replace("_", " ")
        raise InputError(f"The edit ({kind}) cannot be made: {problem}. Nothing was changed.")


def _choice_problem(chosen: tuple[int, ...], count: int, existing: str, noun: str) -> str:
    if not chosen:
        return f"it names no {noun}"
    if outside := sorted(n for n in set(chosen) if not 0 <= n < count):
        return f"there is no {noun} {spans(outside)}; {existing}"
    return "" if len(set(chosen)) == len(chosen) else f"it names a {noun} twice"


def _confidence_problem(confidence: float) -> str:
    return "" if 0 <= confidence <= 1 else f"the confidence is {confidence:g}; expected 0 to 1"


def _placed(xy: np.ndarray, confidence: np.ndarray) -> Corrected:
    """Keypoints that a person vouches for."""
    return Corrected(
        xy=xy, confidence=confidence, bad=np.zeros(confidence.shape, bool), edited=np.ones(confidence.shape, bool)
    )


def _chosen(where: np.ndarray, one: Corrected, other: Corrected) -> Corrected:
    """`one` where the mask is true, else `other`."""
    return Corrected(
        xy=np.where(where[..., None], one.xy, other.xy),
        confidence=np.where(where, one.confidence, other.confidence),
        bad=np.where(where, one.bad, other.bad),
        edited=np.where(where, one.edited, other.edited),
    )
