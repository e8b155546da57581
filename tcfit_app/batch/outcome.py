"""The outcome of a batch: a row for each clip, in files and as tables on the terminal."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from fitting_core.files.atomic import replacing
from fitting_core.keypoints import ERROR_GROUPS
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.records import Record, write_json

SUMMARY_CSV, SUMMARY_JSON = "summary.csv", "summary.json"
State = Literal["done", "done before", "failed", "failed before", "left"]
STATES: dict[State, str] = {
    "done": "fitted now",
    "done before": "finished before, with the same files and settings",
    "failed": "failed now",
    "failed before": "failed before, skipped (--retry fits them again)",
    "left": "not reached",
}
"""Texts for the table."""
FAILURES: tuple[State, ...] = ("failed", "failed before")
_LISTED = 40
"""Maximum number of failures on the terminal; the files have all."""


@dataclass(frozen=True, kw_only=True)
class ClipOutcome:
    """One clip."""

    line: int
    clip: str
    subject: str = ""
    state: State
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


def outcome_of(task: ClipTask, record: Record | None, before: bool) -> ClipOutcome:
    """The row of a clip by its record (None: not reached), which may be from an earlier run (`before`)."""
    if record is None:
        return ClipOutcome(line=task.line, clip=task.name, subject=task.subject, state="left")
    state: State = record.state
    if before:
        state = "done before" if state == "done" else "failed before"
    figures = record.figures
    off = figures.off if figures else {}
    return ClipOutcome(
        line=task.line,
        clip=task.name,
        subject=task.subject,
        state=state,
        seconds=round(record.seconds, 3),
        frames=figures.frames if figures else None,
        **{f"{name}_p95_px": off.get(name) for name in ERROR_GROUPS},
        jitter_mm_per_frame2=figures.jitter_mm if figures else None,
        reason=record.reason,
        notes=" | ".join(figures.notes) if figures else "",
    )


def write_summary(folder: Path, rows: Sequence[ClipOutcome], *, seconds: float) -> None:
    """Write summary.csv and summary.json into the batch's folder. Raises OSError if that is impossible."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(ClipOutcome.__dataclass_fields__))
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    with replacing(folder / SUMMARY_CSV) as draft:
        draft.write_text(text.getvalue(), encoding="utf-8")
    content = {
        "seconds": round(seconds, 3),
        "clips": counts(row.state for row in rows),
        "rows": [asdict(row) for row in rows],
    }
    write_json(folder / SUMMARY_JSON, content)


def counts(states: Iterable[State]) -> dict[State, int]:
    """Clips in each state, from theirs."""
    found = Counter(states)
    return {state: found[state] for state in STATES}


def show_summary(rows: Sequence[ClipOutcome], *, seconds: float, console: Console) -> None:
    """Print the number of clips in each state, with times, and the reasons of failures."""
    table = Table("clips", "", "seconds each", title=f"{len(rows)} clips, {_duration(seconds)}", title_justify="left")
    table.columns[0].justify = table.columns[2].justify = "right"
    for state, count in counts(row.state for row in rows).items():
        if count:
            times = sorted(row.seconds for row in rows if row.state == state and row.seconds is not None)
            table.add_row(str(count), STATES[state], f"{times[0]:.1f} to {times[-1]:.1f}" if times else "")
    console.print(table)
    failures = [row for row in rows if row.state in FAILURES]
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
