"""The fits of a project: a row each in its database, and the results in runs/<id>.npz. Only this module knows both.

A row is created before its file or together with it, so every file has a row. Only a run with a job is "running": its
file may hold the phases finished so far, or runs/<id>.partial.npz the frames that phase 1 has fitted so far; if its
process dies, the run becomes "interrupted" the next time the project is opened, and keeps them. A run of corrections
has its changes in a folder beside its file; see `Changes`.
"""

import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from functools import lru_cache
from itertools import count
from pathlib import Path
from time import time_ns
from typing import Annotated, Any

import msgspec

from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.config.toml import as_plain
from fitting_core.errors import InputError
from fitting_core.files.atomic import drafting, sweep, sync
from fitting_core.results.fit_result import FitResult
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.changes import Changes, Log, file_name
from tcfit_app.project.storage.columns import Columns, Count, json_of, line, of, or_none, text, time
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.names import checked_name
from tcfit_app.project.storage.run_files import read_run, write_run
from tcfit_app.project.storage.run_names import with_names
from tcfit_app.project.storage.run_record import LAST_MOMENT, BodyRecord, Ended, Given, Run, RunKind, RunState, largest

_FOLDER = "runs"
_ORPHANS = "orphans"
"""In _FOLDER: files without a row, as after restoring an older database. They are never deleted."""


_SAID = "CASE WHEN typeof(action) = 'text' AND json_valid(action) THEN json_extract(action, '$.moment') END"
_NEXT = f"1 + max({LAST_MOMENT}, {largest(_SAID, 'edits')}, {largest('last_moment', 'marks')})"
"""SQL for the next `Run.moment`; marks still have those of purged runs."""


