"""A reviewer's marks on frames."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import get_args

from tcfit_app.project.edits.edit_log import LogEntry
from tcfit_app.project.edits.remarks import MarkFrames, MarkState
from tcfit_app.project.storage.columns import Columns, Count, of, text, time
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.run_record import LAST_MOMENT


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
    """At most one mark per frame of a clip, and per limb in a frame; frames counted from its first. Thread-safe.

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

    def set(
        self,
        frames: Iterable[int],
        state: MarkState | None,
        *,
        limbs: Iterable[tuple[str, ...]] = (),
        author: str = "",
    ) -> LogEntry:
        """Mark frames, replacing their marks; None removes them.

        Args:
            frames: Which.
            state: What is said of them.
            limbs: As in MarkFrames. What is said of limbs is kept beside what is said of their frames.
            author: Who says it.

        Raises:
            InputError: A frame is outside the clip, or the project cannot be written.
        """
        assert state is None or state in get_args(MarkState)
        (row,) = self._database.rows(f"SELECT {LAST_MOMENT}")
        return self._append(MarkFrames(frames=tuple(frames), state=state, moment=row[0], limbs=tuple(limbs)), author)

    def all(self) -> dict[int, Mark]:
        """All marks of whole frames by frame, in order."""
        found = self._of_the_table()
        for said, mark in self._said():
            if said.limbs:
                continue
            for frame in said.frames:
                found.pop(frame, None)
                if mark is not None:
                    found[frame] = mark
        return dict(sorted(found.items()))

    def of_limbs(self) -> dict[str, dict[int, Mark]]:
        """The marks of limbs, by limb and frame. Removing the mark of a whole frame removes them too."""
        found: dict[str, dict[int, Mark]] = {}
        for said, mark in self._said():
            if not said.limbs and mark is None:
                for known in found.values():
                    for frame in said.frames:
                        known.pop(frame, None)
            for frame, limbs in zip(said.frames, said.limbs, strict=bool(said.limbs)):
                for limb in limbs:
                    known = found.setdefault(limb, {})
                    known.pop(frame, None)
                    if mark is not None:
                        known[frame] = mark
        return found

    def states(self) -> dict[int, MarkState]:
        """What is shown of each frame, in order: flagged, or found fine as a whole or in a limb."""
        found: dict[int, MarkState] = {}
        for known in (*self.of_limbs().values(), self.all()):
            found |= {frame: mark.state for frame, mark in known.items()}
        return dict(sorted(found.items()))

    def _said(self) -> Iterator[tuple[MarkFrames, Mark | None]]:
        """Each entry, and the mark that it makes; None if it removes marks."""
        for entry in self._done():
            said = entry.action
            assert isinstance(said, MarkFrames)
            mark = said.state and Mark(
                state=said.state,
                time=entry.time,
                author=entry.author,
                last_edit=entry.id,
                last_moment=said.moment,
            )
            yield said, mark

    def _of_the_table(self) -> dict[int, Mark]:
        rows = self._database.rows("SELECT * FROM marks")
        read = (self._database.damage.read(row, f"the mark in row {row['frame']}", self._of_row) for row in rows)
        return dict(one for one in read if one is not None)

    def _of_row(self, row: Columns) -> tuple[int, Mark]:
        return row.read("frame", self._frame), Mark(
            state=row.read("state", of(MarkState)),
            time=row.read("time", time),
            author=row.read("author", text),
            last_edit=row.read("last_edit", of(Count)),
            last_moment=row.read("last_moment", of(Count)),
        )

    def _frame(self, value: int) -> int:
        if not 0 <= value < self._frames:
            raise ValueError(f"expected one of {self._frames} frames, counted from 0")
        return value
