"""What a person can change about keypoints: one type per kind of edit.

An edit records the action, not its outcome, so it is small and readable in the log. The outcome depends only on the
keypoints before it.
"""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera, is_possible, is_rotation
from fitting_core.clip import Clip, OtherView, Relation
from fitting_core.errors import InputError
from fitting_core.keypoints import (
    BODY_25,
    COUNT,
    FACE,
    FINGER_JOINTS,
    GROUPS,
    HANDS,
    INDEX,
    LEFT_HAND,
    NAMES,
    PARTS,
    Keypoints,
    PartOfPerson,
)
from tcfit_app.project.edits.base import EditBase, Point, choice_problem, count_problem, packed_problem, place
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.keyframes import carried, keyed
from tcfit_app.project.edits.packed_points import packed, unpacked
from tcfit_app.project.edits.space_edits import ClearDepth, Keep, Lock, Pin, Release, SetDepth, ShapeHand, Unlock

_Confidence = Annotated[float, msgspec.Meta(ge=0, le=1)]
_HAND = LEFT_HAND.stop - LEFT_HAND.start
_OTHER_SIDE = {"left": "right", "right": "left"}


def _mirrored(joint: int) -> int:
    if joint >= HANDS.start:
        return joint + (_HAND if joint < LEFT_HAND.stop else -_HAND)
    side, _, rest = NAMES[joint].partition("_")
    return INDEX[f"{_OTHER_SIDE[side]}_{rest}"] if side in _OTHER_SIDE else joint


MIRRORED = {joint: _mirrored(joint) for joint in range(FACE.start)}
"""The same keypoint on the other side, for body and hands; the nose and other central ones map to themselves."""
SWAPPABLE = {
    "body": tuple(j for j in range(len(BODY_25)) if MIRRORED[j] != j),
    "hands": tuple(range(COUNT)[HANDS]),
    "arms": tuple(INDEX[f"{side}_{n}"] for side in _OTHER_SIDE for n in ("elbow", "wrist")),
    "legs": tuple(
        INDEX[f"{side}_{n}"] for side in _OTHER_SIDE for n in ("knee", "ankle", "big_toe", "small_toe", "heel")
    ),
}
"""Keypoints that can be swapped together, by name. Detectors confuse limbs from the elbow or knee on: shoulders and
hips stay on their sides."""


class MoveKeypoint(EditBase, frozen=True, tag="move"):
    """Move keypoints to given positions. A keypoint marked bad is restored."""

    xy: tuple[tuple[Point, ...], ...]
    """Pixels, for each of `frames` and each of `joints`."""
    confidence: _Confidence = 1.0

    def change(self, here: Corrected, now: Corrected) -> None:
        place(here, np.array(self.xy, dtype=float), self.confidence)

    def problem(self, length: int) -> str:
        return count_problem("position", self.xy, self.joints, self.frames)


class Nudge(EditBase, frozen=True, tag="nudge"):
    """Move keypoints slightly; missing ones and those marked bad stay."""

    by: Point
    """Pixels, x right, y down."""

    def change(self, here: Corrected, now: Corrected) -> None:
        place(here, here.xy + np.array(self.by), 1.0, where=here.present)


class MarkBad(EditBase, frozen=True, tag="mark_bad"):
    """Exclude keypoints from the fit: confidence 0 until they are restored, and their depth is ignored."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.bad[:] = True


class Restore(EditBase, frozen=True, tag="restore"):
    """Restore bad keypoints with their previous confidence and depth."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.bad[:] = False


