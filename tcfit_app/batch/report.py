"""The batch's report: one HTML page with a row for each clip, the worst first.

The rows stand in the page as data, and its script makes those that are looked at: a table of 10,000 rows would take
seconds. The pictures of the worst clips are within the page, so that it can be sent around; those of the others are
loaded from the folder beside it when they come into sight.
"""

import base64
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import msgspec

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file
from fitting_core.measure.report.markup import Markup, markup, tag
from fitting_core.measure.report.plots import CSS
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.outcome import FAILURES, STATES, Row, State, counts
from tcfit_app.batch.records import Figures, Record, picture_path

REPORT_HTML = "report.html"
_WITHIN = 1000
"""Pictures of so many clips are within the page: 4 MB."""
_JPEG = "data:image/jpeg;base64,"
_ROWS = re.compile(rb'<script type="application/json" id="rows">(.*?)</script>', re.DOTALL)
_MOST_BYTES = 1 << 28
_HERE = Path(__file__).parent
_ORDER = (
    "The worst come first: clips that failed, then those whose result is doubted, then by the largest of reprojection "
    "error, jitter and suspicious places for each frame, each against the median of the batch. A click on a column's "
    "name sorts by it. The picture is of the frame that the review would show first, and grows under the "
    "pointer."
)
_TOGETHER = "All clips in one list, to be reviewed and approved: "


def write_report(
    folder: Path, title: str, tasks: Sequence[ClipTask], rows: Sequence[Row], records: Sequence[Record | None]
) -> Path:
    """Write report.html into the batch's folder, from the rows and records (None: not reached) of all clips; its path.

    Raises OSError if it cannot be written.
    """
    figures = [record.figures if record else None for record in records]
    badness = _badness(rows, figures)
    worst = sorted(range(len(rows)), key=lambda place: badness[place], reverse=True)
    shown = [_shown(folder, tasks[i], rows[i], figures[i], rank < _WITHIN) for rank, i in enumerate(worst)]
    path = folder / REPORT_HTML
    with replacing(path) as draft:
        folders = [task.out.absolute().parent for task in tasks]
        together = tag("p", _TOGETHER, tag("code", _review_of(folders))) if folders else Markup()
        draft.write_text(_page(title, counts(row.state for row in rows), shown, together), encoding="utf-8")
    return path


class _Shown(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A row of a page that was written, without the commands for this computer's terminal."""

    line: int
    clip: str
    state: State
    subject: str = ""
    seconds: float | None = None
    frames: int | None = None
    px: float | None = None
    jitter: float | None = None
    suspicious: int | None = None
    why: str = ""
    notes: str = ""
    href: str = ""
    picture: str = ""


def served_report(path: Path, links: Mapping[str, str]) -> str:
    """A report that was written as a page of a site. Nothing but the values of its rows is taken from the file, which
    may be a stranger's: a script in it would be one of the site's. Raises InputError if it is no report.

    Args:
        path: Of report.html.
        links: By the ways from its folder to results and projects, where their rows lead; others lead nowhere.
    """
    try:
        found = _ROWS.search(regular_file(path, most=_MOST_BYTES).read_bytes())
        rows = msgspec.json.decode(found[1] if found else b"", type=list[_Shown])
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected the report of tcfit batch.") from error
    shown = [
        msgspec.structs.replace(
            row, href=links.get(row.href, ""), picture=row.picture if row.picture.startswith(_JPEG) else ""
        )
        for row in rows
    ]
    back = tag("p", tag("a", "All clips in the list", href="/"))
    return _page(path.parent.stem, counts(row.state for row in rows), shown, back)


_Badness = tuple[bool, bool, float]
"""Failed, doubted, and the largest figure against the batch's median."""


def _badness(rows: Sequence[Row], figures: Sequence[Figures | None]) -> list[_Badness]:
    """Sort keys of the rows, the largest first in the report."""
    measured = [_measured(f) if f else None for f in figures]
    columns = list(zip(*filter(None, measured), strict=True))
    middles = [median([value for value in column if value] or [1.0]) for column in columns]
    return [
        (
            row.state in FAILURES,
            bool(f and f.doubts),
            -1.0 if values is None else max(v / middle for v, middle in zip(values, middles, strict=True)),
        )
        for row, f, values in zip(rows, figures, measured, strict=True)
    ]


def _measured(figures: Figures) -> tuple[float, float, float]:
    """Reprojection error, jitter, and suspicious places for each frame."""
    return (figures.reprojection_px or 0.0, figures.jitter_mm or 0.0, (figures.suspicious or 0) / figures.frames)


def _shown(folder: Path, task: ClipTask, row: Row, figures: Figures | None, within: bool) -> dict[str, Any]:
    """A row as the page's script takes it; what is not known is left out."""
    done = figures is not None
    content: dict[str, Any] = {
        "line": row.line,
        "clip": row.clip,
        "subject": row.subject,
        "state": row.state,
        "seconds": row.seconds,
        "frames": row.frames,
        "px": row.reprojection_px,
        "jitter": row.jitter_mm_per_frame2,
        "suspicious": figures.suspicious if figures else None,
        "why": row.reason or "; ".join([*figures.doubts, figures.worst] if figures else []),
        "notes": row.notes,
        "href": _link(task.out, folder) if done else "",
        "command": shlex.join(["tcfit", "review", str(task.out.absolute())]) if done else "",
        "picture": _picture(folder, task, within) if done else "",
    }
    return {name: value for name, value in content.items() if value not in (None, "")}


def _link(path: Path, folder: Path) -> str:
    """From the page, which stays right when both are moved."""
    try:
        return Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()
    except ValueError:  # on another drive
        return path.absolute().as_uri()


def _review_of(folders: Sequence[Path]) -> str:
    """What opens the list of all clips in some folders; of the first where they lie on several drives."""
    try:
        common = os.path.commonpath(folders)
    except ValueError:
        common = str(folders[0])
    return shlex.join(["tcfit", "review", common])


def _picture(folder: Path, task: ClipTask, within: bool) -> str:
    path = picture_path(folder, task)
    if not within:
        return _link(path, folder)
    try:
        return _JPEG + base64.b64encode(path.read_bytes()).decode()
    except OSError:
        return ""


def _page(title: str, states: Mapping[State, int], shown: Sequence[object], together: Markup) -> str:
    cards = [
        tag("div", tag("b", count), tag("span", STATES[state]), class_="card")
        for state, count in states.items()
        if count
    ]
    data = msgspec.json.encode(shown).decode().replace("<", "\\u003c")  # </script> in a name must not end the data.
    body = tag(
        "main",
        tag("h1", title),
        tag("p", f"{len(shown)} clips", class_="dim"),
        tag("div", *cards, class_="cards"),
        tag("p", _ORDER, class_="dim"),
        together,
        tag("noscript", tag("p", "The rows are made by a script; summary.csv beside this page has them too.")),
        tag("div", id="clips"),
    )
    head = (
        Markup('<!doctype html><html lang="en"><head><meta charset="utf-8">'),
        Markup('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        tag("title", title),
        Markup(f"<style>{CSS}{_file('report.css')}</style></head><body>"),
    )
    scripts = Markup(f'<script type="application/json" id="rows">{data}</script><script>{_file("report.js")}</script>')
    return "".join(map(markup, (*head, body, scripts, Markup("</body></html>\n"))))


def _file(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")
