"""The log of edits and remarks, and the keypoints that result from it.

The log is append-only. Besides edits and remarks (marks and notes) it has Undo and Redo, which name the entry they undo
or redo:

- An edit or a remark is done; entries undone before it can no longer be redone.
- Undo reverts the last one done. Redo restores the one undone last.
- The keypoints are the detections with all edits done, in order. Keypoints taken over from another person, or found by
a second look, count as detected from then on.
- A frame's mark is the last one done. Its notes are those done, except for replaced ones.

The log belongs to the project, not to a browser: two people working on one project undo each other's edits.
"""

import itertools
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Literal, get_args

import msgspec

from fitting_core.errors import InputError
from fitting_core.keypoints import KeptOffset, Keypoints
from tcfit_app.project.edits.base import Action
from tcfit_app.project.edits.corrected import Corrected, read_only
from tcfit_app.project.edits.kinds import (
    AddView,
    Edit,
    EditView,
    Keep,
    NewDetections,
    OfViews,
    Release,
    RemoveView,
    TakeOver,
    check,
    clip_has,
)
from tcfit_app.project.edits.other_views import StandingView, standing_views
from tcfit_app.project.edits.remarks import NOTE_CHARACTERS, MarkFrames, Note, Remark, WriteNote, WriteNotes, note_id
from tcfit_app.project.edits.standing import Standing

_MEMORY = 256 * 2**20
"""Memory in bytes for undo; where that does not suffice, all edits are replayed."""
_UNDOABLE = 1000
"""How many of the edits replayed can be undone without replaying all again: keeping more would slow down long logs."""


class Undo(Action, frozen=True, tag="undo"):
    """Undoes an edit or a remark."""

    edit: int
    """Its id."""


class Redo(Action, frozen=True, tag="redo"):
    """Redoes an edit or a remark."""

    edit: int
    """Its id."""


Said = Edit | Remark
"""Everything that can be undone."""
LogAction = Said | Undo | Redo
_DECODER = msgspec.json.Decoder(LogAction)


@dataclass(frozen=True, kw_only=True)
class LogEntry:
    """One line of the log."""

    id: int
    """Ascending from 1."""
    time: datetime
    author: str
    """Who did it, by the name that the app gives authors."""
    action: LogAction


def frames_changed(
    log: Iterable[LogEntry], said: Callable[[int], Said], *, views: bool = True
) -> dict[int, tuple[int, ...]]:
    """The frames whose keypoints each entry changes, by its id: for Undo and Redo those of their edit, for remarks
    none.

    Args:
        log: entries, all or some.
        said: Returns the action of an entry's id, for entries undone and redone.
        views: Views added and removed change all frames; False: none, because no fit moves before the next one.
    """
    found: dict[int, tuple[int, ...]] = {}
    for entry in log:
        action = said(entry.action.edit) if isinstance(entry.action, Undo | Redo) else entry.action
        unchanged = isinstance(action, Remark) or (isinstance(action, AddView | RemoveView) and not views)
        found[entry.id] = () if unchanged else action.frames
    return found


def encode(action: LogAction) -> str:
    """The action as JSON."""
    return msgspec.json.encode(action).decode()


def decode(text: str | bytes) -> LogAction:
    """Decode the result of `encode`.

    Raises:
        InputError: It is not a known action, or has unexpected fields.
    """
    try:
        return _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(
            f"An edit cannot be read ({error}): it is damaged, or from another version of tcfit. Update tcfit."
        ) from error


Marking = Literal["touched", "bad", "key"]
"""A field of `Corrected`, shown per frame in the timeline."""