class SwapSides(EditBase, frozen=True, tag="swap_sides"):
    """Exchange left and right. `joints` has both sides (see SWAPPABLE); confidences, depths and marks are exchanged
    too."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        other = now.at(self.frames, tuple(MIRRORED[joint] for joint in self.joints))
        other.edited[:] = True
        other.turn[:] = now.at(self.frames, self.joints).turn
        return other

    def problem(self, length: int) -> str:
        if face := [NAMES[j] for j in self.joints if j not in MIRRORED]:
            return f"{face[0]} belongs to the face, whose sides cannot be swapped"
        lone = [NAMES[j] for j in self.joints if MIRRORED[j] not in self.joints]
        return f"{lone[0]} is named without its counterpart on the other side" if lone else ""


class CopyFrom(EditBase, frozen=True, tag="copy"):
    """Copy keypoints from another frame, with their depth. Missing and bad ones become so here too."""

    source: int
    """The frame to copy from."""

    def change(self, here: Corrected, now: Corrected) -> None:
        source = now.at((self.source,), self.joints)
        place(here, source.xy, np.where(source.confidence > 0, 1.0, 0.0))
        here.bad[:], here.depth[:] = source.bad, source.depth

    def problem(self, length: int) -> str:
        return "" if 0 <= self.source < length else "it copies from a frame that the clip does not have"


class Interpolate(EditBase, frozen=True, tag="interpolate"):
    """Interpolate keypoints linearly between two frames; those missing in either stay as they are.

    Depths are interpolated independently of positions, if set in both frames.
    """

    first: int
    """A frame before all of `frames`."""
    last: int
    """A frame after them."""

    @staticmethod
    def between(first: int, last: int, joints: tuple[int, ...]) -> "Interpolate":
        """Fill all frames between two."""
        return Interpolate(frames=tuple(range(first + 1, last)), joints=joints, first=first, last=last)

    def change(self, here: Corrected, now: Corrected) -> None:
        ends = now.at((self.first, self.last), self.joints)
        share = (np.array(self.frames) - self.first)[:, None] / (self.last - self.first)
        depth = (1 - share) * ends.told_depth[0] + share * ends.told_depth[1]
        xy = (1 - share)[..., None] * ends.xy[0] + share[..., None] * ends.xy[1]
        in_both = np.logical_and(*ends.present)
        np.copyto(here.depth, depth, where=np.isfinite(depth))
        place(here, xy, 1.0, where=in_both)

    def problem(self, length: int) -> str:
        if not 0 <= self.first < min(self.frames) <= max(self.frames) < self.last < length:
            return "the frames to fill are not between its two frames, or those are outside the clip"
        return ""


class Reset(EditBase, frozen=True, tag="reset"):
    """Reset to the detection, without depth. The shape of a hand stays unless all of its finger joints are reset."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        made = detections.at(self.frames, self.joints)
        for hand in FINGER_JOINTS.values():
            if not {*hand} <= {*self.joints}:  # single fingers leave the hand's shape
                of_hand = np.isin(self.joints, hand)
                made.turn[:, of_hand] = now.at(self.frames, self.joints).turn[:, of_hand]
        return made


KeypointEdit = MoveKeypoint | Nudge | MarkBad | Restore | SwapSides | CopyFrom | Interpolate | Reset
"""Edits of keypoints in the image, which other views take too."""


class SetConfidence(EditBase, frozen=True, tag="set_confidence"):
    """Set confidence without moving; made by earlier versions only. A bad keypoint is restored; a missing one stays
    missing."""

    confidence: _Confidence

    def change(self, here: Corrected, now: Corrected) -> None:
        there = here.confidence > 0
        here.confidence[there], here.bad[there], here.edited[there] = self.confidence, False, True


class TakeOver(EditBase, frozen=True, tag="take_over"):
    """Take over keypoints from another of the clip's people, with whom this one was confused.

    They count as detected here, except for those placed there by a person. Depths and turns are cleared."""

    source: str
    """That person's name."""
    exchange: str
    """Shared with the edit in that person's project, which takes over the keypoints from here."""
    packed: bytes
    """The result of `packed_points.packed`, for each of `frames` and each of `joints`."""

    def change(self, here: Corrected, now: Corrected) -> None:
        taken = unpacked(self.packed, len(self.frames), len(self.joints), 4)
        place(here, taken[..., :2], taken[..., 2])
        here.edited[:] = taken[..., 3] > 0
        here.depth[:], here.turn[:] = np.nan, np.nan

    def problem(self, length: int) -> str:
        return packed_problem(self.packed, len(self.frames), len(self.joints), 4)


