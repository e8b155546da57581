"""The log of edits and remarks, and what it makes of the detections.

Entries are only ever added. Besides edits and remarks (marks and notes) there are Undo and Redo, which say which of
them they take back or bring back:

- An edit or a remark is done; whatever was undone before it can no longer be redone.
- Undo takes back the last one that is done. Redo brings back the one that was undone last.
- The keypoints are the detections with all edits that are done, in order. What is taken over from another person,
  or was found by a second look, counts as detected from then on.
- A frame has the last mark that is done. There are the notes that are done, but for those that others replace.

The log belongs to the project and not to a browser: two people at one project undo each other's edits.
"""

import itertools
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Literal, get_args

import msgspec

from fitting_core.errors import InputError
from fitting_core.keypoints import Keypoints
from tcfit_app.project.edits.corrected import Corrected, read_only
from tcfit_app.project.edits.kinds import Edit, NewDetections, TakeOver, check, clip_has
from tcfit_app.project.edits.standing import Standing

_MEMORY = 256 * 2**20
"""Bytes for what undo puts back; where that does not suffice, all edits are made again."""
_UNDOABLE = 1000
"""Edits of those made before that undo can take back without making all again: of more, a long log would feel each."""


MarkState = Literal["checked", "flag"]
"""Looks fine; or needs attention."""


class MarkFrames(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="mark"):
    """Whether frames look fine."""

    frames: tuple[int, ...]
    """Counted from the clip's first (0)."""
    state: MarkState | None
    """None: nothing any more."""
    moment: int
    """The largest `Run.moment` then, 0 without any."""


NOTE_CHARACTERS = 2000


class WriteNote(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="note"):
    """A note on frames, another text of one, or its end."""

    frames: tuple[int, ...]
    """Counted from the clip's first (0), one after the other."""
    text: str
    """What it says; empty: there is none any more."""
    replaces: int | None = None
    """The `Note.id` of the one that gets this text."""


class NoteText(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One of several notes that are written together."""

    first: int
    """The first of its frames, counted from the clip's first (0)."""
    last: int
    text: str
    replaces: int | None = None
    """As of WriteNote."""


class WriteNotes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="notes"):
    """Notes that came together, as from a file: one undo takes all of them back."""

    notes: tuple[NoteText, ...]

    @property
    def frames(self) -> tuple[int, ...]:
        """All that they are on."""
        return tuple(sorted({frame for note in self.notes for frame in range(note.first, note.last + 1)}))


class Undo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="undo"):
    """Takes back an edit or a remark."""

    edit: int
    """Its id."""


class Redo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="redo"):
    """Brings back an edit or a remark."""

    edit: int
    """Its id."""


Remark = MarkFrames | WriteNote | WriteNotes
"""What is said about frames; the keypoints stay."""
Said = Edit | Remark
"""What can be undone."""
Action = Said | Undo | Redo
_DECODER = msgspec.json.Decoder(Action)


@dataclass(frozen=True, kw_only=True)
class LogEntry:
    """One line of the log."""

    id: int
    """Ascending from 1."""
    time: datetime
    author: str
    """Who did it, as the app tells browsers apart."""
    action: Action


@dataclass(frozen=True, kw_only=True)
class Note:
    """What somebody has written about frames."""

    id: int
    """By the log's entry that said it first (`note_id`): it stays the same with other texts."""
    frames: range
    text: str
    time: datetime
    author: str


def frames_of(log: Iterable[LogEntry], said: Callable[[int], Said]) -> dict[int, tuple[int, ...]]:
    """The frames whose keypoints each entry changes, by its id: Undo and Redo those of their edit, remarks none.

    Args:
        log: entries, all or some.
        said: What the entry of an id has said, for those that are undone and redone.
    """
    found: dict[int, tuple[int, ...]] = {}
    for entry in log:
        action = said(entry.action.edit) if isinstance(entry.action, Undo | Redo) else entry.action
        found[entry.id] = () if isinstance(action, Remark) else action.frames
    return found


def encode(action: Action) -> str:
    """The action as JSON."""
    return msgspec.json.encode(action).decode()


def decode(text: str | bytes) -> Action:
    """Read what `encode` wrote.

    Raises:
        InputError: It is no known action, or has other fields than it should.
    """
    try:
        return _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(
            f"An edit cannot be read ({error}): it was damaged, or made by another version of tcfit. Update tcfit."
        ) from error


