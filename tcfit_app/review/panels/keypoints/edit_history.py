"""What was done to the keypoints, newest first."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from tcfit_app.project.edits.edit_log import LogEntry, Redo, Undo
from tcfit_app.project.edits.kinds import Edit
from tcfit_app.review.gestures.correcting import describe
from tcfit_app.review.panels.elements.html import Html, line, paragraph, table

SHOWN = 12


@dataclass(frozen=True, kw_only=True)
class PastEdit:
    """An edit of the log, as it stands now."""

    id: int
    time: datetime
    author: str
    edit: Edit
    undone: bool


def past_edits(log: Sequence[LogEntry], most: int = SHOWN) -> list[PastEdit]:
    """The last edits of a log, newest first, with those that were undone."""
    undone: set[int] = set()
    edits = []
    for entry in log:
        if isinstance(entry.action, Undo):
            undone.add(entry.action.edit)
        elif isinstance(entry.action, Redo):
            undone.discard(entry.action.edit)
        else:
            edits.append((entry, entry.action))
    return [
        PastEdit(id=entry.id, time=entry.time, author=entry.author, edit=edit, undone=entry.id in undone)
        for entry, edit in reversed(edits[-most:])
    ]


def history_table(edits: Sequence[PastEdit], *, me: str, first_frame: int, now: datetime) -> list[Html]:
    """The history as HTML; a row leads to its frame.

    Args:
        edits: as from `past_edits`.
        me: the author who reads it.
        first_frame: the number that users see for frame 0.
        now: to leave out today's date.
    """
    if not edits:
        return [paragraph("No corrections yet.", "dim")]
    rows = [
        line(
            _when(past.time, now),
            "you" if past.author == me else "another tab" if past.author.startswith("tab ") else past.author,
            describe(past.edit, first_frame),
            whole=(0, 1),
            kind="off" if past.undone else "",
            command="keypoints.visit",
            value=str(past.id),
            hint=f"{'Undone. ' if past.undone else ''}Go to frame {first_frame + past.edit.frames[0]}",
        )
        for past in edits
    ]
    return [table(rows)]


def _when(time: datetime, now: datetime) -> str:
    local = time.astimezone(now.tzinfo)
    return local.strftime("%H:%M") if local.date() == now.date() else local.strftime("%d %b")