class Runs:
    """All runs of a project. Thread-safe.

    Args:
        folder: the project's.
        database: the project's.
        frames: number of frames in the clip.
        first_frame: the number that users see for frame 0.
        log: the project's.
    """

    def __init__(self, folder: Path, database: Database, frames: int, first_frame: int, log: Log) -> None:
        self._folder, self._database, self._log = folder / _FOLDER, database, log
        self._frames, self._first_frame = frames, first_frame
        self._changes: dict[int, Changes] = {}
        self._versions = count(1)
        self.version = 0
        """Changes whenever a run is added, changed or removed."""
        self.refusal = ""
        """Why no run can be added now; empty if one can."""

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """A transaction that increments the version."""
        with self._database.transaction() as connection:
            yield connection
        self.version = next(self._versions)

    def _update(self, run: int, *, moment: bool = True, **values: object) -> None:
        """Change a run's row, with new values by column; `moment` says whether its `Run.moment` is a new one."""
        columns = [*(f"{column} = ?" for column in values), *[f"moment = {_NEXT}"] * moment]
        with self._writing() as connection:
            connection.execute(f"UPDATE runs SET {', '.join(columns)} WHERE id = ?", (*values.values(), run))

    def recover(self) -> None:
        """Clean up after a crashed process. Only for the holder of the project's lock. Raises InputError if the project
        cannot be written."""
        with self._database.transaction() as connection:
            connection.execute(
                f"UPDATE runs SET state = 'interrupted', ended = ?, moment = {_NEXT} WHERE state = 'running'",
                (_now(),),
            )
        rows = self._database.rows("SELECT id, kind, deleted FROM runs")
        for row in rows:
            if row["kind"] == "corrections" and row["deleted"] and self.changes(row["id"]).hidden_earlier:
                self._update(row["id"], moment=False, deleted=None)
        known = {path.name for row in rows for path in (self._path(row["id"]), self._partial_path(row["id"]))}
        with accessing(self._folder):
            self._folder.mkdir(exist_ok=True)
            sweep(self._folder)
            for file in [f for f in self._folder.iterdir() if f.is_file() and f.name not in known]:
                orphans = self._folder / _ORPHANS
                orphans.mkdir(exist_ok=True)
                file.rename(orphans / f"{time_ns()}-{file.name}")

    def start(
        self,
        config: FitConfig,
        *,
        body: BodyRecord,
        edits_seen: int,
        kind: RunKind = "fit",
        parent: int | None = None,
        given: Given = Given(),  # noqa: B008 - it is frozen
        frames: range | None = None,
        name: str = "",
        fit: FitResult | None = None,
        summary: dict[str, Any] | None = None,
        change: Callable[[Changes], object] = lambda changes: None,
    ) -> Run:
        """Record a run that starts, or with its result one that has finished; it is on disk when this returns. Raises
        InputError if the name is invalid, the parent does not exist, or the project cannot be written; there is no run
        then.

        Args:
            config: All of its settings.
            body: Its body model.
            edits_seen: `Project.last_edit` when its keypoints were taken.
            kind: What is fitted.
            parent: The run it starts from.
            given: What it is given besides the clip.
            frames: The frames to refit; None for all.
            name: The user's; by default what it is, see `run_names`.
            fit: Its result, if it has finished.
            summary: See `finish`.
            change: Adds the first change, to a run of corrections.
        """
        if parent is not None:
            self.get(parent)
        now = _now()
        row = {
            "name": checked_name(name) if name else "",
            "kind": kind,
            "state": "running" if fit is None else "finished",
            "config": msgspec.json.encode(as_plain(config)).decode(),
            "body": msgspec.json.encode(body).decode(),
            "parent": parent,
            "given": msgspec.json.encode(given).decode() if given != Given() else None,
            "first_frame": frames.start if frames else None,
            "last_frame": frames.stop - 1 if frames else None,
            "edits_seen": edits_seen,
            "started": now,
            "ended": None if fit is None else now,
            "summary": None if fit is None else _summary(fit, summary),
        }
        if fit is None:
            with self._writing() as connection, accessing(self._folder):
                number = self._insert(connection, row)
            return self.get(number)
        number = None
        with accessing(self._folder), drafting(self._folder / "added.npz") as draft:
            write_run(draft, fit)
            try:
                with self._writing() as connection:
                    number = self._insert(connection, row)
                    change(self.changes(number))
                    os.replace(draft, self._path(number))
                    sync(self._folder)
            except BaseException:
                if number is not None:  # the next run will have it
                    self._remove_files(number)
                raise
        return self.get(number)

    def _insert(self, connection: sqlite3.Connection, row: dict[str, Any]) -> int:
        self._check_refusal()
        number = connection.execute(
            f"INSERT INTO runs ({', '.join(row)}, moment) VALUES ({', '.join('?' * len(row))}, {_NEXT})",
            tuple(row.values()),
        ).lastrowid
        assert number is not None
        self._remove_files(number)  # a killed process may have left changes of a run of this number
        return number

    def _check_refusal(self) -> None:
        """Raise InputError if no run can be added; in a transaction, so that who sets the refusal sees this run, or
        this sees the refusal."""
        if self.refusal:
            raise InputError(self.refusal)

    def store(self, run: int, fit: FitResult) -> None:
        """Store a run's finished phases. Raises InputError if it is not running, or the project cannot be written."""
        self._expect(run, "running")
        write_run(self._path(run), fit)
        self.drop_partial(run)
        self.version = next(self._versions)

    def store_partial(self, run: int, fit: FitResult) -> None:
        """Store the frames that phase 1 of a run has fitted so far, which alone are `observed`. Raises InputError as
        `store`."""
        self._expect(run, "running")
        write_run(self._partial_path(run), fit)

    def load_partial(self, run: int) -> FitResult:
        """The frames that phase 1 of a run has fitted before it ended; `observed` has none of the others. Raises
        InputError if they cannot be read."""
        path = self._partial_path(run)
        fit = read_run(path, self.get(run).config)
        if len(fit.observed) != self._frames:
            raise InputError(f"{path}: has {len(fit.observed)} frames; expected {self._frames}, the clip's.")
        return fit

    def resume(self, run: int, *, edits_seen: int) -> Run:
        """Record that a run that ended in phase 1 continues; its frames stay until phase 1 is stored. Raises InputError
        if it ended elsewhere, or the project cannot be written.

        Args:
            run: Its number.
            edits_seen: As in `start`.
        """
        if not (found := self.get(run)).partial:
            raise InputError(f"{found.name} was not stopped in its first pass, so it cannot be continued.")
        with self._writing() as connection:
            self._check_refusal()
            connection.execute(
                f"UPDATE runs SET state = 'running', ended = NULL, edits_seen = ?, moment = {_NEXT} WHERE id = ?",
                (edits_seen, run),
            )
        return self.get(run)

    def drop_partial(self, run: int) -> None:
        """Delete them. Raises InputError if that is not possible."""
        with accessing(self._folder):
            self._partial_path(run).unlink(missing_ok=True)
        self.version = next(self._versions)

    def finish(
        self, run: int, fit: FitResult, *, summary: dict[str, Any] | None = None, state: RunState = "running"
    ) -> Run:
        """Store a run's result; it is on disk when this returns. Raises InputError if it is in another state, or the
        project cannot be written; it is unchanged then.

        Args:
            run: Its number.
            fit: The result.
            summary: Figures for lists; None: seconds and costs.
            state: Its required state: "running", or "failed" because the result could not be written before.
        """
        self._expect(run, state)
        write_run(self._path(run), fit)
        self._update(run, state="finished", message="", summary=_summary(fit, summary), ended=_now())
        self.drop_partial(run)
        return self.get(run)

    def change(self, run: int, change: Callable[[Changes], object]) -> None:
        """Add a change to a run of corrections; it is on disk when this returns. Raises InputError if the project
        cannot be written; the fit is unchanged then."""
        changes = self.changes(run)
        self._update(run, ended=_now())  # first, because without the change it does no harm
        change(changes)
        if oldest := changes.oldest():
            write_run(self._path(run), changes.put_into(self._read(run), oldest))  # twice is the same as once
            with self._writing() as connection:
                connection.execute(
                    "UPDATE runs SET edits_seen = ?, summary = json_set(summary, '$.merged', 1) WHERE id = ?",
                    (oldest[-1].about.edits_seen, run),
                )
            changes.forget(oldest)

    def end(self, run: int, state: Ended, message: str = "") -> Run:
        """Record that a run was cancelled or failed, and why; stored phases are kept. Raises InputError if it is not
        running, or the project cannot be written."""
        self._expect(run, "running")
        message = message.encode(errors="replace").decode()  # a path in it may not be valid text
        self._update(run, state=state, message=message, summary=None, ended=_now())
        return self.get(run)

    def rename(self, run: int, name: str) -> None:
        """Rename a run; names are not file names, and may repeat. Raises InputError if the name is invalid, there is no
        such run, or the project cannot be written."""
        self.get(run)
        self._update(run, moment=False, name=checked_name(name))

    def delete(self, run: int) -> None:
        """Remove a run from the list; `undelete` restores it, until `purge`. Raises InputError if it is running, there
        is no such run, or the project cannot be written."""
        if (found := self.get(run)).state == "running":
            raise InputError(f"{found.name} is running; cancel it first.")
        self._update(run, moment=False, deleted=_now())

    def undelete(self, run: int) -> None:
        """Restore a deleted run. Raises InputError if it is missing, or the project cannot be written."""
        self.get(run)
        self._update(run, moment=False, deleted=None)

    def purge(self) -> list[int]:
        """Remove all deleted runs permanently; returns their numbers, which are not reused. Raises InputError if the
        project cannot be written."""
        gone = [run.id for run in self.all(deleted=True)]
        with self._writing() as connection, accessing(self._folder):
            # Files first: a row without a file only means that there is nothing to show.
            for run in gone:
                self._remove_files(run)
            sync(self._folder)
            connection.executemany("DELETE FROM runs WHERE id = ?", [(run,) for run in gone])
        return gone

    def all(self, *, deleted: bool = False, at: int | None = None) -> list[Run]:
        """All runs, oldest first; or all deleted ones. Corrections that were all undone are left out.

        Args:
            deleted: The deleted ones.
            at: The log entry after which corrections are as they are shown; None: the last one.
        """
        return [run for run in self._all(at) if run.deleted == deleted and not run.emptied]

    def get(self, run: int) -> Run:
        """A run by its number, deleted or not. Raises InputError if it is missing."""
        found = next((one for one in self._all() if one.id == run), None)
        if found is None:
            raise InputError(f"There is no run {run}; it may have been deleted. Choose a listed one.")
        return found

    def corrections(self, at: int | None = None) -> list[Run]:
        """The runs of corrections that are not deleted, oldest first, with those that were all undone; `at` as in
        `all`."""
        return [run for run in self._all(at) if run.kind == "corrections" and not run.deleted]

    def _all(self, at: int | None = None) -> list[Run]:
        rows = self._database.rows("SELECT * FROM runs ORDER BY id")
        found = [run for row in rows if (run := self._run(row, at)) is not None]
        return with_names(found, self._first_frame, self._frames)

    def load(self, run: int, at: int | None = None) -> FitResult:
        """A run's result, with all phases it finished. Raises InputError if there is no such run, or it has no result.

        Args:
            run: Its number.
            at: As in `all`.
        """
        changes = self.changes(run)
        return changes.put_into(self._read(run), changes.applied(at))

    def _read(self, run: int) -> FitResult:
        return read_run(self._path(run), self.get(run).config)

    def changes(self, run: int) -> Changes:
        """The changes that corrections made to a run."""
        if run not in self._changes:
            self._changes[run] = Changes(self._path(run).with_suffix(""), self._frames, self._log)
        return self._changes[run]

    def _remove_files(self, run: int) -> None:
        self._changes.pop(run, None)
        for path in (self._path(run), self._partial_path(run)):
            path.unlink(missing_ok=True)
        if (changes := self._path(run).with_suffix("")).is_dir():
            shutil.rmtree(changes)

    def _expect(self, run: int, state: RunState) -> None:
        found = self.get(run)
        if found.state != state:
            raise InputError(f"{found.name} is {found.state}; expected {state}.")

    def _path(self, run: int) -> Path:
        return self._folder / file_name(run)

    def _partial_path(self, run: int) -> Path:
        return self._path(run).with_suffix(".partial.npz")

    def _run(self, row: sqlite3.Row, at: int | None = None) -> Run | None:
        run = self._database.damage.read(row, f"run {row['id']}", self._of_row)
        if run is None or run.kind != "corrections":
            return run
        changes = self.changes(run.id)
        merged, standing = "merged" in run.summary, changes.standing(at)
        return replace(
            run,
            edits_seen=changes.edits_seen(run.edits_seen, at),
            emptied=bool(changes) and not standing and not merged,
            corrections=0 if merged else len({edit for c in standing for edit, on in c.about.edits.items() if on}),
        )

    def _of_row(self, row: Columns) -> Run:
        number = row.read("id", of(Count))
        first, last = (row.read(end, or_none(of(Count))) for end in ("first_frame", "last_frame"))
        state, stored = row.read("state", of(RunState)), self._path(number).is_file()
        return Run(
            id=number,
            name=row.read("name", lambda name: name and line(name)),
            kind=row.read("kind", of(RunKind)),
            state=state,
            config=row.read("config", _config),
            body=row.read("body", json_of(BodyRecord)),
            parent=row.read("parent", or_none(of(_parent(number)))),
            given=row.read("given", or_none(json_of(Given))) or Given(),
            frames=None if first is None or last is None else row.read("last_frame", lambda _: self._span(first, last)),
            edits_seen=row.read("edits_seen", of(Count)),
            started=row.read("started", time),
            ended=row.read("ended", or_none(time)),
            moment=row.read("moment", of(Count)),
            summary=row.read("summary", or_none(_figures)) or {},
            message=row.read("message", text),
            deleted=row.read("deleted", bool),
            stored=stored,
            partial=not stored and state != "running" and self._partial_path(number).is_file(),
        )

    def _span(self, first: int, last: int) -> range:
        if not first <= last < self._frames:
            raise ValueError(f"{first} to {last} of {self._frames} frames, counted from 0")
        return range(first, last + 1)


@lru_cache(256)
def _config(value: Any) -> FitConfig:
    """Settings that this version does not have are left out, and the default ones shown if it has other values."""
    plain = json_of(dict[str, Any])(value)
    try:
        return msgspec.convert(plain, FitConfig)
    except (ValueError, TypeError):
        return PRESETS[DEFAULT_PRESET]


def _parent(run: int) -> Any:
    return Annotated[int, msgspec.Meta(ge=1, lt=run)]


class _Figures(msgspec.Struct):
    """The fields of a run's summary that are shown or used."""

    seconds: dict[str, float] = {}
    source: str = ""
    format: str = ""
    placed: bool = True


def _figures(value: Any) -> dict[str, Any]:
    json_of(_Figures)(value)
    return json_of(dict[str, Any])(value)


def _now() -> str:
    return datetime.now(UTC).isoformat()


def _summary(fit: FitResult, given: dict[str, Any] | None) -> str:
    figures = given or {
        "seconds": {f"phase{p.phase}": p.seconds for p in fit.phases},
        "objective": {f"phase{p.phase}": p.objective for p in fit.phases},
    }
    return msgspec.json.encode(figures).decode()