Marking = Literal["told", "bad", "key"]
"""What `Corrected` says of a keypoint, and a timeline of its frame."""


@dataclass(frozen=True, kw_only=True)
class News:
    """How keypoints have changed."""

    before: Keypoints
    frames: list[int]
    """That are others."""
    rows: Corrected
    """Those frames."""
    version: int
    """Of the history, by the number of its changes."""

    def keypoints(self) -> Keypoints:
        """As they are now."""
        return self.rows.put_into(self.before, self.frames) if self.frames else self.before


class EditHistory:
    """The log's meaning: the corrected keypoints, and what can be undone and redone.

    A further entry costs as much as the frames that it touches, whatever the lengths of the clip and of the log. Not
    thread-safe. Keypoints that it has returned never change; `corrected` and `detected` show what they are now.
    """

    def __init__(
        self,
        detections: Keypoints,
        entries: Iterable[LogEntry] = (),
        *,
        first_frame: int = 0,
        leave_out: Callable[[LogEntry, InputError], None] | None = None,
    ) -> None:
        """Take up a log.

        Args:
            detections: What the edits correct.
            entries: In order.
            first_frame: The number by which users know the clip's first.
            leave_out: Takes those that make no sense, and why.

        Raises:
            InputError: One makes no sense, and there is nobody to take it.
        """
        self._original, self._first_frame = detections, first_frame
        self._detections = self._now = Corrected.none(detections)
        self._done: list[LogEntry] = []
        self._undone: list[LogEntry] = []
        self._written: list[LogEntry] = []
        """Those of _done about notes."""
        self.standing: Standing[Said] = Standing()
        """What stood after each entry."""
        self._before: deque[tuple[Edit, Corrected, Corrected | None]] = deque()
        """What the last edits of _done have overwritten, of as many as memory allows; also of the detections."""
        self._bytes = 0
        self._keypoints = replace(detections, xy=read_only(detections.xy), confidence=read_only(detections.confidence))
        """What there was to fit, before the frames `_changed` did."""
        self._changed: set[int] = set()
        self._version = 0
        self._touched: set[int] = set()
        """All frames that any edit has ever changed."""
        self._marked: dict[Marking, set[int]] = {marking: set() for marking in get_args(Marking)}
        """The frames with any keypoint of which that is so, but for those that are `_unmarked`."""
        self._unmarked: set[int] = set()
        for entry in tuple(entries):  # what was undone in the end need not be made
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
        """The edit or remark that undo would take back."""
        return self._done[-1] if self._done else None

    @property
    def redoable(self) -> LogEntry | None:
        """The edit or remark that redo would bring back."""
        return self._undone[-1] if self._undone else None

    @property
    def marks(self) -> list[LogEntry]:
        """The marks that are done, in order."""
        return [entry for entry in self._done if isinstance(entry.action, MarkFrames)]

    @property
    def notes(self) -> tuple[Note, ...]:
        """The notes that there are, by their frames."""
        found: dict[int, Note] = {}
        for entry in self._written:
            for place, (frames, text, replaces) in enumerate(_texts(entry.action)):
                number = note_id(entry.id, place) if replaces is None else replaces
                found.pop(number, None)
                if text:
                    found[number] = Note(id=number, frames=frames, text=text, time=entry.time, author=entry.author)
        return tuple(sorted(found.values(), key=lambda note: (note.frames.start, note.id)))

    @property
    def exchanges(self) -> list[LogEntry]:
        """What is taken over from others, in order."""
        return [entry for entry in self._done if isinstance(entry.action, TakeOver)]

    @property
    def detected(self) -> Corrected:
        """What is corrected: the detections, and what was taken over or detected again in their place."""
        return self._detections.view

    @property
    def corrected(self) -> Corrected:
        """The whole clip as it stands, with marks of what was edited."""
        return self._now.view

    def marked(self, marking: Marking) -> list[int]:
        """The frames with any keypoint of which that is so, in order."""
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
        news = self.news()
        return self.keep(news, news.keypoints())

    def news(self) -> "News":
        """What makes `keypoints`, which takes longer in a long clip: for somebody who cannot wait for that."""
        frames = sorted(self._changed)
        rows = Corrected(records=self._now.records[frames])
        return News(before=self._keypoints, frames=frames, rows=rows, version=self._version)

    def keep(self, news: "News", made: Keypoints) -> Keypoints:
        """Remember what `news` has made, so that further news are those since then."""
        if news.before is self._keypoints:
            self._keypoints = made
            if news.version == self._version:
                self._changed.clear()
        return made

    def check(self, action: Action) -> None:
        """Raise InputError if this cannot be the next action."""
        if isinstance(action, WriteNotes):
            return self._check_notes(action)
        if isinstance(action, Remark):
            self._check_frames(action.frames)
            return self._check_note(action) if isinstance(action, WriteNote) else None
        if not isinstance(action, Undo | Redo):
            return check(action, len(self._now.xy), self._first_frame)
        verb, expected = ("undone", self.undoable) if isinstance(action, Undo) else ("redone", self.redoable)
        if expected is None or expected.id != action.edit:
            now = f"edit {expected.id} is" if expected else "none is"
            raise InputError(f"Edit {action.edit} cannot be {verb} now; {now} next. Somebody else may have edited.")

    def _check_frames(self, frames: tuple[int, ...]) -> None:
        length, first = len(self._now.xy), self._first_frame
        if outside := [frame for frame in frames if not 0 <= frame < length]:
            raise InputError(f"There is no frame {first + outside[0]}; {clip_has(length, first)}.")

    def _check_note(self, note: WriteNote) -> None:
        self._check_text(note.text, note.replaces, {known.id for known in self.notes})
        if not note.frames or tuple(range(note.frames[0], note.frames[-1] + 1)) != note.frames:
            raise InputError("A note is on one frame, or on several that follow each other.")

    def _check_notes(self, written: WriteNotes) -> None:
        if not written.notes:
            raise InputError("There are no notes to keep.")
        there = {known.id for known in self.notes}
        for note in written.notes:
            self._check_frames((note.first, note.last))
            self._check_text(note.text, note.replaces, there)
            there.discard(note.replaces)
            if note.last < note.first:
                raise InputError("A note is on one frame, or on several that follow each other.")

    @staticmethod
    def _check_text(text: str, replaces: int | None, there: set[int]) -> None:
        if replaces is not None and replaces not in there:
            raise InputError("This note is gone: somebody has changed or deleted it.")
        if replaces is None and not text:
            raise InputError("The note is empty. Type what it says first.")
        if len(text) > NOTE_CHARACTERS:
            raise InputError(f"The note has {len(text):,} characters; expected {NOTE_CHARACTERS:,} at most.")

    def add(self, entry: LogEntry) -> None:
        """Take up the next entry, whose action has passed `check`."""
        changed = self._take_up(entry)
        if isinstance(changed, Remark):
            return
        if isinstance(entry.action, Undo):
            self._take_back()
        else:
            self._make(changed)

    def _take_up(self, entry: LogEntry) -> Said:
        """What is done now, and what can be redone; returns what was done, undone or redone. Keypoints stay."""
        if isinstance(entry.action, Undo):
            self.standing.undo(entry.id)
            self._undone.append(self._done.pop())
            said = _said(self._undone[-1])
            if isinstance(said, WriteNote | WriteNotes):
                self._written.pop()
            return said
        if isinstance(entry.action, Redo):
            self.standing.redo(entry.id, entry.action.edit)
            self._done.append(self._undone.pop())
        else:
            self.standing.say(entry.id, entry.action, counts=not isinstance(entry.action, Remark))
            self._undone.clear()
            self._done.append(entry)
        said = _said(self._done[-1])
        if isinstance(said, WriteNote | WriteNotes):
            self._written.append(self._done[-1])
        return said

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
        """Frames are others than they were."""
        self._version += 1
        for those in (self._changed, self._touched, self._unmarked):
            those.update(frames)

    def _make_all(self) -> None:
        """Everything that is done, on the keypoints as they were detected."""
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


def note_id(entry: int, place: int) -> int:
    """The id of a note: that of its entry in the log, and for those after the first the place in it as well."""
    return entry + (place << 32)


def _texts(action: Action) -> list[tuple[range, str, int | None]]:
    """The frames and text of each note, and which one it replaces."""
    if isinstance(action, WriteNote):
        return [(range(action.frames[0], action.frames[-1] + 1), action.text, action.replaces)]
    assert isinstance(action, WriteNotes)
    return [(range(note.first, note.last + 1), note.text, note.replaces) for note in action.notes]


def _said(entry: LogEntry) -> Said:
    assert not isinstance(entry.action, Undo | Redo)
    return entry.action
