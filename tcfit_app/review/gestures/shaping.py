"""Giving hands a shape in one tab: a named one, one of the user's own, that of another frame or of the other hand."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
import platformdirs
from jaxtyping import Float

from fitting_core.body.handshapes import HANDSHAPES, finger_angles, in_hand
from fitting_core.body.model import POSE_JOINTS
from fitting_core.body.params import full_pose
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file
from fitting_core.keypoints import FINGER_JOINTS, INDEX, LEFT_HAND, RIGHT_HAND, Side
from tcfit_app.fitting.fits import Shown
from tcfit_app.project.edits.space_edits import Shape, ShapeHand
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.gestures.correcting import Correcting, across_sides
from tcfit_app.review.tab.tab import Tab

OTHER: dict[Side, Side] = {"left": "right", "right": "left"}
HAND_POINTS: dict[Side, slice] = {"left": LEFT_HAND, "right": RIGHT_HAND}
MOST_BLEND = 30
_MOST_BYTES = 2**20
_MOST_SHAPES = 200
LONGEST = 30
"""Characters of a name."""
_Angle = Annotated[float, msgspec.Meta(ge=-7.0, le=7.0)]
_Hand = Annotated[list[tuple[_Angle, _Angle, _Angle]], msgspec.Meta(min_length=15, max_length=15)]
_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST, pattern=r"^\S(.*\S)?$")]


@dataclass(frozen=True, kw_only=True, eq=False)
class HandPose:
    """The shape of a hand, with a name for people."""

    name: str
    angles: Float[np.ndarray, "15 3"]
    """Axis-angle in radians of the finger joints, as a left hand's."""


class ShapingHands:
    """Hands given a shape in one tab. Methods raise InputError for what cannot be done, and then change nothing."""

    def __init__(self, tab: Tab, correcting: Correcting) -> None:
        self._tab, self._correcting = tab, correcting
        self.blend = 4
        """Frames before and after the chosen ones in which a hand goes over into its shape and out of it."""
        self.copied: HandPose | None = None
        self.last: HandPose | None = None
        """The one given last."""

    def side(self) -> Side:
        """The hand of the selected keypoints, as the picture shows them. Raises InputError if it is not one hand."""
        chosen = self._tab.state.selection
        sides: list[Side] = [
            side
            for side, points in HAND_POINTS.items()
            if any(points.start <= joint < points.stop or joint == INDEX[f"{side}_wrist"] for joint in chosen)
        ]
        if len(sides) != 1:
            raise InputError("Select a hand first: one of its keypoints, or its wrist.")
        return sides[0]

    def give_named(self, name: str) -> None:
        """Give the selected hand one of HANDSHAPES in the chosen frames."""
        self.give(HandPose(name=name, angles=finger_angles(HANDSHAPES[name], "left")))

    def give_own(self, name: str) -> None:
        """Give it one of the user's own shapes."""
        if name not in (own := own_handshapes()):
            raise InputError(f"Your shape {name!r} is no longer there.")
        self.give(HandPose(name=name, angles=own[name]))

    def give_copied(self) -> None:
        """Give it the shape copied before."""
        if self.copied is None:
            raise InputError("Copy the shape of a hand first.")
        self.give(self.copied)

    def give_other(self) -> None:
        """Give it the shape that the other hand has in the frame on show, mirrored."""
        self.give(self._on_show(OTHER[self._of_body()]))

    def give_last(self) -> None:
        """Give it the shape given last."""
        if self.last is None:
            raise InputError("Give a hand a shape first, in the panel Correct.")
        self.give(self.last)

    def copy(self) -> None:
        """Copy the selected hand's shape in the frame on show."""
        self.copied = self._on_show(self._of_body())

    def save(self, name: str) -> None:
        """Keep the selected hand's shape in the frame on show as one of the user's own."""
        keep_handshape(name, self._on_show(self._of_body()).angles)

    def give(self, pose: HandPose) -> None:
        """Give the selected hand a shape in the chosen frames, with frames around them that lead to it and from it."""
        tab, shown, side = self._tab, self._shown(), self._of_body()
        chosen = tab.frames_to_change
        before, after = chosen[0] - self.blend - 1, chosen[-1] + self.blend + 1
        before, after = max(before, 0), min(after, tab.length - 1)
        leads = [(max(chosen[0] - before - 1, 0), before), (max(after - chosen[-1] - 1, 0), after)]
        leads = [(count if shown.has(frame) else 0, frame) for count, frame in leads]
        (count_in, _), (count_out, _) = leads
        edit = ShapeHand(
            frames=tuple(range(chosen[0] - count_in, chosen[-1] + count_out + 1)),
            joints=FINGER_JOINTS[side],
            name=pose.name,
            shape=_rounded(in_hand(pose.angles, side)),
            blend=(count_in, count_out),
            before=_rounded(self._angles(shown, side, before)) if count_in else None,
            after=_rounded(self._angles(shown, side, after)) if count_out else None,
        )
        self._correcting.make(edit)
        self.last = pose

    def free(self) -> None:
        """Remove the selected hand's shape in the selected frames, so that its keypoints count again."""
        tab, joints = self._tab, FINGER_JOINTS[self._of_body()]
        frames = tab.frames_to_change
        if not tab.session.project.corrected[np.ix_(frames, joints)].locked.any():
            where = in_words(frames, tab.first_frame)
            raise InputError(f"No hand shape is set in {where}.")
        self._correcting.make(ShapeHand(frames=frames, joints=joints, name="", shape=None))

    def _of_body(self) -> Side:
        """The body's hand that the selected keypoints are of in the fit on show, which swaps sides back."""
        side = self.side()
        if self._tab.state.mode == "space":
            return side
        wrist = (INDEX[f"{side}_wrist"],)
        return side if across_sides(self._tab, self._shown(), self._tab.state.frame, wrist) == wrist else OTHER[side]

    def _on_show(self, side: Side) -> HandPose:
        frame = self._tab.state.frame
        angles = in_hand(self._angles(self._shown(), side, frame), side)
        return HandPose(name=f"{side} hand of frame {frame + self._tab.first_frame}", angles=angles)

    def _shown(self) -> Shown:
        shown = self._tab.look().b
        if shown is None or not shown.has(self._tab.state.frame):
            raise InputError("Hand shapes are copied from the fit. There is no fit in this frame yet.")
        return shown

    def _angles(self, shown: Shown, side: Side, frame: int) -> Float[np.ndarray, "15 3"]:
        body = self._tab.session.bodies.of(shown.run.body)
        return full_pose(body, shown.params[[frame]])[0, POSE_JOINTS[f"{side}_hand_pose"]].numpy()


