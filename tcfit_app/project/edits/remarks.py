"""Remarks in the log: statements about frames, which change no keypoints."""

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

import msgspec

from tcfit_app.project.edits.base import Action

MarkState = Literal["checked", "flag"]
"""Looks fine; or needs attention."""


class MarkFrames(Action, frozen=True, omit_defaults=True, tag="mark"):
    """Marks frames, or limbs in frames, as fine or as needing attention."""

    frames: tuple[int, ...]
    """From the clip's first (0)."""
    state: MarkState | None
    """None removes the mark."""
    moment: int
    """The largest `Run.moment` at the time, 0 without any."""
    limbs: tuple[tuple[str, ...], ...] = ()
    """For each frame the limbs that alone it is about; empty: the frames as a whole."""


NOTE_CHARACTERS = 2000


class WriteNote(Action, frozen=True, tag="note"):
    """Writes a note on frames, changes its text, or deletes it."""

    frames: tuple[int, ...]
    """Consecutive, from the clip's first (0)."""
    text: str
    """Its text; empty deletes it."""
    replaces: int | None = None
    """The `Note.id` of the note it replaces."""

    @property
    def texts(self) -> list[tuple[range, str, int | None]]:
        """The frames and text of each note, and the note it replaces."""
        frames = range(self.frames[0], self.frames[-1] + 1) if self.frames else range(0)
        return [(frames, self.text, self.replaces)]


class NoteText(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One of several notes written together."""

    first: int
    """The first of its frames, from the clip's first (0)."""
    last: int
    text: str
    replaces: int | None = None
    """As in WriteNote."""


class WriteNotes(Action, frozen=True, tag="notes"):
    """Notes added together, as from a file: one undo removes all."""

    notes: tuple[NoteText, ...]

    @property
    def frames(self) -> tuple[int, ...]:
        """All their frames."""
        return tuple(sorted({frame for frames, _, _ in self.texts for frame in frames}))

    @property
    def texts(self) -> list[tuple[range, str, int | None]]:
        """As in WriteNote."""
        return [(range(note.first, note.last + 1), note.text, note.replaces) for note in self.notes]


Remark = MarkFrames | WriteNote | WriteNotes


@dataclass(frozen=True, kw_only=True)
class Note:
    """A note on frames."""

    id: int
    """Derived from the log entry that first wrote it (`note_id`): unchanged when the text changes."""
    frames: range
    text: str
    time: datetime
    author: str


def note_id(entry: int, place: int) -> int:
    """The id of a note: its log entry's, combined with the index in the entry for all but the first."""
    return entry + (place << 32)
