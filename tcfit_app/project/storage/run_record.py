"""The record of a run without its result, and without torch."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

import msgspec

from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from tcfit_app.project.storage.database import Database

Ended = Literal["cancelled", "failed"]
RunState = Literal["running", "finished", "interrupted"] | Ended
RunKind = Literal["fit", "frames", "shape", "corrections", "imported"]
"""Everything; some frames again; the shape again; a run that follows drags of keypoints; another program's result, only
to compare with."""


class BodyRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body model of a run, needed to show it."""

    kind: str
    gender: str
    hash: str
    """Empty if unknown."""
    source: str = ""
    """The file's path, or empty."""


class Source(msgspec.Struct, frozen=True, kw_only=True):
    """A run of the project, or a file, chosen by a user."""

    run: int | None = None
    path: str = ""
    """If there is no run."""
    person: int | None = None
    """The number, if the file has several people; None: the one who matches the keypoints."""
    first_frame: int | None = None
    """Video frame number of the file's first frame; None: as stored in it."""


class Given(msgspec.Struct, frozen=True, kw_only=True):
    """The user's choice of what a fit is given besides the clip. Its content is in the result."""

    start: Source | None = None
    """The start of phase 1."""
    shape: Source | None = None
    """The source of the person's shape."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """A fit, without its result."""

    id: int
    name: str
    """As users see it: see `run_names`."""
    kind: RunKind
    state: RunState
    config: FitConfig
    body: BodyRecord
    parent: int | None
    """The run that this one started from."""
    given: Given
    frames: range | None
    """The refitted frames, from the clip's first; None: all."""
    edits_seen: int
    """Id of the last log entry when it started, 0: none; of corrections, of the last one up to which it includes all
    edits."""
    started: datetime
    ended: datetime | None
    moment: int
    """Ascending over starts and ends of the project's runs: that of its end, or of its start until then."""
    summary: dict[str, Any]
    """Figures for lists and comparisons."""
    message: str
    """Why it failed."""
    deleted: bool
    """Can be restored until `purge`."""
    stored: bool
    """Whether there is a file with at least one phase."""
    partial: bool = False
    """It ended in phase 1, and the frames fitted until then are stored: see `Runs.load_partial`."""
    emptied: bool = False
    """It has corrections, and all were undone: it is listed again once one is redone."""
    corrections: int = 0
    """How many it has now; 0 also if that is unknown, because the oldest can no longer be undone."""
    own_name: str = ""
    """The user's, if any."""


def by_name(runs: Sequence[Run]) -> dict[str, Run]:
    """Runs by names for a list of options, in the same order: those of the same name get their number."""
    count = Counter(run.name for run in runs)
    return {run.name if count[run.name] == 1 else f"{run.name} (#{run.id})": run for run in runs}


def newest(runs: Sequence[Run]) -> Run:
    """The default run: the newest that is not an import, which is only to compare with."""
    own = [run for run in runs if run.kind != "imported"]
    return (own or runs)[-1]


def named(runs: Sequence[Run], name: str) -> Run:
    """The run that a user refers to by name or by number ("3", "#3" or "Run 3"). Raises InputError if it is missing, or
    several have this name."""
    number = name.removeprefix("Run ").lstrip("#")
    found = [run for run in runs if name == run.name] or [run for run in runs if number == str(run.id)]
    if len(found) == 1:
        return found[0]
    known = ", ".join(f"{run.name!r} (#{run.id})" for run in runs) or "none"
    several = "several runs have this name; give a number" if found else "no such run"
    raise InputError(f"Run {name!r}: {several}. Runs with a result: {known}.")


def newest_body(database: Database) -> str:
    """The path of the body model of the run started last; empty if unknown."""
    rows = database.rows("SELECT body FROM runs WHERE deleted IS NULL ORDER BY id DESC LIMIT 1")
    try:
        return msgspec.json.decode(rows[0]["body"], type=BodyRecord).source if rows else ""
    except (ValueError, TypeError):
        return ""


def largest(column: str, table: str) -> str:
    """The largest of the undamaged moments, 0 without any, in SQL."""
    sound = f"typeof(m) = 'integer' AND m BETWEEN 0 AND {2**52}"
    return f"(SELECT coalesce(max(m), 0) FROM (SELECT {column} AS m FROM {table}) WHERE {sound})"


LAST_MOMENT = largest("moment", "runs")
"""The largest `Run.moment`, 0 without any, in SQL."""
