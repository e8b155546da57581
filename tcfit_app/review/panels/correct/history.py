"""The latest corrections of a project, a part of the Correct panel."""

from datetime import datetime
from functools import partial

from tcfit_app.project.edits.edit_log import LogEntry, Redo, Remark, Said, Undo
from tcfit_app.review.gestures.edit_words import describe, whose
from tcfit_app.review.panels.elements.html import Html, line, opener, paragraph, table
from tcfit_app.review.tab.tab import Tab

SHOWN = 12
"""Number of edits listed."""


def history(tab: Tab) -> Html:
    """The latest edits, newest first; a row leads to its frame, and undone edits are marked."""
    edits, now = tab.session.project.last_said(SHOWN), datetime.now().astimezone()
    return table(_edit_line(tab, entry, now) for entry in edits) if edits else paragraph("No corrections yet.", "dim")


def _edit_line(tab: Tab, entry: LogEntry, now: datetime) -> Html:
    edit, done, first = entry.action, tab.session.project.standing.stood(entry.id), tab.first_frame
    assert not isinstance(edit, Undo | Redo)
    visit = opener(describe(edit, first), "correct.visit", str(entry.id), partial(_visit, tab, edit))
    return line(
        _when(entry.time, now),
        whose(entry.author, tab.author),
        visit,
        whole=(0, 1),
        kind="" if done else "off",
        press=visit,
        hint=f"{'' if done else 'Undone. '}Go to frame {first + edit.frames[0]}",
    )


def _visit(tab: Tab, edit: Said) -> None:
    tab.pause()
    tab.seek(edit.frames[0])
    if not isinstance(edit, Remark):
        tab.set(selection=edit.joints)


def _when(time: datetime, now: datetime) -> str:
    local = time.astimezone(now.tzinfo)
    return local.strftime("%H:%M") if local.date() == now.date() else local.strftime("%d %b")
