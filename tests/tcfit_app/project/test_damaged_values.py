"""A damaged value in any column of the database: its row is left out and reported, and the rest is drawn and exported.
Without its clip a project is refused."""

import shutil
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any, get_args

import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.cli.main import main
from tcfit_app.exports.table import EXPORTS
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tcfit_app.project.storage import database
from tcfit_app.project.storage.clip_review import State, Worst
from tcfit_app.review.browser.page_events import Hello
from tcfit_app.review.drawing.status import damage_in_short
from tests.drivers.lone_page import lone_page
from tests.samples.media import write_video
from tests.samples.project_samples import BODY, CONFIG, random_edit, sample_view
from tests.samples.sessions import OneBody
from tests.samples.waving import waving_fit, waving_project

pytestmark = pytest.mark.thorough

NONSENSE: dict[str, Any] = {
    "nothing": None,
    "bytes": b"\x00\xff\xfe nonsense",
    "a word": "nonsense",
    "no text": "CAST(x'ff41' AS TEXT)",
    "a number": 123456789012345,
    "below all": -(2**63),
    "above all": 2**63 - 1,
    "a fraction": 1e300,
    "no number": float("inf"),
    "JSON": '{"kind": 3, "seconds": [1], "frames": "x", "focal": [[[]]]}',
    "deep JSON": '{"x": ' + "[" * 100_000,
    "huge": "x" * 300_000,
}
"""What any column may hold instead of what belongs there; "no text" is an expression of SQL."""
SOME = ("nothing", "bytes", "no text", "above all", "JSON")
QUICK = [name for name, export in EXPORTS.items() if name in ("npz", "fit", "summary", "figures", "pose")]
"""Exports that need no rendering, no video and no seconds."""


def _columns() -> list[tuple[str, str]]:
    """Every column of every table of the present version, read from the schema itself."""
    with closing(sqlite3.connect(":memory:")) as connection:
        for migration in database.MIGRATIONS:
            migration(connection)
        tables = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        return [
            (table, row[1])
            for table in tables
            if not table.startswith("sqlite_")
            for row in connection.execute(f"PRAGMA table_info({table})")
        ]


COLUMNS = _columns()


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Path:
    """A project with something in every table."""
    folder = waving_project(tmp_path_factory.mktemp("damage") / "walk.tcfit", free_body)
    with Project.open(folder) as project:
        for seed in range(4):
            project.append(random_edit(seed), author="me")
        project.undo()
        project.marks.set([1, 2], "checked")
        far = project.runs.all()[-1]
        again = project.runs.start(CONFIG, body=far.body, edits_seen=2, kind="frames", parent=2, frames=range(1, 3))
        project.runs.finish(again.id, waving_fit(1.0), summary={"seconds": {"phase3": 1.0}, "source": "x"})
        project.runs.delete(1)
        project.review.approve("me")
        project.review.set_note("left hand")
        view = sample_view(project.clip, name="b", count=3)
        project.add_view(replace(view, clip=replace(view.clip, source=write_video(folder.parent / "b.mp4"))))
        project.review.set_worst(Worst(run=2, left=1, score=1.5, frame=3, words="wrist is off"))
    with closing(sqlite3.connect(folder / database.NAME)) as connection, connection:
        values = ("3", "'flag'", "''", "'2026-01-01T00:00:00+00:00'", "'me'", "1", "1")
        connection.execute(f"INSERT INTO marks VALUES ({', '.join(values)})")
    return folder


