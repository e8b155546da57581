"""A run as lists and choices have it: without what it found, and without torch."""

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
"""Everything; some frames again; the shape again; a run that grows with each keypoint that is dragged; a result of
another program, only to compare with."""


class BodyRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The body model of a run: which one is needed to show it."""

    kind: str
    gender: str
    hash: str
    """Empty if it is not known."""
    source: str = ""
    """The file's path, or empty."""


class Source(msgspec.Struct, frozen=True, kw_only=True):
    """A run of the project, or a file, that a user names."""

    run: int | None = None
    path: str = ""
    """Without a run."""
    person: int | None = None
    """Of several people in a file, the number; None: who follows the keypoints."""
    first_frame: int | None = None
    """Number in the video of the file's first frame; None: as it says."""


class Given(msgspec.Struct, frozen=True, kw_only=True):
    """What a fit was told that the clip does not say: what was chosen. What was read from it is in the result."""

    start: Source | None = None
    """With what phase 1 begins."""
    shape: Source | None = None
    """Whose shape the person has."""


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
    given: Given
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

    @property
    def option(self) -> str:
        """The run in a choice; names may be alike, numbers are not."""
        return f"{self.id} · {self.name}"


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


def newest_body(database: Database) -> str:
    """Where the body model of the run that began last was read; empty if nothing is known of that."""
    rows = database.rows("SELECT body FROM runs WHERE deleted IS NULL ORDER BY id DESC LIMIT 1")
    try:
        return msgspec.json.decode(rows[0]["body"], type=BodyRecord).source if rows else ""
    except (ValueError, TypeError):
        return ""


def largest(column: str, table: str) -> str:
    """The largest of some moments that are none the worse for damage, 0 without any, in SQL."""
    sound = f"typeof(m) = 'integer' AND m BETWEEN 0 AND {2**52}"
    return f"(SELECT coalesce(max(m), 0) FROM (SELECT {column} AS m FROM {table}) WHERE {sound})"


LAST_MOMENT = largest("moment", "runs")
"""The largest `Run.moment`, 0 without any, in SQL."""
