"""The fits of a project: a row each in its database, and what they found in runs/<id>.npz. Here is all that knows so.

A row is made before its file, so a file always has a row. While a run goes on, its file may hold the phases that have
finished; when its process dies, the run becomes "interrupted" the next time the project is opened, and keeps them.
"""

import sqlite3
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import msgspec

from fitting_core.config.schema import FitConfig
from fitting_core.config.toml import as_plain
from fitting_core.errors import InputError
from fitting_core.fit.result import FitResult
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.durable import accessing, sweep, sync
from tcfit_app.project.storage.names import checked_name
from tcfit_app.project.storage.run_files import read_run, write_run

ENTRY = r"runs/\d{6,}\.npz"
"""What the paths of results in a project's folder look like, as a regular expression."""
_FOLDER = "runs"
_ORPHANS = "orphans"
"""In _FOLDER: files without a row, as an older copy of the database would leave them. They are never deleted."""

LAST_MOMENT = "(SELECT coalesce(max(moment), 0) FROM runs)"
"""The largest `Run.moment`, 0 without any, in SQL."""
_NEXT = f"1 + max({LAST_MOMENT}, (SELECT coalesce(max(last_moment), 0) FROM marks))"
"""The next `Run.moment`; marks remember those of runs that have been purged."""

Ended = Literal["cancelled", "failed"]
RunState = Literal["running", "finished", "interrupted"] | Ended
RunKind = Literal["fit", "frames", "shape", "corrections", "imported"]
"""Everything; some frames again; the shape again; a run that grows with each keypoint that is dragged; a result of
another program, only to compare with."""


class BodyRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body model of a run: which one is needed to show it."""

    kind: str
    gender: str
    hash: str
    source: str = ""
    """The file's path, or empty."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """A fit, without what it found."""

    id: int
    name: str
    kind: RunKind
    state: RunState
    config: FitConfig
    body: BodyRecord
    parent: int | None
    """The run from which this one started."""
    frames: range | None
    """The frames that were fitted again, counted from the clip's first; None: all."""
    edits_seen: int
    """Id of the last log entry that had been made when it started; 0: none."""
    started: datetime
    ended: datetime | None
    moment: int
    """Ascending over all beginnings and ends of the project's runs: its own end, or its beginning until then."""
    summary: dict[str, Any]
    """Figures for lists and comparisons."""
    message: str
    """Why it failed."""
    deleted: bool
    """Can be brought back until `purge`."""
    stored: bool
    """Whether there is a file with at least one phase."""


