"""The outcome of each clip of a batch: in its summary.json, in summary.csv, and on the terminal."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from fitting_core.files.atomic import replacing, sweep
from fitting_core.files.regular import regular_file
from fitting_core.io.result_files import SUMMARY_NAME, is_result
from tcfit_app.batch.inputs import unchanged
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.project.glance import off_by_phase
from tcfit_app.project.storage.accessing import accessing

SUMMARY_CSV = "summary.csv"
State = Literal["done", "done before", "failed", "left"]
STATES: dict[State, str] = {
    "done": "fitted now",
    "done before": "finished before, with the same files and settings",
    "failed": "failed",
    "left": "not reached",
}
"""Texts for the table."""
_LISTED = 40
"""Maximum number of failures on the terminal; the file has all."""


@dataclass(frozen=True, kw_only=True)
class ClipOutcome:
    """One clip: a row of summary.csv."""

    line: int
    clip: str
    state: State = "left"
    seconds: float | None = None
    frames: int | None = None
    body_p95_px: float | None = None
    hands_p95_px: float | None = None
    face_p95_px: float | None = None
    """95 % of the keypoints of a part are less off."""
    jitter_mm_per_frame2: float | None = None
    """Of the joints in camera space."""
    reason: str = ""
    notes: str = ""


class Mark(msgspec.Struct, frozen=True, kw_only=True):
    """`batch` in the summary.json of a clip that is done."""

    inputs: str
    """See `inputs_of`."""
    seconds: float
    notes: list[str] = []


class _Summary(msgspec.Struct, frozen=True):
    frames: int = 0
    reprojection_px: dict[str, dict[str, float | None]] = {}
    jitter: dict[str, dict[str, float | None]] = {}
    warnings: list[str] = []
    batch: Mark | None = None


def failure(task: ClipTask, reason: str, *, seconds: float = 0.0) -> ClipOutcome:
    """The outcome of a clip that failed."""
    return ClipOutcome(line=task.line, clip=task.name, state="failed", seconds=round(seconds, 3), reason=reason)


def mark_done(task: ClipTask, content: dict[str, Any], mark: Mark) -> ClipOutcome:
    """Write the hash of a result that is complete into its summary.json. Raises InputError if that is impossible."""
    data = msgspec.json.encode(content | {"batch": mark})
    with accessing(task.out), replacing(task.out / SUMMARY_NAME) as draft:
        draft.write_bytes(msgspec.json.format(data, indent=2) + b"\n")
    return _outcome(task, msgspec.json.decode(data, type=_Summary), mark, "done")


def done_before(task: ClipTask) -> ClipOutcome | None:
    """The outcome of a clip whose result is complete and up to date; None if it must be fitted."""
    if not is_result(task.out):
        return None
    try:
        found = msgspec.json.decode(regular_file(task.out / SUMMARY_NAME).read_bytes(), type=_Summary)
    except (OSError, ValueError):
        return None
    if found.batch is None or not unchanged(found.batch.inputs, task):
        return None
    sweep(task.out)  # a process that was killed right after its last write
    return _outcome(task, found, found.batch, "done before")


def _outcome(task: ClipTask, found: _Summary, mark: Mark, state: State) -> ClipOutcome:
    off, jitter = off_by_phase(found.reprojection_px), found.jitter
    return ClipOutcome(
        line=task.line,
        clip=task.name,
        state=state,
        seconds=round(mark.seconds, 3),
        frames=found.frames,
        body_p95_px=off.get("body"),
        hands_p95_px=off.get("hands"),
        face_p95_px=off.get("face"),
        jitter_mm_per_frame2=jitter[max(jitter)].get("camera_space_mm_per_frame2") if jitter else None,
        notes=" | ".join([*found.warnings, *mark.notes]),
    )


def write_summary(folder: Path, rows: Sequence[ClipOutcome]) -> None:
    """Write summary.csv into the batch's folder. Raises OSError if that is impossible."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(ClipOutcome.__dataclass_fields__))
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    with replacing(folder / SUMMARY_CSV) as draft:
        draft.write_text(text.getvalue(), encoding="utf-8")


def show_summary(rows: Sequence[ClipOutcome], *, seconds: float, console: Console) -> None:
    """Print the number of clips in each state, with times, and the reasons of failures."""
    table = Table("clips", "", "seconds each", title=f"{len(rows)} clips, {_duration(seconds)}", title_justify="left")
    table.columns[0].justify = table.columns[2].justify = "right"
    for state, text in STATES.items():
        if some := [row for row in rows if row.state == state]:
            times = sorted(row.seconds for row in some if row.seconds is not None)
            table.add_row(str(len(some)), text, f"{times[0]:.1f} to {times[-1]:.1f}" if times else "")
    console.print(table)
    failures = [row for row in rows if row.state == "failed"]
    if failures:
        console.print(_failures(failures))
    if len(failures) > _LISTED:
        console.print(f"... and {len(failures) - _LISTED} more")


def _failures(rows: Sequence[ClipOutcome]) -> Table:
    table = Table("line", "clip", "reason", title="Failed", title_justify="left", show_lines=True)
    table.columns[2].overflow = "fold"  # do not cut off paths
    for row in rows[:_LISTED]:
        table.add_row(str(row.line), escape(row.clip), escape(row.reason))
    return table


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{seconds:.1f} s"