class EditHistory:
    """The state that a log produces: the corrected keypoints, and what can be undone and redone.

    The cost of adding an entry depends on the frames it changes, not on the lengths of clip and log. Not thread-safe.
    Returned keypoints never change; `corrected` and `detected` are views of the current state.
    """

    def __init__(
        self,
        detections: Keypoints,
        entries: Iterable[LogEntry] = (),
        *,
        first_frame: int = 0,
        leave_out: Callable[[LogEntry, InputError], None] | None = None,
    ) -> None:
        """Apply a log.

        Args:
            detections: The keypoints before any edit.
            entries: In order.
            first_frame: The number shown for the clip's first frame.
            leave_out: Called with each invalid entry and the reason.

        Raises:
            InputError: An entry is invalid, and there is no `leave_out`.
        """
        self._original, self._first_frame = detections, first_frame
        self._detections = self._now = Corrected.none(detections)
        self._done: list[LogEntry] = []
        self._undone: list[LogEntry] = []
        self._by_kind: defaultdict[type[Said], list[LogEntry]] = defaultdict(list)
        """Those of _done."""
        self._views: tuple[StandingView, ...] = ()
        self.standing: Standing[Said] = Standing()
        """What stood after each entry."""
        self._before: deque[tuple[Edit, Corrected, Corrected | None]] = deque()
        """What the last edits of _done overwrote, as far as memory allows; including detections."""
        self._bytes = 0
        self._keypoints = replace(detections, xy=read_only(detections.xy), confidence=read_only(detections.confidence))
        """The keypoints to fit before the frames in `_changed` changed."""
        self._changed: set[int] = set()
        self._touched: set[int] = set()
        """All frames changed by any edit."""
        self._marked: dict[Marking, set[int]] = {marking: set() for marking in get_args(Marking)}
        """The frames with any such keypoint, except for those in `_unmarked`."""
        self._unmarked: set[int] = set()
        for entry in tuple(entries):  # entries undone in the end need not be applied
            try:
                self.check(entry.action)
            except InputError as error:
                if leave_out is None:
                    raise
                leave_out(entry, error)
            else:
                self._take_up(entry)
        self._make_all()

    @property
    def undoable(self) -> LogEntry | None:
        """The edit or remark that undo would revert."""
        return self._done[-1] if self._done else None

    @property
    def redoable(self) -> LogEntry | None:
        """The edit or remark that redo would restore."""
        return self._undone[-1] if self._undone else None

    @property
    def marks(self) -> list[LogEntry]:
        """The marks done, in order."""
        return self._done_of(MarkFrames)

    @property
    def notes(self) -> tuple[Note, ...]:
        """The current notes, in order of frames."""
        found: dict[int, Note] = {}
        for entry in self._done_of(WriteNote, WriteNotes):
            assert isinstance(entry.action, WriteNote | WriteNotes)
            for place, (frames, text, replaces) in enumerate(entry.action.texts):
                number = note_id(entry.id, place) if replaces is None else replaces
                found.pop(number, None)
                if text:
                    found[number] = Note(id=number, frames=frames, text=text, time=entry.time, author=entry.author)
        return tuple(sorted(found.values(), key=lambda note: (note.frames.start, note.id)))

    @property
    def exchanges(self) -> list[LogEntry]:
        """Keypoints taken over from others, in order."""
        return self._done_of(TakeOver)

    @property
    def kept(self) -> tuple[KeptOffset, ...]:
        """The current offsets, in the order in which they were kept."""
        found: list[KeptOffset] = []
        for entry in self._done_of(Keep, Release):
            if isinstance(edit := entry.action, Keep):
                found += edit.kept
            elif isinstance(edit, Release):
                joints, frames = {*edit.joints}, {*edit.frames}
                found = [one for one in found if one.keypoint not in joints or frames.isdisjoint(one.frames)]
        return tuple(found)

    @property
    def views(self) -> tuple[StandingView, ...]:
        """The other views, in the order in which they were added; the same objects unless they have changed."""
        self._views = standing_views(self._view_edits, self._views)
        return self._views

    @property
    def _view_edits(self) -> list[tuple[int, OfViews]]:
        done = self._done_of(*get_args(OfViews))
        return [(entry.id, entry.action) for entry in done if isinstance(entry.action, OfViews)]

    @property
    def detected(self) -> Corrected:
        """The base of corrections: the detections, as replaced by take-overs and second looks."""
        return self._detections.view

    @property
    def corrected(self) -> Corrected:
        """The whole clip in its current state, including which keypoints were edited."""
        return self._now.view

    def marked(self, marking: Marking) -> list[int]:
        """The frames with any keypoint for which this holds, in order."""
        if frames := sorted(self._unmarked):
            rows = Corrected(records=self._now.records[frames])
            for name, marked in self._marked.items():
                marked.difference_update(frames)
                marked.update(itertools.compress(frames, getattr(rows, name).any(1)))
            self._unmarked.clear()
        return sorted(self._marked[marking])

    @property
    def keypoints(self) -> Keypoints:
        """The keypoints to fit."""
        if frames := sorted(self._changed):
            now = Corrected(records=self._now.records[frames]).put_into(self._keypoints, frames)
            self._keypoints = replace(now, kept=self.kept)
            self._changed.clear()
        return self._keypoints

    def check(self, action: LogAction) -> None:
        """Raise InputError if this cannot be the next action."""
        if isinstance(action, WriteNote | WriteNotes):
            return self._check_notes(action)
        if isinstance(action, MarkFrames):
            if len(action.limbs) not in (0, len(action.frames)):
                raise InputError(f"A mark names the limbs of {len(action.limbs)} of {len(action.frames)} frames.")
            return self._check_frames(action.frames)
        if not isinstance(action, Undo | Redo):
            check(action, len(self._now.xy), self._first_frame)
            return self._check_view(action) if isinstance(action, RemoveView | EditView) else None
        verb, expected = ("undone", self.undoable) if isinstance(action, Undo) else ("redone", self.redoable)
        if expected is None or expected.id != action.edit:
            now = f"edit {expected.id} is" if expected else "nothing is"
            raise InputError(
                f"Edit {action.edit} cannot be {verb} now; {now} next. Someone else may have edited meanwhile."
            )

    def _check_view(self, edit: RemoveView | EditView) -> None:
        removed = {action.view for _, action in self._view_edits if isinstance(action, RemoveView)}
        added = {number: action for number, action in self._view_edits if isinstance(action, AddView)}
        if edit.view not in added.keys() - removed:
            raise InputError("This other view is no longer there: someone has removed it.")
        if isinstance(edit, EditView):
            view = added[edit.view]
            check(edit.edit, view.count, view.first_frame)

    def _check_frames(self, frames: tuple[int, ...]) -> None:
        length, first = len(self._now.xy), self._first_frame
        if outside := [frame for frame in frames if not 0 <= frame < length]:
            raise InputError(f"There is no frame {first + outside[0]}; {clip_has(length, first)}.")

    def _check_notes(self, written: WriteNote | WriteNotes) -> None:
        there = {known.id for known in self.notes}
        if not written.texts:
            raise InputError("There are no notes to save.")
        for frames, text, replaces in written.texts:
            self._check_frames((*frames[:1], *frames[-1:]))
            if not frames or (isinstance(written, WriteNote) and tuple(frames) != written.frames):
                raise InputError("A note must be on one frame or on consecutive frames.")
            if replaces is not None and replaces not in there:
                raise InputError("This note no longer exists: someone has changed or deleted it.")
            if replaces is None and not text:
                raise InputError("The note is empty. Type what it says first.")
            if len(text) > NOTE_CHARACTERS:
                raise InputError(f"The note has {len(text):,} characters; expected {NOTE_CHARACTERS:,} at most.")
            there.discard(replaces)

    def add(self, entry: LogEntry) -> None:
        """Add the next entry, whose action has passed `check`."""
        changed = self._take_up(entry)
        if isinstance(changed, Remark):
            return
        if isinstance(entry.action, Undo):
            self._take_back()
        else:
            self._make(changed)

    def _take_up(self, entry: LogEntry) -> Said:
        """Update what is done and what can be redone; returns what was done, undone or redone. Keypoints are
        unchanged."""
        if isinstance(entry.action, Undo):
            self.standing.undo(entry.id)
            self._undone.append(self._done.pop())
            said = _said(self._undone[-1])
            self._by_kind[type(said)].pop()
            return said
        if isinstance(entry.action, Redo):
            self.standing.redo(entry.id, entry.action.edit)
            self._done.append(self._undone.pop())
        else:
            self.standing.say(entry.id, entry.action, counts=not isinstance(entry.action, Remark))
            self._undone.clear()
            self._done.append(entry)
        said = _said(self._done[-1])
        self._by_kind[type(said)].append(self._done[-1])
        return said

    def _done_of(self, *kinds: type[Said]) -> list[LogEntry]:
        """Those done of some kinds, in order."""
        return sorted((entry for kind in kinds for entry in self._by_kind[kind]), key=lambda entry: entry.id)

    def _make(self, edit: Edit) -> None:
        before = self._now.at(edit.frames, edit.joints)
        detected = self._detections.at(edit.frames, edit.joints) if isinstance(edit, NewDetections) else None
        self._put(edit)
        self._before.append((edit, before, detected))
        self._bytes += before.nbytes
        while self._bytes > _MEMORY:
            self._bytes -= self._before.popleft()[1].nbytes

    def _put(self, edit: Edit) -> None:
        self._write(edit, edit.values(self._now, self._detections))
        if isinstance(edit, NewDetections):
            self._detections.put(edit.frames, edit.joints, edit.values(self._detections, self._detections))

    def _write(self, edit: Edit, values: Corrected) -> None:
        self._now.put(edit.frames, edit.joints, values)
        self._note(edit.frames)

    def _note(self, frames: Iterable[int]) -> None:
        """Record that frames have changed."""
        for those in (self._changed, self._touched, self._unmarked):
            those.update(frames)

    def _make_all(self) -> None:
        """Apply everything done to the detections."""
        self._detections, self._now = Corrected.none(self._original), Corrected.none(self._original)
        self._note(tuple(self._touched))
        edits = [said for entry in self._done if not isinstance(said := _said(entry), Remark)]
        for edit in edits[:-_UNDOABLE]:
            self._put(edit)
        for edit in edits[-_UNDOABLE:]:
            self._make(edit)

    def _take_back(self) -> None:
        if self._before:
            edit, values, detected = self._before.pop()
            self._bytes -= values.nbytes
            self._write(edit, values)
            if detected is not None:
                self._detections.put(edit.frames, edit.joints, detected)
            return
        self._make_all()


def _said(entry: LogEntry) -> Said:
    assert not isinstance(entry.action, Undo | Redo)
    return entry.action