class DetectAgain(EditBase, frozen=True, tag="detect_again"):
    """The result of a second look, replacing the detection; depths and turns are cleared.

    Body, hands and face are unchanged in frames in which nothing was found of them.
    """

    part: PartOfPerson
    """What was detected; `joints` are its keypoints."""
    packed: bytes
    """The result of `packed_points.packed` for x, y and confidence, for each of `frames` and each of `joints`."""

    @staticmethod
    def found(frames: Sequence[int], part: PartOfPerson, points: Float[np.ndarray, "f 137 3"]) -> "DetectAgain":
        """The detection of a part: x, y in pixels and confidence, 0 where not found."""
        joints = range(COUNT)[PARTS[part]]
        return DetectAgain(frames=tuple(frames), joints=tuple(joints), part=part, packed=packed(points[:, PARTS[part]]))

    def change(self, here: Corrected, now: Corrected) -> None:
        points = unpacked(self.packed, len(self.frames), len(self.joints), 3)
        new = Corrected.as_detected(points[..., :2], points[..., 2])
        for group in GROUPS.values():
            inside = np.isin(self.joints, range(COUNT)[group])
            found = new.confidence[:, inside].max(1, initial=0.0) > 0
            np.copyto(here.records, new.records, where=found[:, None] & inside)

    def problem(self, length: int) -> str:
        if self.joints != tuple(range(COUNT)[PARTS[self.part]]):
            return f"its keypoints are not those of the {self.part.replace('_', ' ')}"
        return packed_problem(self.packed, len(self.frames), len(self.joints), 3)


NewDetections = TakeOver | DetectAgain
"""Their keypoints count as detected from then on."""


class _KeyEdit(EditBase, frozen=True):
    """An edit of a keyframe; `frames` are all frames it may change: those strictly between the neighbouring
    keyframes."""

    at: int
    """The keyframe, one of `frames`."""

    def problem(self, length: int) -> str:
        if self.frames != tuple(self._span):
            return "its frames are not consecutive"
        return "" if self.at in self.frames else "its keyframe is not among its frames"

    @property
    def _span(self) -> range:
        return range(self.frames[0], self.frames[-1] + 1)


class PlaceKey(_KeyEdit, frozen=True, tag="key"):
    """Set a keyframe: move keypoints in one frame, and interpolate to the keyframes before and after.

    Detected positions in between keep their motion and are shifted by the interpolated shift of the two; those not
    detected or marked bad are interpolated linearly.
    """

    xy: tuple[Point, ...]
    """Pixels in the frame `at`, for each of `joints`."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        xy = np.array(self.xy, dtype=float)
        return keyed(now, detections, self._span, self.joints, placed=self.at, xy=xy)

    def problem(self, length: int) -> str:
        return count_problem("position", [self.xy], self.joints) or super().problem(length)


class RemoveKey(_KeyEdit, frozen=True, tag="remove_key"):
    """Delete a keyframe: its frame is interpolated from those before and after, or reset without any."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        return keyed(now, detections, self._span, self.joints, removed=self.at)