class Runs:
    """All runs of a project. Thread-safe."""

    def __init__(self, folder: Path, database: Database) -> None:
        self._folder, self._database = folder / _FOLDER, database

    def recover(self) -> None:
        """Tidy up after a process that died. Only for the one who holds the project's lock.

        Raises:
            InputError: The project cannot be written.
        """
        with self._database.transaction() as connection:
            connection.execute(
                f"UPDATE runs SET state = 'interrupted', ended = ?, moment = {_NEXT} WHERE state = 'running'",
                (_now().isoformat(),),
            )
        known = {self._path(row["id"]).name for row in self._database.rows("SELECT id FROM runs")}
        with accessing(self._folder):
            self._folder.mkdir(exist_ok=True)
            sweep(self._folder)
            for file in [f for f in self._folder.iterdir() if f.is_file() and f.name not in known]:
                orphans = self._folder / _ORPHANS
                orphans.mkdir(exist_ok=True)
                file.rename(orphans / f"{time.time_ns()}-{file.name}")

    def start(
        self,
        config: FitConfig,
        *,
        body: BodyRecord,
        edits_seen: int,
        kind: RunKind = "fit",
        parent: int | None = None,
        frames: range | None = None,
        name: str = "",
    ) -> Run:
        """Note that a fit begins.

        Args:
            config: All of its settings.
            body: With which body.
            edits_seen: `Project.last_edit` when its keypoints were taken.
            kind: What is fitted.
            parent: The run from which it starts.
            frames: Which frames are fitted again; None for all.
            name: By default its number.

        Raises:
            InputError: The name cannot be used, the parent does not exist, or the project cannot be written.
        """
        if parent is not None:
            self.get(parent)
        with self._database.transaction() as connection:
            cursor = connection.execute(
                "INSERT INTO runs (name, kind, state, config, body, parent, first_frame, last_frame, edits_seen,"
                f" started, moment) VALUES (?, ?, 'running', ?, ?, ?, ?, ?, ?, ?, {_NEXT})",
                (
                    checked_name(name) if name else "",
                    kind,
                    msgspec.json.encode(as_plain(config)).decode(),
                    msgspec.json.encode(body).decode(),
                    parent,
                    frames.start if frames else None,
                    frames.stop - 1 if frames else None,
                    edits_seen,
                    _now().isoformat(),
                ),
            )
            number = cursor.lastrowid
            assert number is not None
            if not name:
                connection.execute("UPDATE runs SET name = ? WHERE id = ?", (f"Run {number}", number))
        return self.get(number)

    def store(self, run: int, fit: FitResult) -> None:
        """Keep the phases that a run has finished so far.

        Raises:
            InputError: It is not running, or the project cannot be written.
        """
        self._expect(run, "running")
        write_run(self._path(run), fit)

    def finish(
        self, run: int, fit: FitResult, *, summary: dict[str, Any] | None = None, state: RunState = "running"
    ) -> Run:
        """Keep a run's result; when this returns, it is on the disk.

        Args:
            run: Its number.
            fit: The result.
            summary: Figures for lists; None: seconds and costs.
            state: What it must be in: "running", or "failed" because the result could not be written before.

        Raises:
            InputError: It is in another state, or the project cannot be written; then it stays as it was.
        """
        self._expect(run, state)
        write_run(self._path(run), fit)
        self._end(run, "finished", "", _summary(fit, summary))
        return self.get(run)

    def amend(self, run: int, fit: FitResult, *, edits_seen: int) -> Run:
        """Keep what a finished run of corrections has become; when this returns, it is on the disk.

        Raises:
            InputError: It is no finished run of corrections, or the project cannot be written.
        """
        found = self.get(run)
        if found.kind != "corrections" or found.state != "finished":
            raise InputError(f"{found.name} is no finished run of corrections; it stays as it is.")
        write_run(self._path(run), fit)
        with self._database.transaction() as connection:
            connection.execute(
                f"UPDATE runs SET edits_seen = ?, summary = ?, ended = ?, moment = {_NEXT} WHERE id = ?",
                (edits_seen, _summary(fit, None), _now().isoformat(), run),
            )
        return self.get(run)

    def end(self, run: int, state: Ended, message: str = "") -> Run:
        """Note that a run was cancelled or failed, and why; phases that were stored stay.

        Raises:
            InputError: It is not running, or the project cannot be written.
        """
        self._expect(run, "running")
        # A message may hold a path that is no text.
        self._end(run, state, message.encode(errors="replace").decode(), None)
        return self.get(run)

    def _end(self, run: int, state: RunState, message: str, summary: str | None) -> None:
        with self._database.transaction() as connection:
            connection.execute(
                f"UPDATE runs SET state = ?, message = ?, summary = ?, ended = ?, moment = {_NEXT} WHERE id = ?",
                (state, message, summary, _now().isoformat(), run),
            )

    def rename(self, run: int, name: str) -> None:
        """Give a run another name; it is no file's name, and several runs may share it.

        Raises:
            InputError: The name cannot be used, there is no such run, or the project cannot be written.
        """
        self.get(run)
        with self._database.transaction() as connection:
            connection.execute("UPDATE runs SET name = ? WHERE id = ?", (checked_name(name), run))

    def delete(self, run: int) -> None:
        """Take a run out of the list; `undelete` brings it back, until `purge`.

        Raises:
            InputError: It is running, there is no such run, or the project cannot be written.
        """
        if (found := self.get(run)).state == "running":
            raise InputError(f"{found.name} is running; cancel it first.")
        self._set_deleted(run, _now().isoformat())

    def undelete(self, run: int) -> None:
        """Bring a deleted run back. Raises InputError if there is none, or the project cannot be written."""
        self.get(run)
        self._set_deleted(run, None)

    def _set_deleted(self, run: int, when: str | None) -> None:
        with self._database.transaction() as connection:
            connection.execute("UPDATE runs SET deleted = ? WHERE id = ?", (when, run))

    def purge(self) -> list[int]:
        """Remove all deleted runs for good; their numbers, which no later run gets.

        Raises:
            InputError: The project cannot be written.
        """
        gone = [run.id for run in self.all(deleted=True)]
        with self._database.transaction() as connection, accessing(self._folder):
            # Files first: a row without a file only tells that there is nothing to show.
            for run in gone:
                self._path(run).unlink(missing_ok=True)
            sync(self._folder)
            connection.executemany("DELETE FROM runs WHERE id = ?", [(run,) for run in gone])
        return gone

    def all(self, *, deleted: bool = False) -> list[Run]:
        """All runs, oldest first; or all deleted ones."""
        state = "NOT NULL" if deleted else "NULL"
        return [
            self._run(row) for row in self._database.rows(f"SELECT * FROM runs WHERE deleted IS {state} ORDER BY id")
        ]

    def get(self, run: int) -> Run:
        """A run by its number, deleted or not. Raises InputError if there is none."""
        rows = self._database.rows("SELECT * FROM runs WHERE id = ?", run)
        if not rows:
            raise InputError(f"There is no run {run}; it may have been deleted. Choose one that is listed.")
        return self._run(rows[0])

    def load(self, run: int) -> FitResult:
        """What a run has found, with all phases that it finished.

        Raises:
            InputError: There is no such run, or it has no result.
        """
        return read_run(self._path(run), self.get(run).config)

    def _expect(self, run: int, state: RunState) -> None:
        found = self.get(run)
        if found.state != state:
            raise InputError(f"{found.name} is {found.state}; expected one that is {state}.")

    def _path(self, run: int) -> Path:
        return self._folder / _file_name(run)

    def _run(self, row: sqlite3.Row) -> Run:
        try:
            return Run(
                id=row["id"],
                name=row["name"],
                kind=msgspec.convert(row["kind"], RunKind),
                state=msgspec.convert(row["state"], RunState),
                # Settings that this version no longer has are left out: the run can still be shown.
                config=msgspec.json.decode(row["config"], type=FitConfig),
                body=msgspec.json.decode(row["body"], type=BodyRecord),
                parent=row["parent"],
                frames=None if row["first_frame"] is None else range(row["first_frame"], row["last_frame"] + 1),
                edits_seen=row["edits_seen"],
                started=datetime.fromisoformat(row["started"]),
                ended=None if row["ended"] is None else datetime.fromisoformat(row["ended"]),
                moment=int(row["moment"]),
                summary={} if row["summary"] is None else msgspec.json.decode(row["summary"], type=dict[str, Any]),
                message=row["message"],
                deleted=row["deleted"] is not None,
                stored=self._path(row["id"]).is_file(),
            )
        except (ValueError, TypeError) as error:  # msgspec's errors are ValueErrors
            raise InputError(
                f"{self._database.path}: run {row['id']} cannot be read ({error}); it is damaged."
            ) from error


