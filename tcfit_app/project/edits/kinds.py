"""What a person can change about keypoints: one type per kind of edit.

An edit records the action, not its outcome, so it is small and readable in the log. The outcome depends only on the
keypoints before it.
"""

from collections.abc import Sequence
from typing import Annotated, get_args

import msgspec
import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera, is_possible, is_rotation
from fitting_core.clip import Clip, OtherView
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
    LOCKABLE,
    NAMES,
    PARTS,
    KeptOffset,
    Keypoints,
    PartOfPerson,
)
from fitting_core.relation import Relation
from fitting_core.video.frame_names import spans
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.keyframes import carried, keyed
from tcfit_app.project.edits.packed_points import packed, unpacked

_MAX_POSITION = 1e6
"""Pixels, as for detections."""
MAX_DEPTH = 3.0
"""Metres from the pelvis: no arm or leg is longer."""
_Pixels = Annotated[float, msgspec.Meta(ge=-_MAX_POSITION, le=_MAX_POSITION)]
_Point = tuple[_Pixels, _Pixels]
_Confidence = Annotated[float, msgspec.Meta(ge=0, le=1)]
_Depth = Annotated[float, msgspec.Meta(ge=-MAX_DEPTH, le=MAX_DEPTH)]
_Angle = Annotated[float, msgspec.Meta(ge=-7, le=7)]
"""Radians: up to slightly more than a full turn."""
Turn = tuple[_Angle, _Angle, _Angle]
"""Axis-angle in radians."""
Shape = Annotated[tuple[Turn, ...], msgspec.Meta(min_length=15, max_length=15)]
"""Turns of a hand's finger joints."""

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


class _Edit(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", gc=False):
    frames: tuple[int, ...]
    """The frames it changes, from the clip's first (0)."""
    joints: tuple[int, ...]
    """Which of the 137 keypoints it changes, in all of these frames."""

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
        """Change a copy of the values `here`, for kinds that need no detections."""
        raise NotImplementedError

    def problem(self, length: int) -> str:
        """What is wrong with this edit's fields in a clip of `length` frames; empty if nothing."""
        return ""


class MoveKeypoint(_Edit, frozen=True, tag="move"):
    """Move keypoints to given positions. A keypoint marked bad is restored."""

    xy: tuple[tuple[_Point, ...], ...]
    """Pixels, for each of `frames` and each of `joints`."""
    confidence: _Confidence = 1.0

    def change(self, here: Corrected, now: Corrected) -> None:
        _place(here, np.array(self.xy, dtype=float), self.confidence)

    def problem(self, length: int) -> str:
        return _count_problem("position", self.xy, self.joints, self.frames)


class Nudge(_Edit, frozen=True, tag="nudge"):
    """Move keypoints slightly; missing ones and those marked bad stay."""

    by: _Point
    """Pixels, x right, y down."""

    def change(self, here: Corrected, now: Corrected) -> None:
        _place(here, here.xy + np.array(self.by), 1.0, where=here.present)


class MarkBad(_Edit, frozen=True, tag="mark_bad"):
    """Exclude keypoints from the fit: confidence 0 until they are restored, and their depth is ignored."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.bad[:] = True


class Restore(_Edit, frozen=True, tag="restore"):
    """Restore bad keypoints with their previous confidence and depth."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.bad[:] = False


class SwapSides(_Edit, frozen=True, tag="swap_sides"):
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


class CopyFrom(_Edit, frozen=True, tag="copy"):
    """Copy keypoints from another frame, with their depth. Missing and bad ones become so here too."""

    source: int
    """The frame to copy from."""

    def change(self, here: Corrected, now: Corrected) -> None:
        source = now.at((self.source,), self.joints)
        _place(here, source.xy, np.where(source.confidence > 0, 1.0, 0.0))
        here.bad[:], here.depth[:] = source.bad, source.depth

    def problem(self, length: int) -> str:
        return "" if 0 <= self.source < length else "it copies from a frame that the clip does not have"


class Interpolate(_Edit, frozen=True, tag="interpolate"):
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
        _place(here, xy, 1.0, where=in_both)

    def problem(self, length: int) -> str:
        if not 0 <= self.first < min(self.frames) <= max(self.frames) < self.last < length:
            return "the frames to fill are not between its two frames, or those are outside the clip"
        return ""


class Reset(_Edit, frozen=True, tag="reset"):
    """Reset to the detection, without depth. The shape of a hand stays unless all of its finger joints are reset."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        made = detections.at(self.frames, self.joints)
        for hand in FINGER_JOINTS.values():
            if not {*hand} <= {*self.joints}:  # single fingers leave the hand's shape
                of_hand = np.isin(self.joints, hand)
                made.turn[:, of_hand] = now.at(self.frames, self.joints).turn[:, of_hand]
        return made


class SetConfidence(_Edit, frozen=True, tag="set_confidence"):
    """Set confidence without moving; made by earlier versions only. A bad keypoint is restored; a missing one stays
    missing."""

    confidence: _Confidence

    def change(self, here: Corrected, now: Corrected) -> None:
        there = here.confidence > 0
        here.confidence[there], here.bad[there], here.edited[there] = self.confidence, False, True


class SetDepth(_Edit, frozen=True, tag="depth"):
    """Set the depth of body keypoints, without moving them in the image. Bad ones stay bad."""

    depth: tuple[tuple[_Depth, ...], ...]
    """Metres behind the pelvis along the camera's z, for each of `frames` and each of `joints`."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.depth[:], here.pinned[:] = self.depth, False

    def problem(self, length: int) -> str:
        return _count_problem("depth", self.depth, self.joints, self.frames) or _depth_problem(self.joints)


class ClearDepth(_Edit, frozen=True, tag="clear_depth"):
    """Clear the depth of body keypoints; everything else stays."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.depth[:], here.pinned[:] = np.nan, False

    def problem(self, length: int) -> str:
        return _depth_problem(self.joints)


class Pin(_Edit, frozen=True, tag="pin"):
    """Pin body keypoints to one place in space in all of `frames`. Bad ones are restored."""

    xy: tuple[_Point, ...]
    """Pixels, for each of `joints`; the camera does not move."""
    depth: tuple[tuple[_Depth, ...], ...]
    """As in `SetDepth`: per frame, because the pelvis moves."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.depth[:] = self.depth
        _place(here, np.array(self.xy, dtype=float), 1.0)
        here.pinned[:] = True

    def problem(self, length: int) -> str:
        return (
            _count_problem("position", [self.xy], self.joints)
            or _count_problem("depth", self.depth, self.joints, self.frames)
            or _depth_problem(self.joints)
        )


class _OfOffset(_Edit, frozen=True):
    """An edit of a kept offset of body keypoints (`KeptOffset`), which is no part of the keypoints."""

    def change(self, here: Corrected, now: Corrected) -> None:
        pass

    def problem(self, length: int) -> str:
        return _depth_problem(self.joints)


class Keep(_OfOffset, frozen=True, tag="keep"):
    """Keep depths and places stated in a few frames as an offset that holds in all of `frames`."""

    at: tuple[int, ...]
    """The frames in which they are stated."""
    depth: tuple[tuple[_Depth | None, ...], ...]
    """As in `SetDepth`, for each of `at` and each of `joints`; None: not stated."""
    shift: tuple[tuple[_Point | None, ...], ...] = ()
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
            _choice_problem(self.at, length, "the clip has no others", "frame")
            or _count_problem("depth", self.depth, self.joints, self.at)
            or (_count_problem("shift", self.shift, self.joints, self.at) if self.shift else "")
            or super().problem(length)
        )
        if problem:
            return problem
        unknown = [NAMES[one.keypoint] for one in self.kept if not one.depths and not one.shifts]
        return f"no depth and no place of {unknown[0]} is stated" if unknown else ""