class MoveKey(_KeyEdit, frozen=True, tag="move_key"):
    """Move a keyframe to another frame, with the same offset from the detection."""

    to: int
    """The other frame, one of `frames`."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        xy = carried(now, self.joints, self.at, self.to)
        return keyed(now, detections, self._span, self.joints, removed=self.at, placed=self.to, xy=xy)

    def problem(self, length: int) -> str:
        return super().problem(length) or ("" if self.to in self.frames else "the new keyframe is not among its frames")


KeyEdit = PlaceKey | RemoveKey | MoveKey


class AddView(EditBase, frozen=True, tag="add_view"):
    """Add another view of the person. Its id in the log identifies the view; where its video is may change, and is
    stored beside the log."""

    name: str
    """Of its clip, for people."""
    count: int
    """Number of its frames."""
    first_frame: int
    frame_rate: float
    detector: str
    camera: Camera
    relation: Relation
    """To the clip, found with the clip's camera of `focal`."""
    focal: tuple[float, float]
    packed: bytes
    """The result of `packed_points.packed` for x, y and confidence, for each of its frames and all keypoints."""
    times: tuple[float, ...] | None = None
    """As in `OtherView`."""

    @staticmethod
    def of(view: OtherView, clip: Clip) -> "AddView":
        """Add a view that is related to a clip, for all of the clip's frames."""
        other, keypoints, relation = view.clip, view.clip.keypoints, view.relation
        assert relation is not None, "views are related to the clip before they are added"
        return AddView(
            frames=tuple(range(len(clip))),
            joints=(),
            name=other.name,
            count=len(other),
            first_frame=other.first_frame,
            frame_rate=other.frame_rate,
            detector=other.detector,
            camera=other.camera,
            relation=relation,
            focal=clip.camera.focal,
            packed=packed(np.dstack([keypoints.xy, keypoints.confidence])),
            times=None if view.times is None else tuple(view.times.tolist()),
        )

    @property
    def keypoints(self) -> Keypoints:
        """As they were detected. Raises ValueError if they cannot be unpacked."""
        points = unpacked(self.packed, self.count, COUNT, 3)
        return Keypoints(xy=points[..., :2], confidence=points[..., 2])

    def problem(self, length: int) -> str:
        relation, times = self.relation, self.times
        numbers = [self.frame_rate, *relation.translation, relation.offset, *np.ravel(relation.rotation), *self.focal]
        if not np.isfinite(numbers).all() or self.frame_rate <= 0 or min(self.focal) <= 0 or self.first_frame < 0:
            return "a number of the view is not finite, or not positive"
        if not is_possible(self.camera) or self.camera.path is not None or not is_rotation(relation.turn):
            return "the camera of the view, or how it relates to the clip's, is invalid"
        if times is not None and (len(times) != self.count or not (np.diff(times) > 0).all()):
            return f"the view has {len(times)} times for {self.count} frames, or they do not rise"
        if not self.name.strip() or not self.name.isprintable():
            return "the view's name is not one line"
        if self.count < 2:
            return f"the view has {self.count} frames, expected 2 or more"
        return packed_problem(self.packed, self.count, COUNT, 3)


class RemoveView(EditBase, frozen=True, tag="remove_view"):
    """Remove a view that was added."""

    view: int
    """Id of the log entry that added it."""


class EditView(EditBase, frozen=True, tag="edit_view"):
    """Edit keypoints of another view."""

    view: int
    """Id of the log entry that added it."""
    edit: KeypointEdit
    """Its frames are those of the view, from its first (0)."""


OfViews = AddView | RemoveView | EditView
"""Edits of other views of the person: they change the fit in `frames`, and none of the clip's own keypoints."""
SpaceEdit = SetDepth | ClearDepth | Pin | Keep | Release | Lock | Unlock | ShapeHand
Edit = KeypointEdit | SetConfidence | NewDetections | KeyEdit | SpaceEdit | OfViews
"""Every kind of edit; to add one, write a class and add it to one of these."""


def check(edit: Edit, length: int, first_frame: int = 0) -> None:
    """Refuse an edit that is invalid in a clip of `length` frames; `first_frame` is the number shown for frame 0.

    Raises:
        InputError: Frames or keypoints are missing, repeated or do not exist, or values are invalid.
    """
    problem = (
        choice_problem(edit.frames, length, clip_has(length, first_frame), "frame", first_frame)
        or _joints_problem(edit)
        or edit.problem(length)
    )
    if problem:
        raise InputError(f"Invalid edit ({edit.kind.replace('_', ' ')}): {problem}. Nothing was changed.")


def _joints_problem(edit: Edit) -> str:
    if isinstance(edit, OfViews):
        return "it names keypoints of the clip itself" if edit.joints else ""
    return choice_problem(edit.joints, COUNT, f"keypoints have numbers 0 to {COUNT - 1}", "keypoint")


def clip_has(length: int, first_frame: int) -> str:
    """Which frames exist, as users number them."""
    return f"the clip has frames {first_frame} to {first_frame + length - 1}"