def damaged(sound: Path, folder: Path, table: str, column: str, value: Any) -> bool:
    """Make a copy of the project whose newest row of a table has this value, whatever the schema says of that.

    Returns:
        False if SQLite takes no such value even then.
    """
    shutil.copytree(sound, folder)
    with closing(sqlite3.connect(folder / database.NAME, isolation_level=None)) as connection:
        tables = connection.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'").fetchall()
        triggers = connection.execute("SELECT sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
        connection.executescript("DROP TRIGGER edits_no_update; DROP TRIGGER edits_no_delete")
        connection.executescript("PRAGMA ignore_check_constraints = ON; PRAGMA writable_schema = ON")
        connection.execute("UPDATE sqlite_master SET sql = replace(sql, 'NOT NULL', '') WHERE type = 'table'")
        connection.execute("PRAGMA writable_schema = RESET")
        given, values = (value, ()) if value == NONSENSE["no text"] else ("?", (value,))
        newest = f"rowid = (SELECT max(rowid) FROM {table})"
        try:
            connection.execute(f"UPDATE {table} SET {column} = {given} WHERE {newest}", values)
        except sqlite3.IntegrityError:
            return False
        finally:
            connection.execute("PRAGMA writable_schema = ON")
            connection.executemany(
                "UPDATE sqlite_master SET sql = ? WHERE name = ?", [(sql, name) for name, sql in tables]
            )
            for (sql,) in triggers:
                connection.execute(sql)
    return True


SILENT = {
    ("clip", "id"): "there is one row",
    ("clip", "created"): "read only to compare projects",
    ("runs", "deleted"): "whatever is there, it was deleted",
    ("marks", "reason"): "nothing reads it any more",
    ("review", "id"): "there is one row",
}
"""Columns of which nothing need be said, and why."""


@pytest.mark.parametrize(("table", "column"), COLUMNS)
@pytest.mark.parametrize("names", [SOME, pytest.param(tuple(NONSENSE), marks=pytest.mark.slow, id="all")])
def test_a_project_with_a_damaged_value_is_worked_on(
    names: tuple[str, ...], table: str, column: str, sound: Path, tmp_path: Path
):
    taken, told = set[str](), set[str]()
    for name in names:
        folder = tmp_path / name / "walk.tcfit"
        if not damaged(sound, folder, table, column, NONSENSE[name]):
            continue
        taken.add(name)
        if table == "clip" and _refused(folder, column):
            told.add(name)
            continue
        with Project.open(folder, read_only=True) as project:
            _look(project)
            if any(column.replace("_", " ") in text for text in project.damage):
                told.add(name)
        with Project.open(folder) as project:
            _look(project)
            if (column, name) != ("id", "above all"):  # there is no number for another one
                _go_on(project)
    assert (table, column) in SILENT or (told and told >= taken & {"bytes", "no text"}), f"of {taken} only {told}"


def _refused(folder: Path, column: str) -> bool:
    """Whether the project is refused because of that column, and looked at without another error."""
    try:
        glance(folder)
    except InputError as error:
        assert "Restore" in str(error) or "restore" in str(error)
    try:
        Project.open(folder).close()
    except InputError as error:
        assert column.replace("_", " ") in str(error)
        return True
    return False


def _drawn_and_exported(folder: Path, server: viser.ViserServer, body: BodyModel, said: Callable[[], str]) -> None:
    with Project.open(folder) as project, lone_page(server, project, bodies=OneBody(body)) as page:
        page.page.receive(Hello(tab="a", browser="b", dark=False, width=1000, height=700, hinted=True))
        for _ in range(2):
            page.html()
            page.page.draw(time.monotonic())
            page.settle()
        chips = [chip.text for chip in page.page.header.status.messages(time.monotonic(), "")]
        assert [text for text in chips if text.startswith("Damaged")] == [damage_in_short(project.damage)] * bool(
            project.damage
        )
        assert all(text in unescape(page.html()) for text in project.damage)
        assert not [notice for notice in page.notices if notice.kind == "error"], page.notices
    out = folder.parent / "out"
    assert main(["export", str(folder), "--out", str(out), "--formats", *QUICK]) == 0
    assert "Traceback" not in said() and len(list(out.iterdir())) == len(QUICK)


@pytest.mark.parametrize(("table", "column"), COLUMNS)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name != "bytes")) for name in NONSENSE]
)
def test_a_project_with_a_damaged_value_is_drawn_and_exported(
    name: str,
    table: str,
    column: str,
    sound: Path,
    tmp_path: Path,
    panel_server: viser.ViserServer,
    free_body: BodyModel,
    capsys: pytest.CaptureFixture[str],
):
    folder = tmp_path / "walk.tcfit"
    if damaged(sound, folder, table, column, NONSENSE[name]) and not (table == "clip" and _refused(folder, column)):
        _drawn_and_exported(folder, panel_server, free_body, lambda: capsys.readouterr().err)


def _look(project: Project) -> None:
    """Read all there is."""
    assert project.clip.keypoints is not None and project.corrected.xy.size and project.reference is None
    runs = [*project.runs.all(), *project.runs.all(deleted=True)]
    assert project.review.now.state(fitted=True) in get_args(State)
    assert glance(project.folder).frames == len(project.clip)
    assert runs and project.marks.all().keys() <= set(range(len(project.clip)))
    for run in (run for run in runs if run.stored):
        assert project.runs.load(run.id).phases


def _go_on(project: Project) -> None:
    """Do what a user would."""
    project.append(random_edit(7))
    project.undo()
    project.marks.set([0], "flag")
    project.review.approve("me")
    run = project.runs.start(CONFIG, body=BODY, edits_seen=project.last_edit)
    project.runs.end(run.id, "cancelled")