class Release(_OfOffset, frozen=True, tag="release"):
    """Remove the offsets of keypoints that hold in any of `frames`, which are all frames in which they hold."""


class Lock(_Edit, frozen=True, tag="lock"):
    """Lock the rotation of body joints relative to their parents in all of `frames`; keypoints stay as they are."""

    turn: tuple[Turn, ...]
    """For each of `joints` (see LOCKABLE)."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.turn[:] = self.turn

    def problem(self, length: int) -> str:
        return _count_problem("rotation", [self.turn], self.joints) or _lock_problem(self.joints)


class Unlock(_Edit, frozen=True, tag="unlock"):
    """Unlock the rotation of joints; everything else stays."""

    def change(self, here: Corrected, now: Corrected) -> None:
        here.turn[:] = np.nan

    def problem(self, length: int) -> str:
        return _lock_problem(self.joints)


class ShapeHand(_Edit, frozen=True, tag="shape_hand"):
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


class TakeOver(_Edit, frozen=True, tag="take_over"):
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
        _place(here, taken[..., :2], taken[..., 2])
        here.edited[:] = taken[..., 3] > 0
        here.depth[:], here.turn[:] = np.nan, np.nan

    def problem(self, length: int) -> str:
        try:
            taken = unpacked(self.packed, len(self.frames), len(self.joints), 4)
        except ValueError as error:
            return str(error)
        return _points_problem(taken)


class DetectAgain(_Edit, frozen=True, tag="detect_again"):
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
        try:
            return _points_problem(unpacked(self.packed, len(self.frames), len(self.joints), 3))
        except ValueError as error:
            return str(error)


class _KeyEdit(_Edit, frozen=True):
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

    xy: tuple[_Point, ...]
    """Pixels in the frame `at`, for each of `joints`."""

    def values(self, now: Corrected, detections: Corrected) -> Corrected:
        xy = np.array(self.xy, dtype=float)
        return keyed(now, detections, self._span, self.joints, placed=self.at, xy=xy)

    def problem(self, length: int) -> str:
        return _count_problem("position", [self.xy], self.joints) or super().problem(length)


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


class _OfViews(_Edit, frozen=True):
    """An edit of other views of the person: it changes the fit in `frames`, and none of the clip's own keypoints."""

    def change(self, here: Corrected, now: Corrected) -> None:
        pass