def newest(runs: Sequence[Run]) -> Run:
    """The one that counts where nobody chose: what was imported is to be compared with, and no fit of ours."""
    own = [run for run in runs if run.kind != "imported"]
    return (own or runs)[-1]


def named(runs: Sequence[Run], name: str) -> Run:
    """The run that a user calls by its name, or by its number ("3" or "#3").

    Raises:
        InputError: There is none, or there are several of this name.
    """
    found = [run for run in runs if name == run.name] or [run for run in runs if name.lstrip("#") == str(run.id)]
    if len(found) == 1:
        return found[0]
    known = ", ".join(f"{run.name!r} (#{run.id})" for run in runs) or "none"
    several = "several runs have this name; give the number of one" if found else "there is no such run"
    raise InputError(f"Run {name!r}: {several}. Those with a result: {known}.")


def entries(folder: Path, connection: sqlite3.Connection) -> list[str]:
    """The results that lie in a project's folder, of the runs that a copy of its database knows, as paths in it."""
    numbers = [number for (number,) in connection.execute("SELECT id FROM runs ORDER BY id")]
    names = [f"{_FOLDER}/{_file_name(number)}" for number in numbers]
    return [name for name in names if (folder / name).is_file()]


def newest_body(database: Database) -> str:
    """Where the body model of the run that began last was read; empty if nothing is known of that."""
    rows = database.rows("SELECT body FROM runs WHERE deleted IS NULL ORDER BY id DESC LIMIT 1")
    try:
        return msgspec.json.decode(rows[0]["body"], type=BodyRecord).source if rows else ""
    except msgspec.DecodeError:
        return ""


def _file_name(run: int) -> str:
    return f"{int(run):06d}.npz"


def _now() -> datetime:
    return datetime.now(UTC)


def _summary(fit: FitResult, given: dict[str, Any] | None) -> str:
    figures = given or {
        "seconds": {f"phase{p.phase}": p.seconds for p in fit.phases},
        "objective": {f"phase{p.phase}": p.objective for p in fit.phases},
    }
    return msgspec.json.encode(figures).decode()
