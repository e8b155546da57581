"""Edits in words, for messages and for the history."""

import textwrap
from collections.abc import Iterable

import msgspec
import numpy as np

from fitting_core.keypoints import FINGER_JOINTS, PartOfPerson
from tcfit_app.analysis.body_regions import REGIONS, full_name
from tcfit_app.project.edits.edit_log import Said
from tcfit_app.project.edits.kinds import (
    AddView,
    DetectAgain,
    EditView,
    Keep,
    KeyEdit,
    MoveKey,
    RemoveView,
    SetDepth,
    ShapeHand,
    TakeOver,
)
from tcfit_app.project.edits.remarks import MarkFrames, MarkState, WriteNote, WriteNotes
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.storage.clip_review import BROWSER
from tcfit_app.review.gestures.keyframing import HANDS_OF

FEW = 3
"""Maximum number of keypoints that are named individually."""
SHORT_TEXT = 40
"""Characters of a note shown in the history."""

VERBS = {
    "move": "moved",
    "nudge": "nudged",
    "key": "moved",
    "remove_key": "keyframe deleted",
    "move_key": "keyframe moved",
    "mark_bad": "marked bad",
    "restore": "restored",
    "swap_sides": "left and right swapped:",
    "copy": "copied",
    "interpolate": "interpolated",
    "reset": "reset to the detection",
    "set_confidence": "confidence set",
    "clear_depth": "depth cleared",
    "pin": "pinned in space",
    "keep": "kept as an offset",
    "release": "offset removed",
    "lock": "rotation locked",
    "unlock": "unlocked",
    "take_over": "exchanged with",
    "detect_again": "detected again",
}
"""By `kind` of an edit, for those that `describe` does not put differently."""
MARKS: dict[MarkState | None, str] = {
    "checked": "marked as looking fine",
    "flag": "flagged",
    None: "no longer flagged or marked as looking fine",
}


def describe(edit: Said, first_frame: int = 0) -> str:
    """An edit in words: what, which keypoints, which frames; `first_frame` is the number shown for frame 0."""
    if isinstance(edit, MarkFrames):
        limbs = sorted({limb for own in edit.limbs for limb in own})
        whose = f"{', '.join(limbs)} " if len(limbs) <= FEW else f"{len(limbs)} parts "
        return f"{whose if limbs else ''}{MARKS[edit.state]}, {in_words(edit.frames, first_frame)}"
    if isinstance(edit, WriteNote):
        return f"{_note_in_words(edit)}, {in_words(edit.frames, first_frame)}"
    if isinstance(edit, WriteNotes):
        return f"{len(edit.notes)} notes imported, {in_words(edit.frames, first_frame)}"
    if isinstance(edit, ShapeHand):
        return _shape_in_words(edit, first_frame)
    if isinstance(edit, AddView):
        return f"{shortened(edit.name)} added as another view"
    if isinstance(edit, RemoveView):
        return "another view removed"
    if isinstance(edit, EditView):
        return f"in another view: {describe(msgspec.structs.replace(edit.edit, frames=edit.frames), first_frame)}"
    what = part_name(edit.part) if isinstance(edit, DetectAgain) else keypoints_in_words(edit.joints)
    verb = _in_depth(edit) if isinstance(edit, SetDepth) else VERBS[edit.kind]
    if isinstance(edit, Keep):
        parts = ("depth", "place"), ([one.depths for one in edit.kept], [one.shifts for one in edit.kept])
        what = f"{what} {' and '.join(name for name, stated in zip(*parts, strict=True) if any(stated))}"
        verb = f"of {in_words(edit.at, first_frame)} {verb}"
    if isinstance(edit, MoveKey):
        verb = f"{verb} to frame {edit.to + first_frame}"
    if isinstance(edit, KeyEdit):
        follow = [frame for frame in edit.frames if frame != edit.at]
        others = f"; {in_words(follow, first_frame)} follow" if follow else ""
        return f"{what} {verb}, {in_words((edit.at,), first_frame)}{others}"
    where = in_words(edit.frames, first_frame)
    if isinstance(edit, TakeOver):
        return f"{verb} {shortened(edit.source)}, {where}"
    return f"{verb} {what}, {where}" if verb.endswith(":") else f"{what} {verb}, {where}"


def whose(author: str, me: str) -> str:
    """Who made an edit, as shown to its reader: "you", a name, or "another browser"."""
    if author == me:
        return "you"
    return "another browser" if author.startswith((BROWSER, "tab ")) else author


def also_here(authors: Iterable[str], me: str) -> str:
    """Who else has the clip open, such as "Also here: anna, 2 other browsers"; empty if no one."""
    names = [whose(author, me) for author in dict.fromkeys(authors) if author != me]
    browsers = names.count("another browser")
    named = [name for name in names if name != "another browser"]
    named += [f"{browsers} other browsers" if browsers > 1 else "another browser"] * bool(browsers)
    return f"Also here: {', '.join(named)}" if named else ""


def part_name(part: PartOfPerson) -> str:
    """The user's name for a part that can be detected again."""
    return part.replace("_", " ")


def _note_in_words(note: WriteNote) -> str:
    if not note.text:
        return "note deleted"
    return f"note {'written' if note.replaces is None else 'changed'}: {shortened(note.text)}"


def capitalized(text: str) -> str:
    """Words as the beginning of a sentence."""
    return text[:1].upper() + text[1:]


def shortened(text: str) -> str:
    """The beginning of a text, on one line."""
    return textwrap.shorten(text, SHORT_TEXT, placeholder=" …")


def keypoints_in_words(joints: tuple[int, ...]) -> str:
    """Keypoints by name, or a whole part of the body, or their number."""
    wrists = [wrist for wrist, hand in HANDS_OF.items() if {*joints} - {*range(hand.start, hand.stop)} == {wrist}]
    if wrists and len(joints) > 1:
        return f"{full_name(wrists[0])} and its hand"
    if len(joints) > FEW:
        parts = (name for name, points in REGIONS.items() if {*points} == {*joints})
        return next(parts, f"{len(joints)} keypoints")
    return ", ".join(map(full_name, joints))


def _shape_in_words(edit: ShapeHand, first_frame: int) -> str:
    hand = next(side for side, joints in FINGER_JOINTS.items() if joints == edit.joints)
    if edit.shape is None:
        return f"{hand} hand's shape removed, {in_words(edit.frames, first_frame)}"
    lead = f", blended over {' and '.join(map(str, edit.blend))} frames" if any(edit.blend) else ""
    return f"{hand} hand given the shape {shortened(edit.name)}, {in_words(edit.whole, first_frame)}{lead}"


def _in_depth(edit: SetDepth) -> str:
    """Where keypoints were put: "12 to 34 cm in front of the pelvis"."""
    values = np.round(100 * np.array(edit.depth)).astype(int)
    return f"put {depth_words(values.min(), values.max())}"


def depth_words(least: int, most: int) -> str:
    """A range of depths relative to the pelvis in words; centimetres, positive behind it."""
    if least < 0 < most:
        return f"{-least} cm in front of to {most} cm behind the pelvis"
    near, far = sorted((abs(int(least)), abs(int(most))))
    amount = f"{far} cm" if near == far else f"{near} to {far} cm"
    return f"{amount} {'in front of' if least < 0 else 'behind'} the pelvis"
