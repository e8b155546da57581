"""Edits of keypoints in space: their depths, the offsets kept of them, and the rotations of joints."""

from typing import Annotated

import msgspec
import numpy as np

from fitting_core.keypoints import BODY_25, FINGER_JOINTS, LOCKABLE, NAMES, KeptOffset
from tcfit_app.project.edits.base import EditBase, Point, choice_problem, count_problem, place
from tcfit_app.project.edits.corrected import Corrected

MAX_DEPTH = 3.0
"""Metres from the pelvis: no arm or leg is longer."""
_Depth = Annotated[float, msgspec.Meta(ge=-MAX_DEPTH, le=MAX_DEPTH)]
_Angle = Annotated[float, msgspec.Meta(ge=-7, le=7)]
"""Radians: up to slightly more than a full turn."""
Turn = tuple[_Angle, _Angle, _Angle]
"""Axis-angle in radians."""
Shape = Annotated[tuple[Turn, ...], msgspec.Meta(min_length=15, max_length=15)]
"""Turns of a hand's finger joints."""


class SetDepth(EditBase, frozen=True, tag="depth"):
    """Set the depth of body keypoints, without moving them in the image. Bad ones stay bad."""

    depth: tuple[tuple[_Depth, ...], ...]
    """Metres behind the pelvis along the camera's z, for each of `frames` and each of `joints`."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.depth[:], here.pinned[:] = self.depth, False

    def problem(self, length: int) -> str:
        return count_problem("depth", self.depth, self.joints, self.frames) or _depth_problem(self.joints)


class ClearDepth(EditBase, frozen=True, tag="clear_depth"):
    """Clear the depth of body keypoints; everything else stays."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.depth[:], here.pinned[:] = np.nan, False

    def problem(self, length: int) -> str:
        return _depth_problem(self.joints)


class Pin(EditBase, frozen=True, tag="pin"):
    """Pin body keypoints to one place in space in all of `frames`. Bad ones are restored."""

    xy: tuple[Point, ...]
    """Pixels, for each of `joints`; the camera does not move."""
    depth: tuple[tuple[_Depth, ...], ...]
    """As in `SetDepth`: per frame, because the pelvis moves."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.depth[:] = self.depth
        place(here, np.array(self.xy, dtype=float), 1.0)
        here.pinned[:] = True

    def problem(self, length: int) -> str:
        return (
            count_problem("position", [self.xy], self.joints)
            or count_problem("depth", self.depth, self.joints, self.frames)
            or _depth_problem(self.joints)
        )


class Keep(EditBase, frozen=True, tag="keep"):
    """Keep depths and places stated in a few frames as an offset that holds in all of `frames` (`KeptOffset`), which is
    no part of the keypoints."""

    at: tuple[int, ...]
    """The frames in which they are stated."""
    depth: tuple[tuple[_Depth | None, ...], ...]
    """As in `SetDepth`, for each of `at` and each of `joints`; None: not stated."""
    shift: tuple[tuple[Point | None, ...], ...] = ()
    """Pixels by which keyframes moved them, likewise; earlier versions kept none."""

    @property
    def kept(self) -> tuple[KeptOffset, ...]:
        """For each of `joints`."""
        none = ((None,) * len(self.joints),) * len(self.at)
        rows = [*zip(self.at, self.depth, self.shift or none, strict=True)]
        return tuple(
            KeptOffset(
                keypoint=joint,
                frames=self.frames,
                depths={frame: z for frame, depths, _ in rows if (z := depths[column]) is not None},
                shifts={frame: by for frame, _, shifts in rows if (by := shifts[column]) is not None},
            )
            for column, joint in enumerate(self.joints)
        )

    def problem(self, length: int) -> str:
        problem = (
            choice_problem(self.at, length, "the clip has no others", "frame")
            or count_problem("depth", self.depth, self.joints, self.at)
            or (count_problem("shift", self.shift, self.joints, self.at) if self.shift else "")
            or _depth_problem(self.joints)
        )
        if problem:
            return problem
        unknown = [NAMES[one.keypoint] for one in self.kept if not one.depths and not one.shifts]
        return f"no depth and no place of {unknown[0]} is stated" if unknown else ""


class Release(EditBase, frozen=True, tag="release"):
    """Remove the offsets of keypoints that hold in any of `frames`, which are all frames in which they hold."""

    def problem(self, length: int) -> str:
        return _depth_problem(self.joints)


class Lock(EditBase, frozen=True, tag="lock"):
    """Lock the rotation of body joints relative to their parents in all of `frames`; keypoints stay as they are."""

    turn: tuple[Turn, ...]
    """For each of `joints` (see LOCKABLE)."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.turn[:] = self.turn

    def problem(self, length: int) -> str:
        return count_problem("rotation", [self.turn], self.joints) or _lock_problem(self.joints)


class Unlock(EditBase, frozen=True, tag="unlock"):
    """Unlock the rotation of joints; everything else stays."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.turn[:] = np.nan

    def problem(self, length: int) -> str:
        return _lock_problem(self.joints)


class ShapeHand(EditBase, frozen=True, tag="shape_hand"):
    """Give a hand a shape in consecutive frames, or none; keypoints stay as they are (see `Keypoints.overruled`)."""

    name: str
    """Of the shape, for people."""
    shape: Shape | None
    """For each of `joints`, which are FINGER_JOINTS of the hand; None: the hand is as it is seen again."""
    blend: tuple[int, int] = (0, 0)
    """How many of the first frames lead to the shape, and of the last ones away from it."""
    before: Shape | None = None
    """The hand before the first frame, where `blend` begins unless a shape was stated there."""
    after: Shape | None = None
    """The hand after the last frame."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.turn[:] = np.nan if self.shape is None else self.shape
        ends = (self.frames[0] - 1, self.before), (self.frames[-1] + 1, self.after)
        for turns, count, (frame, seen) in zip((here.turn, here.turn[::-1]), self.blend, ends, strict=True):
            if count:
                stated = now.at((frame,), self.joints).turn[0]
                start = stated if np.isfinite(stated).all() else np.array(seen)
                share = (np.arange(count) + 1)[:, None, None] / (count + 1)
                turns[:count] = start + share**2 * (3 - 2 * share) * (turns[:count] - start)

    @property
    def whole(self) -> tuple[int, ...]:
        """The frames that have the shape itself."""
        return self.frames[self.blend[0] : len(self.frames) - self.blend[1]]

    def problem(self, length: int) -> str:
        if self.joints not in FINGER_JOINTS.values():
            return "its keypoints are not the finger joints of one hand"
        if self.frames != tuple(range(self.frames[0], self.frames[-1] + 1)):
            return "its frames are not consecutive"
        if min(self.blend) < 0 or sum(self.blend) >= len(self.frames):
            return "as many frames lead to or from the shape as there are, or a negative number"
        inside = self.frames[0] > 0, self.frames[-1] + 1 < length
        ends = zip(self.blend, (self.before, self.after), inside, strict=True)
        if any(count and (self.shape is None or seen is None or not there) for count, seen, there in ends):
            return "frames lead to or from the shape where nothing says what the hand is before or after"
        return ""


def _depth_problem(joints: tuple[int, ...]) -> str:
    others = [NAMES[j] for j in joints if j >= len(BODY_25)]
    return f"{others[0]} is not a body keypoint, and only those have a depth" if others else ""


def _lock_problem(joints: tuple[int, ...]) -> str:
    others = [NAMES[j] for j in joints if j not in LOCKABLE]
    return f"{others[0]} cannot be locked: only joints of neck, head, arms and legs can" if others else ""
