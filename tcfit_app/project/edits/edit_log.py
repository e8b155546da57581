"""The log of edits, and what it makes of the detections.

Entries are only ever added. Besides edits there are Undo and Redo, which say which edit they take back or bring back:

- An edit is done; whatever was undone before it can no longer be redone.
- Undo takes back the last edit that is done. Redo brings back the edit that was undone last.
- The keypoints are the detections with all edits that are done, in order.

The log belongs to the project and not to a browser: two people at one project undo each other's edits.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime

import msgspec

from fitting_core.errors import InputError
from fitting_core.keypoints import Keypoints
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.kinds import Edit, check

_MEMORY = 256 * 2**20
"""Bytes for what undo puts back; where that does not suffice, all edits are made again."""


class Undo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="undo"):
    """Takes back an edit."""

    edit: int
    """Its id."""


class Redo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="redo"):
    """Brings back an edit."""

    edit: int
    """Its id."""


Action = Edit | Undo | Redo
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


def frames_of(log: Iterable[LogEntry]) -> dict[int, tuple[int, ...]]:
    """The frames that each entry changes, by its id: Undo and Redo those of their edit."""
    found: dict[int, tuple[int, ...]] = {}
    for entry in log:
        action = entry.action
        found[entry.id] = found.get(action.edit, ()) if isinstance(action, Undo | Redo) else action.frames
    return found


def edits_since(log: Iterable[LogEntry], seen: int) -> list[Edit]:
    """The edits that stand now and did not after the entry `seen`, and those that did and do not now."""
    entries = list(log)
    now, then = _standing(entries), _standing([entry for entry in entries if entry.id <= seen])
    return [edit for number, edit in (now | then).items() if (number in now) != (number in then)]


def _standing(entries: Iterable[LogEntry]) -> dict[int, Edit]:
    done: dict[int, Edit] = {}
    undone: dict[int, Edit] = {}
    for entry in entries:
        action = entry.action
        if isinstance(action, Undo):
            undone[action.edit] = done.pop(action.edit)
        elif isinstance(action, Redo):
            done[action.edit] = undone.pop(action.edit)
        else:
            done[entry.id] = action
    return done


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


class EditHistory:
    """The log's meaning: the corrected keypoints, and what can be undone and redone.

    A further entry costs as much as the keypoints that it touches, whatever the lengths of the clip and of the log.
    Not thread-safe; what it returns never changes.
    """

    def __init__(self, detections: Keypoints, entries: Iterable[LogEntry] = ()) -> None:
        """Raises InputError if the entries make no sense for these detections."""
        self._detections = Corrected.none(detections)
        self._now = Corrected.none(detections)
        self._done: list[LogEntry] = []
        self._undone: list[LogEntry] = []
        self._before: deque[tuple[Edit, Corrected]] = deque()
        """What the last entries of _done have overwritten, of as many as memory allows."""
        self._bytes = 0
        self._published: Corrected | None = None
        self._keypoints: Keypoints | None = None
        for entry in entries:
            self.check(entry.action)
            self.add(entry)

    @property
    def undoable(self) -> LogEntry | None:
        """The edit that undo would take back."""
        return self._done[-1] if self._done else None

    @property
    def redoable(self) -> LogEntry | None:
        """The edit that redo would bring back."""
        return self._undone[-1] if self._undone else None

    @property
    def corrected(self) -> Corrected:
        """The whole clip as it stands, with marks of what was edited."""
        if self._published is None:
            self._published = self._now.frozen()
        return self._published

    @property
    def keypoints(self) -> Keypoints:
        """The keypoints to fit."""
        if self._keypoints is None:
            self._keypoints = self.corrected.keypoints()
        return self._keypoints

    def check(self, action: Action) -> None:
        """Raise InputError if this cannot be the next action."""
        if not isinstance(action, Undo | Redo):
            return check(action, len(self._now.xy))
        verb, expected = ("undone", self.undoable) if isinstance(action, Undo) else ("redone", self.redoable)
        if expected is None or expected.id != action.edit:
            now = f"edit {expected.id} is" if expected else "none is"
            raise InputError(f"Edit {action.edit} cannot be {verb} now; {now} next. Somebody else may have edited.")

    def add(self, entry: LogEntry) -> None:
        """Take up the next entry, whose action has passed `check`."""
        self._published = self._keypoints = None
        if isinstance(entry.action, Undo):
            self._undone.append(self._done.pop())
            self._take_back()
        elif isinstance(entry.action, Redo):
            self._do(self._undone.pop())
        else:
            self._undone.clear()
            self._do(entry)

    def _do(self, entry: LogEntry) -> None:
        self._done.append(entry)
        self._make(_edit(entry))

    def _make(self, edit: Edit) -> None:
        before = self._now.at(edit.frames, edit.joints)
        self._now.put(edit.frames, edit.joints, edit.values(self._now, self._detections))
        self._before.append((edit, before))
        self._bytes += before.nbytes
        while self._bytes > _MEMORY:
            self._bytes -= self._before.popleft()[1].nbytes

    def _take_back(self) -> None:
        if self._before:
            edit, values = self._before.pop()
            self._bytes -= values.nbytes
            self._now.put(edit.frames, edit.joints, values)
            return
        every = range(len(self._now.xy)), range(self._now.xy.shape[1])
        self._now.put(tuple(every[0]), tuple(every[1]), self._detections)
        for entry in self._done:
            self._make(_edit(entry))


def _edit(entry: LogEntry) -> Edit:
    assert not isinstance(entry.action, Undo | Redo)
    return entry.action
