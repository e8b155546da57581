"""Clips of strangers beside sound ones: names that are no text, files that do not end, databases that do not end. Each
is refused by itself, at once, and all others are listed."""

import os
import shutil
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from fitting_core.errors import InputError
from tcfit_app.home.catalogue import SUMMARY, Catalogue
from tcfit_app.home.found import RESULT
from tcfit_app.home.messages import Row
from tcfit_app.home.pictures import picture_of
from tcfit_app.project.picture import NAME as PICTURE
from tcfit_app.project.project import Project
from tcfit_app.project.storage import database
from tcfit_app.project.storage.lock import NAME as LOCK
from tests.samples.media import write_video
from tests.samples.project_samples import sample_clip
from tests.samples.special_files import SPECIAL
from tests.tcfit_app.home.test_home import received, send, served, until

SECONDS = 30.0
"""Far more than a look takes, on a busy computer."""


def looked_at(root: Path) -> dict[str, Row]:
    """The rows of a list by place, whose pictures were made as well."""
    found: dict[str, Row] = {}

    def look() -> None:
        catalogue = Catalogue(root)
        catalogue.refresh()
        for row in catalogue.rows():
            entry = catalogue.get(row.key)
            assert entry is not None
            picture_of(entry, catalogue)
        found.update({row.place: row for row in catalogue.rows()})

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    thread.join(SECONDS)
    assert not thread.is_alive(), "the look does not end"
    return found


@pytest.fixture
def sound(tmp_path: Path) -> Path:
    """A folder with a project."""
    Project.create(tmp_path / "corpus" / "sound.tcfit", sample_clip()).close()
    return tmp_path / "corpus"


PROJECT_FILES = (database.NAME, f"{database.NAME}-wal", LOCK, "detections.npz", PICTURE)


@pytest.mark.parametrize("make", SPECIAL)
@pytest.mark.parametrize("name", PROJECT_FILES)
def test_a_project_with_a_special_file_is_looked_at(name: str, make: Callable[[Path], None], sound: Path):
    odd = Path(shutil.copytree(sound / "sound.tcfit", sound / "odd.tcfit"))
    (odd / name).unlink(missing_ok=True)
    make(odd / name)
    rows = looked_at(sound)
    assert not rows["sound.tcfit"].problem
    linked = name == database.NAME and make is not SPECIAL[0]  # links to databases are not followed
    assert linked or ("expected a file" in rows["odd.tcfit"].problem) == (database.NAME in name)


@pytest.mark.parametrize("make", SPECIAL)
@pytest.mark.parametrize("name", [RESULT, SUMMARY, "people.json"])
def test_a_result_with_a_special_file_is_looked_at(name: str, make: Callable[[Path], None], sound: Path):
    folder = sound / "people" / "odd"
    folder.mkdir(parents=True)
    (folder / RESULT).write_bytes(b"")
    (folder / SUMMARY).write_text("{}")
    place = (folder.parent if name == "people.json" else folder) / name
    place.unlink(missing_ok=True)
    make(place)
    rows = looked_at(sound)
    assert not rows["sound.tcfit"].problem
    if name != RESULT and place.is_fifo():
        assert "is a named pipe, expected a file" in rows["people/odd"].problem


def test_frames_that_are_pipes_are_no_clip(sound: Path):
    (sound / "frames").mkdir()
    for number in range(12):
        os.mkfifo(sound / "frames" / f"{number:04}.png")
    assert list(looked_at(sound)) == ["sound.tcfit"]


def test_a_name_that_is_not_utf_8_is_listed_with_all_others(tmp_path: Path):
    root = tmp_path / os.fsdecode(b"caf\xe9")
    root.mkdir()
    video = write_video(tmp_path / "a.mp4", frames=6)
    for name in ("a.mp4", os.fsdecode(b"th\xe9.mp4")):
        shutil.copyfile(video, root / name)
    with served(root) as lab, lab.socket() as page:
        assert lab.get("/")[0] == 200
        rows = received(page, "rows")["rows"]
        assert [row["name"] for row in rows] == ["a", "th?"] and rows[1]["place"] == "th\ufffd.mp4"
        send(page, type="open", key=rows[1]["key"])
        assert "Rename it" in received(page, "refusal")["text"]
        send(page, type="fit", keys=[rows[1]["key"]])
        assert "Rename it" in received(page, "refusal")["text"]