def _rounded(angles: Float[np.ndarray, "15 3"]) -> Shape:
    return tuple((x, y, z) for x, y, z in np.round(angles, 5).tolist())


# --- the user's own shapes, for all projects: a file in the user's data folder ---


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    format: Literal["tcfit handshapes 1"] = "tcfit handshapes 1"
    shapes: Annotated[dict[_Name, _Hand], msgspec.Meta(max_length=_MOST_SHAPES)] = msgspec.field(default_factory=dict)
    """Axis-angle in radians of a left hand's 15 finger joints in SMPL-X's order, by name."""


def own_handshapes_file() -> Path:
    """Where they are; it may not exist yet."""
    return platformdirs.user_data_path("tcfit", appauthor=False) / "handshapes.json"


def own_handshapes() -> dict[str, Float[np.ndarray, "15 3"]]:
    """By name, as angles of a left hand.

    Raises:
        InputError: The file cannot be read, or is not such a file.
    """
    path = own_handshapes_file()
    try:
        known = path.stat()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise _unreadable(path, error) from error
    return {name: np.array(hand) for name, hand in _read(path, known.st_mtime_ns, known.st_size).shapes.items()}


def keep_handshape(name: str, angles: Float[np.ndarray, "15 3"] | None) -> None:
    """Add a shape of a left hand, or replace the one of this name; None deletes it.

    Raises:
        InputError: The name cannot be used, there is no such shape to delete, there are too many, or the file cannot be
            read or written, which leaves it as it is.
    """
    path, shapes = own_handshapes_file(), own_handshapes()
    if angles is None:
        if name not in shapes:
            raise InputError(f"There is no shape of yours named {name!r}.")
        del shapes[name]
    else:
        if name in HANDSHAPES:
            raise InputError(f"{name!r} is one of tcfit's shapes. Choose another name.")
        shapes[name] = angles
    stored = {each: np.round(hand, 5).tolist() for each, hand in shapes.items()}
    try:
        content = msgspec.convert({"format": _Stored().format, "shapes": stored}, _Stored)
    except msgspec.ValidationError as error:
        raise InputError(
            f"{name!r} cannot be kept: a name has 1 to {LONGEST} characters, without spaces around them, and there are "
            f"at most {_MOST_SHAPES} shapes ({error})."
        ) from error
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as draft:
            draft.write_bytes(msgspec.json.format(msgspec.json.encode(content)))
    except OSError as error:
        raise InputError(f"{path}: your handshapes cannot be written ({error}). Nothing was changed.") from error


@lru_cache(maxsize=1)  # a panel asks each time it is drawn
def _read(path: Path, changed: int, size: int) -> _Stored:
    try:
        return msgspec.json.decode(regular_file(path, most=_MOST_BYTES).read_bytes(), type=_Stored)
    except (OSError, InputError, msgspec.MsgspecError) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(
        f"{path}: your handshapes cannot be read ({error}). Mend the file, or move it away to begin a new one; until "
        "then none is saved."
    )
