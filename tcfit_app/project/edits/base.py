"""What every kind of edit has, and what may be wrong with its fields."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np

from fitting_core.video.frame_names import spans
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.packed_points import unpacked

MAX_POSITION = 1e6
"""Pixels, as for detections."""
_Pixels = Annotated[float, msgspec.Meta(ge=-MAX_POSITION, le=MAX_POSITION)]
Point = tuple[_Pixels, _Pixels]


class Action(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """One line of the log."""


class EditBase(Action, frozen=True, gc=False):
    """What every edit is; the module of its kind says what it does."""

    frames: tuple[int, ...]
    """The frames it changes, from the clip's first (0)."""
    joints: tuple[int, ...]
    """Which of the 137 keypoints it changes, in all of these frames."""

    @property
    def kind(self) -> str:
        """Its tag in the log."""
        return str(self.__struct_config__.tag)

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        """The new values of `frames` and `joints`.

        Args:
            now: The whole clip before this edit.
            detections: The whole clip before any edit.
        """
        here = now.at(self.frames, self.joints)
        self.change(here, now)
        return here

    def change(self, here: Corrected, now: Corrected) -> None:
        """Change a copy of the values `here`; kinds without it leave the clip's own keypoints as they are."""

    def problem(self, length: int) -> str:
        """What is wrong with this edit's fields in a clip of `length` frames; empty if nothing."""
        return ""


def place(here: Corrected, xy: np.ndarray, confidence: np.ndarray | float, *, where: np.ndarray | bool = True) -> None:
    """Set positions as edited by a person; depths and turns stay."""
    of_points = where if isinstance(where, bool) else where[..., None]
    np.copyto(here.xy, xy, where=of_points)
    np.copyto(here.shift, 0.0, where=of_points)
    np.copyto(here.confidence, confidence, where=where)
    np.copyto(here.edited, True, where=where)
    np.copyto(here.bad, False, where=where)
    np.copyto(here.key, False, where=where)
    np.copyto(here.pinned, False, where=where)


def choice_problem(chosen: tuple[int, ...], count: int, existing: str, noun: str, first: int = 0) -> str:
    """For frames or keypoints, of which `count` exist."""
    if not chosen:
        return f"it names no {noun}"
    if min(chosen) >= 0 and max(chosen) < count and len(set(chosen)) == len(chosen):
        return ""
    if outside := sorted(first + n for n in set(chosen) if not 0 <= n < count):
        return f"there is no {noun} {spans(outside)}; {existing}"
    return f"it names a {noun} twice"


def packed_problem(content: bytes, frames: int, joints: int, numbers: int) -> str:
    """For packed x, y, confidence, and maybe more."""
    try:
        points = unpacked(content, frames, joints, numbers)
    except ValueError as error:
        return str(error)
    if not (points[..., 2] >= 0).all() or not (points[..., 2] <= 1).all():
        return "a confidence is not a number from 0 to 1"
    near = (np.abs(points[..., :2]) <= MAX_POSITION).all()
    return "" if near else f"a position is not a number between -{MAX_POSITION:g} and {MAX_POSITION:g} pixels"


def count_problem(
    noun: str, rows: Sequence[Sequence[object]], joints: Sequence[int], frames: Sequence[int] = (0,)
) -> str:
    """For values of each keypoint in each of some frames."""
    if len(rows) == len(frames) and all(len(row) == len(joints) for row in rows):
        return ""
    return f"it does not have one {noun} for each of {len(joints)} keypoints in {len(frames)} frames"
