"""What a reviewer has said about frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal, get_args

import msgspec

from fitting_core.errors import InputError
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.runs import LAST_MOMENT

MarkState = Literal["checked", "flag"]
"""Looks fine; or needs attention."""
_ORDER = f"SELECT (SELECT coalesce(max(id), 0) FROM edits), {LAST_MOMENT}"


@dataclass(frozen=True, kw_only=True)
class Mark:
    """One frame's mark."""

    state: MarkState
    time: datetime
    author: str
    last_edit: int
    """Id of the last entry that the log of edits had then, 0 without any."""
    last_moment: int
    """The largest `Run.moment` then, 0 without any."""


class Marks:
    """At most one mark for each frame of a clip, frames counted from its first. Thread-safe."""

    def __init__(self, database: Database, length: int) -> None:
        self._database, self._length = database, length

    def set(self, frames: Iterable[int], state: MarkState, *, author: str = "") -> None:
        """Mark frames, over what they were marked with before.

        Raises:
            InputError: A frame lies outside the clip, or the project cannot be written.
        """
        assert state in get_args(MarkState)
        now = datetime.now(UTC).isoformat()
        chosen = self._inside(frames)
        with self._database.transaction() as connection:
            order = connection.execute(_ORDER).fetchone()
            # The empty text is the column `reason`, which nothing reads.
            rows = [(frame, state, "", now, author, *order) for frame in chosen]
            connection.executemany("INSERT OR REPLACE INTO marks VALUES (?, ?, ?, ?, ?, ?, ?)", rows)

    def clear(self, frames: Iterable[int]) -> None:
        """Take the marks of frames away. Raises InputError as `set` does."""
        rows = [(frame,) for frame in self._inside(frames)]
        with self._database.transaction() as connection:
            connection.executemany("DELETE FROM marks WHERE frame = ?", rows)

    def all(self) -> dict[int, Mark]:
        """Every mark by its frame, in order."""
        found = {}
        for row in self._database.rows("SELECT * FROM marks ORDER BY frame"):
            try:
                time = datetime.fromisoformat(row["time"])
                state = msgspec.convert(row["state"], MarkState)
                last_edit, last_moment = int(row["last_edit"]), int(row["last_moment"])
            except (ValueError, TypeError) as error:
                problem = f"the mark of frame {row['frame']} cannot be read ({error}); it is damaged."
                raise InputError(f"{self._database.path}: {problem}") from error
            found[row["frame"]] = Mark(
                state=state,
                time=time,
                author=row["author"],
                last_edit=last_edit,
                last_moment=last_moment,
            )
        return found

    def _inside(self, frames: Iterable[int]) -> list[int]:
        chosen = list(frames)
        if outside := [frame for frame in chosen if not 0 <= frame < self._length]:
            raise InputError(f"There is no frame {outside[0]}; the clip has frames 0 to {self._length - 1}.")
        return chosen
