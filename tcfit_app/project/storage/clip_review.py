"""What reviewers say of a clip as a whole: whether it is approved, and a note; and the worst place of its last fit.
Imports no torch: lists of projects read it too."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import msgspec

from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.columns import Columns, Count, Damage, json_of, of, or_none, text, time
from tcfit_app.project.storage.database import NAME, Database
from tcfit_app.project.storage.lock import ProjectLock
from tcfit_app.project.storage.run_record import LAST_MOMENT

State = Literal["new", "fitted", "in review", "approved"]
NOTE_CHARACTERS = 500
"""Of a note on a clip, at most; it is one line."""
BROWSER = "browser "
"""The start of authors' names in the log without a sign-in; earlier versions used "tab "."""
_REMARKS = ("mark", "note", "notes")
"""Kinds of entries of the log that leave keypoints alone, and so what was approved."""
Rows = Callable[..., list[sqlite3.Row]]
"""What a query finds."""


class Worst(msgspec.Struct, frozen=True, kw_only=True):
    """The worst entry of a run's review queue, and how far the whole run is off."""

    run: int
    left: int
    """Entries of the queue."""
    score: float = 0.0
    """As of `Suspect`; 0 without any entry."""
    frame: int = 0
    """Counted from the clip's first as 0."""
    words: str = ""
    off: dict[str, float] = {}
    """How far body, hands and face are off, as of `glance.off_by_part`; empty: not measured here."""


@dataclass(frozen=True, kw_only=True)
class ClipReview:
    """Everything that is stored."""

    approved: datetime | None = None
    approved_by: str = ""
    altered: bool = False
    """It was approved, and keypoints or fits have changed since."""
    note: str = ""
    author: str | None = None
    """Of the last entry of the log; None without any."""
    worst: Worst | None = None

    def state(self, *, fitted: bool) -> State:
        """How far the clip is; `fitted`: it has a fit."""
        if self.approved is not None and not self.altered:
            return "approved"
        if self.approved is not None or self.author is not None:
            return "in review"
        return "fitted" if fitted else "new"

    @property
    def reviewer(self) -> str:
        """Name of the approver, or else of the last author; empty if unknown."""
        author = self.author or ""
        return self.approved_by if self.approved is not None else "" if author.startswith((BROWSER, "tab ")) else author


def read_clip_review(rows: Rows, damage: Damage) -> ClipReview:
    """What a project's database has. Raises what `rows` raises."""
    found = rows("SELECT * FROM review")
    if not found:
        return ClipReview()
    authors = [row["author"] for row in rows("SELECT author FROM edits ORDER BY id DESC LIMIT 1")]
    said = damage.read(found[0], "the review of the clip", _said)
    if said is None:
        return ClipReview()
    review, *seen = said
    altered = review.approved is not None and _altered(rows, *seen)
    return replace(review, altered=altered, author=str(authors[0]) if authors else None)


def _said(row: Columns) -> tuple[ClipReview, int, int]:
    """What the row of the review has, and the last edit and moment that were approved."""
    review = ClipReview(
        approved=row.read("approved", or_none(time)),
        approved_by=row.read("approved_by", text),
        note=row.read("note", text),
        worst=row.read("worst", or_none(json_of(Worst))),
    )
    return review, row.read("last_edit", of(Count)), row.read("last_moment", of(Count))


class _Kind(msgspec.Struct):
    kind: str
    edit: int = 0
    """What an undo takes back, or a redo brings back."""


def _altered(rows: Rows, last_edit: int, last_moment: int) -> bool:
    """Whether there were edits, or a run began or ended, after what was seen."""
    if rows(f"SELECT {LAST_MOMENT} AS moment")[0]["moment"] > last_moment:
        return True
    for row in rows("SELECT action FROM edits WHERE id > ? ORDER BY id", last_edit):
        said = _kind(row)
        if said is not None and said.kind in ("undo", "redo"):
            meant = rows("SELECT action FROM edits WHERE id = ?", said.edit)
            said = _kind(meant[0]) if meant else None
        if said is not None and said.kind not in _REMARKS:
            return True
    return False


def _kind(row: sqlite3.Row) -> _Kind | None:
    """None for one that cannot be read, which is left out of the log as well."""
    try:
        return msgspec.json.decode(row["action"], type=_Kind)
    except (ValueError, TypeError, RecursionError):
        return None


class ReviewOfClip:
    """That of an open project. Thread-safe; all that changes something raises InputError if it cannot be written.

    Args:
        database: The project's.
        last_edit: Tells the id of the log's last entry.
    """

    def __init__(self, database: Database, last_edit: Callable[[], int]) -> None:
        self._database, self._last_edit = database, last_edit
        self.version = 0
        """Another number whenever something was said."""

    @property
    def now(self) -> ClipReview:
        """As it stands."""
        return read_clip_review(self._database.rows, self._database.damage)

    def approve(self, reviewer: str) -> None:
        """Approve the clip in its present state."""
        edit, moment = self._last_edit(), self._database.rows(f"SELECT {LAST_MOMENT}")[0][0]
        self._set("approved = ?, approved_by = ?, last_edit = ?, last_moment = ?", _now(), reviewer, edit, moment)

    def withdraw(self) -> None:
        """It is not approved any more."""
        self._set("approved = NULL, approved_by = ''")

    def set_note(self, note: str) -> None:
        """Say something of the whole clip, in one line."""
        self._set("note = ?", " ".join(note.split())[:NOTE_CHARACTERS])

    def set_worst(self, worst: Worst) -> None:
        """Keep the worst place of a run."""
        self._set("worst = ?", msgspec.json.encode(worst).decode())

    def _set(self, assignments: str, *values: object) -> None:
        with self._database.transaction() as connection:
            connection.execute(f"UPDATE review SET {assignments}", values)
        self.version += 1


def _now() -> str:
    return datetime.now(UTC).isoformat()


@contextmanager
def reviewed(folder: Path) -> Iterator[ReviewOfClip]:
    """The review of a clip with a closed project, within the `with` block.

    Raises:
        ProjectLocked: Another process has it open.
        InputError: It cannot be read or written.
    """
    with accessing(folder):
        held = ProjectLock(folder)
    try:
        with closing(Database(folder / NAME, read_only=False)) as store:
            yield ReviewOfClip(store, lambda: store.rows("SELECT coalesce(max(id), 0) FROM edits")[0][0])
    finally:
        held.release()