ENDLESS = "(WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x FROM c)"
HUGE = "hex(zeroblob(499999999))"
LOG = "(id INTEGER PRIMARY KEY, time TEXT, author TEXT, action TEXT"
HOSTILE: dict[str, tuple[str, ...]] = {
    "rows without end": (f"CREATE VIEW clip AS SELECT clip0.* FROM {ENDLESS}, clip0",),
    "no first row": (f"CREATE VIEW clip AS SELECT * FROM clip0 WHERE (SELECT count(*) FROM {ENDLESS}) > 0",),
    "a value of 1 GB": (f"CREATE VIEW clip AS SELECT *, {HUGE} AS notes FROM clip0",),
    "a generated column": (
        "DROP TABLE edits",
        f"CREATE TABLE edits {LOG} GENERATED ALWAYS AS ({HUGE}))",
        "INSERT INTO edits VALUES (1, '', '')",
    ),
    "a check that takes memory": (
        "DROP TABLE edits",
        f"CREATE TABLE edits {LOG} CHECK (length({HUGE}) > 0))",
    ),
    "a trigger": (
        f"CREATE TRIGGER more AFTER INSERT ON edits BEGIN INSERT INTO edits (action) SELECT x FROM {ENDLESS}; END",
    ),
    "a trigger with the name of ours": (
        "DROP TRIGGER edits_no_update",
        f"CREATE TRIGGER edits_no_update BEFORE INSERT ON edits BEGIN SELECT count(*) FROM {ENDLESS}; END",
    ),
    "an index": ("CREATE INDEX costly ON edits (hex(zeroblob(1000000)))",),
}


@pytest.mark.parametrize("statements", HOSTILE.values(), ids=HOSTILE)
def test_a_database_that_does_not_end_is_refused(statements: tuple[str, ...], sound: Path):
    odd = Path(shutil.copytree(sound / "sound.tcfit", sound / "odd.tcfit"))
    with closing(sqlite3.connect(odd / database.NAME, isolation_level=None)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
        if " clip0" in statements[0]:
            connection.execute("ALTER TABLE clip RENAME TO clip0")
        for statement in statements:
            connection.execute(statement)
    rows = looked_at(sound)
    assert "that tcfit did not create" in rows["odd.tcfit"].problem and not rows["sound.tcfit"].problem
    with pytest.raises(InputError, match="that tcfit did not create"):
        Project.open(odd)


def test_a_table_that_contains_itself_is_refused(sound: Path):
    """Pages that name one child many times are a table of a million rows per kilobyte."""
    odd = Path(shutil.copytree(sound / "sound.tcfit", sound / "odd.tcfit"))
    with closing(sqlite3.connect(odd / database.NAME)) as connection, connection:
        connection.executemany(
            "INSERT INTO edits (time, author, action) VALUES ('', '', ?)", [("x" * 1000,) for _ in range(5000)]
        )
        root = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'edits'").fetchone()[0]
        connection.execute("PRAGMA journal_mode = DELETE")
    content = bytearray((odd / database.NAME).read_bytes())
    page = (root - 1) * 4096
    assert content[page] == 5, "an interior page of a table"
    cells = int.from_bytes(content[page + 3 : page + 5])
    starts = [int.from_bytes(content[page + 12 + 2 * n : page + 14 + 2 * n]) for n in range(cells)]
    for start in starts:
        content[page + start : page + start + 4] = content[page + starts[0] : page + starts[0] + 4]
    (odd / database.NAME).write_bytes(content)
    assert "is damaged" in looked_at(sound)["odd.tcfit"].problem


def test_an_unforeseen_error_of_one_clip_leaves_the_others(sound: Path, monkeypatch: pytest.MonkeyPatch):
    shutil.copytree(sound / "sound.tcfit", sound / "odd.tcfit")
    from tcfit_app.home import catalogue

    def odd_fails(folder: Path, glance: Callable[[Path], object] = catalogue.glance) -> object:
        if folder.stem == "odd":
            raise ZeroDivisionError("unforeseen")
        return glance(folder)

    monkeypatch.setattr(catalogue, "glance", odd_fails)
    rows = looked_at(sound)
    assert "unforeseen" in rows["odd.tcfit"].problem and not rows["sound.tcfit"].problem


def test_the_list_lives_on(sound: Path):
    """The whole of it, with an odd clip that comes while it is looked at."""
    with served(sound) as lab, lab.socket() as page:
        received(page, "rows")
        (sound / "odd").mkdir()
        (sound / "odd" / RESULT).write_bytes(b"")
        os.mkfifo(sound / "odd" / SUMMARY)
        found = received(page, "rows", lambda message: message["rows"])["rows"]
        assert "named pipe" in found[0]["problem"]
        until(lambda: len(lab.home.catalogue.rows()) == 2)
