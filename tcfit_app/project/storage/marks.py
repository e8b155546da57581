"""A reviewer's marks on frames."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import get_args

from tcfit_app.project.edits.edit_log import LogEntry, MarkFrames, MarkState
from tcfit_app.project.storage.columns import UNKNOWN_TIME, Columns, Count, of, text, time
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.run_record import LAST_MOMENT

_LEFT_OUT = "the mark is ignored"


@dataclass(frozen=True, kw_only=True)
class Mark:
    """One frame's mark."""

    state: MarkState
    time: datetime
    author: str
    last_edit: int
    """Id of the last log entry at the time, 0 without any."""
    last_moment: int
    """The largest `Run.moment` at the time, 0 without any."""


class MarkStore:
    """At most one mark per frame of a clip, frames counted from its first. Thread-safe.

    They are stored in the log of edits, so that they can be undone. Earlier versions had a table, which is still read.

    Args:
        database: with that table, and the runs.
        frames: number of frames in the clip.
        done: the log entries of marks that are not undone, in order.
        append: adds to the log, on behalf of an author.
    """

    def __init__(
        self,
        database: Database,
        frames: int,
        done: Callable[[], list[LogEntry]],
        append: Callable[[MarkFrames, str], LogEntry],
    ) -> None:
        self._database, self._frames, self._done, self._append = database, frames, done, append

    def set(self, frames: Iterable[int], state: MarkState | None, *, author: str = "") -> LogEntry:
        """Mark frames, replacing their marks; None removes them. Raises InputError if a frame is outside the clip, or
        the project cannot be written."""
        assert state is None or state in get_args(MarkState)
        (row,) = self._database.rows(f"SELECT {LAST_MOMENT}")
        return self._append(MarkFrames(frames=tuple(frames), state=state, moment=row[0]), author)

    def all(self) -> dict[int, Mark]:
        """All marks by frame, in order."""
        found = self._of_the_table()
        for entry in self._done():
            said = entry.action
            assert isinstance(said, MarkFrames)
            for frame in said.frames:
                found.pop(frame, None)
                if said.state is not None:
                    found[frame] = Mark(
                        state=said.state,
                        time=entry.time,
                        author=entry.author,
                        last_edit=entry.id,
                        last_moment=said.moment,
                    )
        return dict(sorted(found.items()))

    def _of_the_table(self) -> dict[int, Mark]:
        found = {}
        for row in self._database.rows("SELECT * FROM marks"):
            mark = Columns(row, f"the mark in row {row['frame']}", self._database.damage)
            frame = mark.read("frame", self._frame, None, _LEFT_OUT)
            state = mark.read("state", of(MarkState), None, _LEFT_OUT)
            if frame is None or state is None:
                continue
            found[frame] = Mark(
                state=state,
                time=mark.read("time", time, UNKNOWN_TIME, "treated as made long ago"),
                author=mark.read("author", text, "", "the author is left empty"),
                last_edit=mark.read("last_edit", of(Count), 0, "treated as made before all edits"),
                last_moment=mark.read("last_moment", of(Count), 0, "treated as made before all runs"),
            )
        return found

    def _frame(self, value: int) -> int:
        if not 0 <= value < self._frames:
            raise ValueError(f"expected one of {self._frames} frames, counted from 0")
        return value