class AddView(_OfViews, frozen=True, tag="add_view"):
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
        try:
            return _points_problem(unpacked(self.packed, self.count, COUNT, 3))
        except ValueError as error:
            return str(error)


class RemoveView(_OfViews, frozen=True, tag="remove_view"):
    """Remove a view that was added."""

    view: int
    """Id of the log entry that added it."""


KeypointEdit = MoveKeypoint | Nudge | MarkBad | Restore | SwapSides | CopyFrom | Interpolate | Reset
"""Edits of keypoints in the image, which other views take too."""


class EditView(_OfViews, frozen=True, tag="edit_view"):
    """Edit keypoints of another view."""

    view: int
    """Id of the log entry that added it."""
    edit: KeypointEdit
    """Its frames are those of the view, from its first (0)."""


Edit = (
    MoveKeypoint
    | Nudge
    | MarkBad
    | Restore
    | SwapSides
    | CopyFrom
    | Interpolate
    | Reset
    | SetConfidence
    | SetDepth
    | ClearDepth
    | PlaceKey
    | RemoveKey
    | MoveKey
    | Pin
    | Keep
    | Release
    | Lock
    | Unlock
    | ShapeHand
    | TakeOver
    | DetectAgain
    | AddView
    | RemoveView
    | EditView
)
OfViews = AddView | RemoveView | EditView
"""They change other views only."""
NewDetections = TakeOver | DetectAgain
"""Their keypoints count as detected from then on."""
KINDS: dict[str, type[Edit]] = {kind.__struct_config__.tag: kind for kind in get_args(Edit)}
"""Every kind of edit by its name in the log; to add one, write a class above and add it to Edit."""


def check(edit: Edit, length: int, first_frame: int = 0) -> None:
    """Refuse an edit that is invalid in a clip of `length` frames; `first_frame` is the number shown for frame 0.

    Raises:
        InputError: Frames or keypoints are missing, repeated or do not exist, or values are invalid.
    """
    problem = (
        _choice_problem(edit.frames, length, clip_has(length, first_frame), "frame", first_frame)
        or _joints_problem(edit)
        or edit.problem(length)
    )
    if problem:
        kind = str(edit.__struct_config__.tag).replace("_", " ")
        raise InputError(f"Invalid edit ({kind}): {problem}. Nothing was changed.")


def _joints_problem(edit: Edit) -> str:
    if isinstance(edit, OfViews):
        return "it names keypoints of the clip itself" if edit.joints else ""
    return _choice_problem(edit.joints, COUNT, f"keypoints have numbers 0 to {COUNT - 1}", "keypoint")


def clip_has(length: int, first_frame: int) -> str:
    """Which frames exist, as users number them."""
    return f"the clip has frames {first_frame} to {first_frame + length - 1}"


def _choice_problem(chosen: tuple[int, ...], count: int, existing: str, noun: str, first: int = 0) -> str:
    if not chosen:
        return f"it names no {noun}"
    if min(chosen) >= 0 and max(chosen) < count and len(set(chosen)) == len(chosen):
        return ""
    if outside := sorted(first + n for n in set(chosen) if not 0 <= n < count):
        return f"there is no {noun} {spans(outside)}; {existing}"
    return f"it names a {noun} twice"


def _points_problem(points: Float[np.ndarray, "F K n"]) -> str:
    """For x, y and confidence."""
    if not (points[..., 2] >= 0).all() or not (points[..., 2] <= 1).all():
        return "a confidence is not a number from 0 to 1"
    near = (np.abs(points[..., :2]) <= _MAX_POSITION).all()
    return "" if near else f"a position is not a number between -{_MAX_POSITION:g} and {_MAX_POSITION:g} pixels"


def _count_problem(
    noun: str, rows: Sequence[Sequence[object]], joints: Sequence[int], frames: Sequence[int] = (0,)
) -> str:
    """For values of each keypoint in each of some frames."""
    if len(rows) == len(frames) and all(len(row) == len(joints) for row in rows):
        return ""
    return f"it does not have one {noun} for each of {len(joints)} keypoints in {len(frames)} frames"


def _depth_problem(joints: tuple[int, ...]) -> str:
    others = [NAMES[j] for j in joints if j >= len(BODY_25)]
    return f"{others[0]} is not a body keypoint, and only those have a depth" if others else ""


def _lock_problem(joints: tuple[int, ...]) -> str:
    others = [NAMES[j] for j in joints if j not in LOCKABLE]
    return f"{others[0]} cannot be locked: only joints of neck, head, arms and legs can" if others else ""


def _place(here: Corrected, xy: np.ndarray, confidence: np.ndarray | float, *, where: np.ndarray | bool = True) -> None:
    """Set positions as edited by a person; depths and turns stay."""
    of_points = where if isinstance(where, bool) else where[..., None]
    np.copyto(here.xy, xy, where=of_points)
    np.copyto(here.shift, 0.0, where=of_points)
    np.copyto(here.confidence, confidence, where=where)
    np.copyto(here.edited, True, where=where)
    np.copyto(here.bad, False, where=where)
    np.copyto(here.key, False, where=where)
    np.copyto(here.pinned, False, where=where)
