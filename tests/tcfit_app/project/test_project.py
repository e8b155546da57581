"""A project on the disk: what is put in comes out again, who may write, and what is done about damage."""

import errno
import hashlib
import io
import os
import re
import shutil
import sqlite3
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.files import locking
from fitting_core.keypoints import COUNT
from tcfit_app.analysis.suspicion import still_checked
from tcfit_app.project import project as project_module
from tcfit_app.project.edits.kinds import MarkBad, MoveKeypoint
from tcfit_app.project.project import Project
from tcfit_app.project.storage import database, media
from tcfit_app.project.storage import runs as runs_module
from tcfit_app.project.storage.database import MIGRATIONS, NAME, Database
from tcfit_app.project.storage.lock import ProjectLocked
from tests.samples.media import write_video
from tests.samples.project_samples import (
    BODY,
    CONFIG,
    applied,
    assert_same_fit,
    random_edit,
    same_keypoints,
    sample_clip,
    sample_fit,
)

BAD = MarkBad(frames=(0,), joints=(0, 1))
MOVE = MoveKeypoint(frames=(2,), joints=(4,), xy=(((1 / 3, 2.5),),))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A closed project with two edits, an undo and a run."""
    with Project.create(tmp_path / "walk.tcfit", sample_clip()) as project:
        project.append(BAD, author="anna")
        project.append(MOVE, author="ben")
        project.undo(author="anna")
        run = project.runs.start(CONFIG, body=BODY, edits_seen=project.last_edit)
        project.runs.finish(run.id, sample_fit(1))
    return tmp_path / "walk.tcfit"


def test_a_clip_comes_back(tmp_path: Path):
    clip = sample_clip()
    Project.create(tmp_path / "new" / "walk.tcfit", clip).close()
    with Project.open(tmp_path / "new" / "walk.tcfit") as project:
        assert same_keypoints(project.detections, clip.keypoints) and same_keypoints(
            project.clip.keypoints, clip.keypoints
        )
        assert replace(project.clip, keypoints=clip.keypoints) == clip
        assert project.log == () and project.last_edit == 0 and project.runs.all() == [] and project.marks.all() == {}
        assert project.undo() is None and project.redo() is None
        with pytest.raises(ValueError, match="read-only"):
            project.detections.xy[0] = 0


def test_edits_come_back_with_undo_and_redo(folder: Path):
    with Project.open(folder) as project:
        first, second, undo = project.log
        assert (first.action, first.author, second.action, second.author) == (BAD, "anna", MOVE, "ben")
        assert [e.id for e in project.log] == [1, 2, 3] and first.time <= second.time <= undo.time
        assert first.time.utcoffset() is not None and project.last_edit == 3
        assert project.undoable == first and project.redoable == second
        assert (project.clip.keypoints.confidence[0, :2] == 0).all() and not project.corrected.edited.any()
        assert project.redo() == second and project.clip.keypoints.xy[2, 4].tolist() == [1 / 3, 2.5]
    with Project.open(folder) as project:
        assert project.undoable == second and project.redoable is None and len(project.log) == 4
        assert project.undo() == second and project.undo() == first and project.undo() is None
        assert same_keypoints(project.clip.keypoints, project.detections)
    with Project.open(folder) as project:
        assert project.redo() == first and project.redoable == second


def test_an_edit_that_makes_no_sense_is_not_in_the_log(folder: Path):
    with Project.open(folder) as project:
        for edit in (MarkBad(frames=(6,), joints=(0,)), MarkBad(frames=(0.5,), joints=(0,))):  # pyright: ignore
            with pytest.raises(InputError):
                project.append(edit)
        assert len(project.log) == 3
    with Project.open(folder) as project:
        assert len(project.log) == 3


def test_what_a_killed_process_left_beside_a_project_is_gone_once_it_is_opened(folder: Path):
    """It was killed right after the project had come to its place."""
    left = folder.with_name(f".{folder.name}.partial")
    left.mkdir()
    (left / "tcfit-draft.lock").touch()
    Project.open(folder, read_only=True).close()
    assert left.exists()
    Project.open(folder).close()
    assert not left.exists()


def test_the_clip_is_made_anew_only_when_it_is_another(folder: Path, tmp_path: Path):
    with Project.open(folder) as project:
        first = project.clip
        assert project.clip is first
        project.append(MOVE)
        moved = project.clip
        assert moved is project.clip and moved.keypoints.xy[2, 4].tolist() == [1 / 3, 2.5]
        project.undo()
        assert same_keypoints(project.clip.keypoints, first.keypoints)
        project.relink(write_video(tmp_path / "walk.mp4"))
        assert project.clip.source is not None and project.clip.source.name == "walk.mp4"


def test_several_threads_may_edit(folder: Path):
    with Project.open(folder) as project, ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda seed: project.append(random_edit(seed), author=str(seed)), range(40)))
        list(pool.map(lambda _: project.undo(), range(10)))
        assert [entry.id for entry in project.log] == list(range(1, 54))
        corrected = project.clip.keypoints
        assert same_keypoints(corrected, applied(project.detections, project.log))
    with Project.open(folder) as project:
        assert same_keypoints(project.clip.keypoints, corrected) and len(project.log) == 53


def test_the_log_is_only_added_to(folder: Path):
    with closing(sqlite3.connect(folder / database.NAME)) as connection:
        for change in ("UPDATE edits SET author = 'x'", "DELETE FROM edits"):
            with pytest.raises(sqlite3.IntegrityError, match="only ever added to"):
                connection.execute(change)


def test_marks_of_limbs_are_kept_beside_those_of_frames(folder: Path):
    with Project.open(folder) as project:
        project.marks.set([3], "flag")
        project.marks.set([2, 3], "checked", limbs=[("left arm",), ("left arm", "head")])
        assert project.marks.all().keys() == {3} and project.marks.states() == {2: "checked", 3: "flag"}
        assert {limb: sorted(of) for limb, of in project.marks.of_limbs().items()} == {"left arm": [2, 3], "head": [3]}
        project.marks.set([3], None, limbs=[("head",)])
        project.marks.set([2], None)
        with pytest.raises(InputError, match="names the limbs of 1 of 2 frames"):
            project.marks.set([1, 2], "checked", limbs=[("head",)])
    with Project.open(folder, read_only=True) as project:
        left = {limb: sorted(of) for limb, of in project.marks.of_limbs().items() if of}
        assert left == {"left arm": [3]} and project.marks.all()[3].state == "flag"


def test_marks(folder: Path):
    with Project.open(folder) as project:
        project.marks.set([3], "flag", author="anna")
        assert project.marks.all()[3].state == "flag" and project.marks.all()[3].author == "anna"
        project.marks.set([5, 3, 4], "checked", author="ben")
        project.marks.set([4, 0], None)
        with pytest.raises(InputError, match="no frame 13; the clip has frames 7 to 12"):
            project.marks.set([1, 6], "flag")
    with Project.open(folder, read_only=True) as project:
        assert [(frame, m.state, m.author) for frame, m in project.marks.all().items()] == [
            (3, "checked", "ben"),
            (5, "checked", "ben"),
        ]


def test_marks_are_undone_and_redone_as_edits_are(folder: Path):
    def states() -> dict[int, str]:
        return {frame: mark.state for frame, mark in project.marks.all().items()}

    with Project.open(folder) as project:
        project.marks.set([3], "flag")
        keypoints = project.clip.keypoints
        fine = project.marks.set([3, 4], "checked")
        project.append(BAD)
        checked = project.marks.all()
        project.undo()
        assert states() == {3: "checked", 4: "checked"}
        assert project.undo() == fine and states() == {3: "flag"}
        assert project.clip.keypoints is keypoints or same_keypoints(project.clip.keypoints, keypoints)
        assert project.redo() == fine and project.marks.all() == checked
        assert still_checked(project.marks.all(), project.frames_changed_after(0)) == {3, 4}, (
            "an undone mark is no change of its frames"
        )
    with Project.open(folder) as project:
        assert states() == {3: "checked", 4: "checked"} and project.undoable == fine
        assert project.standing.differing(3) == 0, "a mark is no correction that a fit would have to follow"


def test_what_came_before_a_mark_is_told_by_no_clock(folder: Path, monkeypatch: pytest.MonkeyPatch):
    class Later(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> Any:
            return datetime.now(tz) + timedelta(hours=1)

    def checked() -> frozenset[int]:
        refitted = [(run.moment, range(2, 6)) for run in project.runs.all() if run.id > 1]
        return still_checked(project.marks.all(), project.frames_changed_after(0), refitted=refitted)

    with Project.open(folder) as project:
        with monkeypatch.context() as patched:
            for module in (project_module, runs_module):
                patched.setattr(module, "datetime", Later)
            project.append(MarkBad(frames=(0,), joints=(0,)))
            begun = project.runs.start(CONFIG, body=BODY, edits_seen=0)
        project.marks.set(range(6), "checked")
        assert checked() == {0, 1, 2, 3, 4, 5}
        project.append(MarkBad(frames=(1,), joints=(0,)))
        assert checked() == {0, 2, 3, 4, 5}
        project.runs.finish(begun.id, sample_fit(1))
        assert checked() == {0}
        project.marks.set(range(6), "checked")
        assert checked() == {0, 1, 2, 3, 4, 5}
        project.runs.delete(begun.id)
        project.runs.purge()
        project.runs.start(CONFIG, body=BODY, edits_seen=0)
        assert checked() == {0, 1}  # though the run with the largest moment is gone
        project.marks.set([4], "checked")
    with Project.open(folder) as project:
        assert project.runs.get(3).state == "interrupted" and checked() == {0, 1}


def test_one_writer_and_any_number_of_readers(folder: Path):
    code = f"""
from pathlib import Path
from tcfit_app.project.project import Project
from tcfit_app.project.storage.lock import ProjectLocked
folder = Path({str(folder)!r})
try:
    Project.open(folder)
except ProjectLocked as error:
    print(error)
with Project.open(folder, read_only=True) as project:
    print(project.read_only, len(project.log), project.runs.load(1).last.phase)
    try:
        project.undo()
    except Exception as error:
        print(type(error).__name__, error)
"""
    with Project.open(folder) as project:
        project.append(BAD)
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        with pytest.raises(ProjectLocked, match="open in another tcfit"):
            Project.open(folder)
        project.append(BAD)
    locked, read, refused = done.stdout.splitlines()
    assert locked == (
        f"{folder}: is open in another tcfit (process {os.getpid()}). Close it there, or open the project read-only."
    )
    assert read == "True 4 3" and refused == f"InputError {database.read_only_refusal(folder)}"
    with Project.open(folder) as project:
        assert len(project.log) == 5


def test_a_reader_changes_nothing(folder: Path):
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    with Project.open(folder, read_only=True) as project:
        calls: list[Callable[[], Any]] = [
            lambda: project.append(BAD),
            project.redo,
            lambda: project.runs.start(CONFIG, body=BODY, edits_seen=0),
            lambda: project.runs.rename(1, "x"),
            lambda: project.runs.delete(1),
            project.runs.purge,
            lambda: project.marks.set([0], "flag"),
            lambda: project.marks.set([0], None),
            lambda: project.relink(folder),
        ]
        for call in calls:
            with pytest.raises(InputError, match="read-only"):
                call()
    assert {p: p.read_bytes() for p in before} == before


V1 = """
CREATE TABLE clip (id INTEGER PRIMARY KEY CHECK (id = 1), name TEXT NOT NULL, created TEXT NOT NULL,
    frame_rate REAL NOT NULL, first_frame INTEGER NOT NULL, camera TEXT NOT NULL, notes TEXT NOT NULL, media TEXT,
    detections_sha256 TEXT NOT NULL);
CREATE TABLE edits (
    id INTEGER PRIMARY KEY AUTOINCREMENT, time TEXT NOT NULL, author TEXT NOT NULL, action TEXT NOT NULL);
CREATE TRIGGER edits_no_update BEFORE UPDATE ON edits BEGIN SELECT RAISE(ABORT, 'only ever added to'); END;
CREATE TRIGGER edits_no_delete BEFORE DELETE ON edits BEGIN SELECT RAISE(ABORT, 'only ever added to'); END;
CREATE TABLE runs (id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, state TEXT NOT NULL, config TEXT NOT NULL,
    body TEXT NOT NULL, parent INTEGER, first_frame INTEGER, last_frame INTEGER, edits_seen INTEGER NOT NULL,
    started TEXT NOT NULL, ended TEXT, summary TEXT, message TEXT NOT NULL DEFAULT '', deleted TEXT);
PRAGMA user_version = 1;
PRAGMA application_id = 1952671348;
"""
"""The tables of version 1, as projects of that version have them: never to be changed."""


def as_version_1(folder: Path) -> None:
    """Replace a project's database by one of version 1, written out here, with the same clip, edits and runs."""
    path = folder / database.NAME
    with closing(sqlite3.connect(path)) as new:
        rows = {name: new.execute(f"SELECT * FROM {name}").fetchall() for name in ("clip", "edits", "runs")}
    path.unlink()
    with closing(sqlite3.connect(path)) as old, old:
        old.executescript(V1)
        for name, content in rows.items():
            columns = len(old.execute(f"PRAGMA table_info({name})").fetchall())  # later ones were added at the end
            content = [row[:columns] for row in content]
            old.executemany(f"INSERT INTO {name} VALUES ({','.join('?' * columns)})", content)


@pytest.mark.parametrize("wal", [False, True])
def test_a_project_of_version_1_is_brought_to_the_present(folder: Path, wal: bool):
    as_version_1(folder)
    if wal:
        with closing(sqlite3.connect(folder / database.NAME)) as connection:
            connection.execute("PRAGMA journal_mode = WAL")
    old = (folder / database.NAME).read_bytes()
    with Project.open(folder, read_only=True) as project:
        assert [e.action for e in project.log[:2]] == [BAD, MOVE] and project.marks.all() == {}
        assert_same_fit(project.runs.load(1), sample_fit(1))
        with pytest.raises(InputError, match="read-only"):
            project.marks.set([1], "checked")
    assert (folder / database.NAME).read_bytes() == old
    with Project.open(folder) as project:
        assert [e.action for e in project.log[:2]] == [BAD, MOVE] and project.undoable == project.log[0]
        assert_same_fit(project.runs.load(1), sample_fit(1))
        assert project.marks.all() == {}
        project.marks.set([1], "checked")
    with Project.open(folder, read_only=True) as project:
        assert list(project.marks.all()) == [1]


def _days(frames: dict[int, int]) -> list[tuple[int, str]]:
    return [(frame, f"2024-01-{day:02}T00:00:00+00:00") for frame, day in frames.items()]


def test_marks_of_version_3_know_what_came_before_them(folder: Path):
    as_version_1(folder)
    with closing(sqlite3.connect(folder / database.NAME)) as connection, connection:
        for migration in MIGRATIONS[1:3]:
            migration(connection)
        connection.execute("PRAGMA user_version = 3")
        connection.execute("DROP TRIGGER edits_no_update")
        for entry, time in _days({1: 10, 2: 20, 3: 30}):
            connection.execute("UPDATE edits SET time = ? WHERE id = ?", (time, entry))
        connection.execute(
            "INSERT INTO runs SELECT 2, * FROM (SELECT name, state, config, body, parent, first_frame,"
            " last_frame, edits_seen, started, ended, summary, message, deleted, kind FROM runs)"
        )
        for run, time in _days({1: 25, 2: 15}):
            connection.execute("UPDATE runs SET ended = ? WHERE id = ?", (time, run))
        for frame, time in _days({0: 9, 1: 10, 2: 16, 3: 29, 4: 31}):
            connection.execute("INSERT INTO marks VALUES (?, 'checked', '', ?, 'me')", (frame, time))
    with Project.open(folder) as project:
        known = [(mark.last_edit, mark.last_moment) for mark in project.marks.all().values()]
        assert known == [(0, 0), (1, 0), (1, 1), (2, 2), (3, 2)]
        assert [run.moment for run in project.runs.all()] == [2, 1]


def test_a_migration_that_fails_leaves_the_project_as_it_was(folder: Path, monkeypatch: pytest.MonkeyPatch):
    with Project.open(folder) as project:
        project.marks.set([3], "flag")

    def fails(connection: sqlite3.Connection) -> None:
        connection.execute("DROP TABLE marks")
        raise sqlite3.OperationalError("the disk went away")

    with monkeypatch.context() as patch:
        patch.setattr(database, "MIGRATIONS", (*MIGRATIONS, fails))
        with pytest.raises(InputError):
            Project.open(folder)
    with Project.open(folder) as project:
        assert list(project.marks.all()) == [3]


def test_a_newer_project_is_refused_untouched(folder: Path):
    with closing(sqlite3.connect(folder / database.NAME)) as connection:
        connection.execute("PRAGMA user_version = 99")
    for read_only in (False, True):
        said = rf"version 99, but this tcfit supports versions up to {len(MIGRATIONS)}\..*update tcfit"
        with pytest.raises(InputError, match=said):
            Project.open(folder, read_only=read_only)
    with closing(sqlite3.connect(folder / database.NAME)) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (99,)


def _overwrite(at: int, count: int = 4096) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        content = bytearray(path.read_bytes())
        content[at : at + count] = np.random.default_rng(0).bytes(count)
        path.write_bytes(content)

    return damage


def _execute(*statements: str) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        with closing(sqlite3.connect(path)) as connection, connection:
            for statement in ("DROP TRIGGER edits_no_update", "DROP TRIGGER edits_no_delete", *statements):
                connection.execute(statement)

    return damage


def _other_program(path: Path) -> None:
    path.unlink()
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE songs (title)")


DAMAGE: dict[str, tuple[Callable[[Path], None], str]] = {
    "header": (_overwrite(0), "is damaged"),
    "a page": (_overwrite(4096), "is damaged"),
    "cut off": (lambda path: path.write_bytes(path.read_bytes()[:5000]), "is damaged"),
    "empty": (lambda path: path.write_bytes(b""), "another program's database"),
    "another program's": (_other_program, "another program's database"),
    "no clip": (_execute("DELETE FROM clip"), "has no clip:"),
    "table gone": (_execute("DROP TABLE edits"), r"is damaged \(no such table: edits\)"),
}


@pytest.mark.parametrize("read_only", [False, True])
@pytest.mark.parametrize(("damage", "message"), DAMAGE.values(), ids=DAMAGE)
def test_damage_is_reported(damage: Callable[[Path], None], message: str, read_only: bool, folder: Path):
    damage(folder / database.NAME)
    with pytest.raises(InputError, match=message) as error:
        Project.open(folder, read_only=read_only)
    assert str(folder / database.NAME) in str(error.value)
    # And the lock is free again.
    with pytest.raises(InputError, match=message):
        Project.open(folder, read_only=read_only)


@pytest.mark.parametrize("read_only", [False, True])
def test_what_cannot_be_opened_where_it_lies_is_to_be_copied(folder: Path, read_only: bool):
    """As a project that a crash left, in a folder where nothing may be written: SQLite can make no file beside it."""
    with closing(sqlite3.connect(folder / database.NAME)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("UPDATE clip SET name = 'run'")
        connection.commit()
        left = {ending: (folder / f"{database.NAME}{ending}").read_bytes() for ending in ("", "-wal")}
    for ending, content in left.items():
        (folder / f"{database.NAME}{ending}").write_bytes(content)
    (folder / f"{database.NAME}-shm").symlink_to(folder / "nowhere" / "x")
    with pytest.raises(InputError, match="copy that folder to a writable place, and open the copy"):
        Project.open(folder, read_only=read_only)
    (folder / f"{database.NAME}-shm").unlink()
    shutil.copytree(folder, folder.with_name("copy"))
    with Project.open(folder.with_name("copy"), read_only=read_only) as project:
        assert project.clip.name == "run"


def test_detections_are_never_changed(folder: Path):
    path = folder / "detections.npz"
    before = path.read_bytes()
    with Project.open(folder) as project:
        for seed in range(20):
            project.append(random_edit(seed))
    assert path.read_bytes() == before
    _overwrite(300, 10)(path)
    with pytest.raises(InputError, match=r"detections\.npz: was changed after the project was created"):
        Project.open(folder)
    path.unlink()
    with pytest.raises(InputError, match=r"detections\.npz: cannot be read"):
        Project.open(folder)


XY, CONFIDENCE = np.zeros((6, COUNT, 2)), np.zeros((6, COUNT))


def _npz(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def _declared(frames: int) -> bytes:
    """Arrays that say that they have so many frames, and have none."""
    file, header = io.BytesIO(), io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (frames, COUNT, 2)}
    np.lib.format.write_array_header_1_0(header, shape)
    with zipfile.ZipFile(file, "w") as archive:
        for name in ("xy", "confidence"):
            archive.writestr(f"{name}.npy", header.getvalue())
    return file.getvalue()


MADE_UP: dict[str, tuple[bytes, str]] = {
    "objects": (_npz(xy=np.array([{}], dtype=object), confidence=CONFIDENCE), "xy.*Python objects"),
    "texts": (_npz(xy=XY.astype(str), confidence=CONFIDENCE), "xy is <U32"),
    "other keypoints": (_npz(xy=XY[:, :5], confidence=CONFIDENCE), r"xy .* the shape \(6, 5, 2\)"),
    "a number": (_npz(xy=XY, confidence=np.array(1.0)), r"confidence .* the shape \(\)"),
    "not finite": (_npz(xy=XY + np.nan, confidence=CONFIDENCE), "xy has values that are not finite"),
    "sure": (_npz(xy=XY, confidence=CONFIDENCE + 7), "a confidence is not between 0 and 1"),
    "fewer": (_npz(xy=XY, confidence=CONFIDENCE[1:]), "6 frames of positions but 5 of confidences"),
    "no frames": (_npz(xy=XY[:0], confidence=CONFIDENCE[:0]), "0 frames of positions"),
    "a number for a name": (_npz(xy=XY, confidence=CONFIDENCE, detector=XY), "detector is float64 .* expected a name"),
    "a long name": (_npz(xy=XY, confidence=CONFIDENCE, detector=np.array("x" * 101)), "detector is <U101 .* a name"),
    "one array": (_npz(xy=XY), "'confidence'"),
    "197 TB": (_declared(10**11), "declares the shape"),
    "no archive": (b"PK" * 100, "not a complete npz archive"),
    "cut off": (_npz(xy=XY, confidence=CONFIDENCE)[:3000], "not a complete npz archive"),
}


def test_detections_of_earlier_versions_do_not_say_whose_they_are(folder: Path):
    content = _npz(xy=XY, confidence=CONFIDENCE)
    (folder / "detections.npz").write_bytes(content)
    with closing(sqlite3.connect(folder / database.NAME)) as connection, connection:
        connection.execute("UPDATE clip SET detections_sha256 = ?", (hashlib.sha256(content).hexdigest(),))
    with Project.open(folder) as project:
        assert project.clip.detector == "" and len(project.detections) == 6 and not project.damage


@pytest.mark.parametrize("detector", ["mediapipe", "a detector of a plugin's, 检测", "x" * 200])
def test_whose_keypoints_they_are_stays(tmp_path: Path, detector: str):
    with Project.create(tmp_path / "walk", replace(sample_clip(), detector=detector)) as project:
        assert project.clip.detector == detector[:100]
    with Project.open(tmp_path / "walk", read_only=True) as project:
        assert project.clip.detector == detector[:100]


@pytest.mark.parametrize(("content", "words"), MADE_UP.values(), ids=MADE_UP)
def test_detections_that_somebody_made_up(folder: Path, content: bytes, words: str):
    (folder / "detections.npz").write_bytes(content)
    with closing(sqlite3.connect(folder / database.NAME)) as connection, connection:
        connection.execute("UPDATE clip SET detections_sha256 = ?", (hashlib.sha256(content).hexdigest(),))
    for read_only in (False, True):
        with pytest.raises(InputError, match=rf"detections\.npz: cannot be read .*{words}"):
            Project.open(folder, read_only=read_only)


def test_detections_that_could_not_be_read_back_are_not_stored(tmp_path: Path):
    clip = sample_clip()
    keypoints = replace(clip.keypoints, confidence=clip.keypoints.confidence * 2)
    with pytest.raises(InputError, match="Cannot store these keypoints: a confidence is not between 0 and 1"):
        Project.create(tmp_path / "a.tcfit", replace(clip, keypoints=keypoints))
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_project(tmp_path: Path):
    for path in (tmp_path, tmp_path / "nothing"):
        with pytest.raises(InputError, match="not a tcfit project"):
            Project.open(path)
    assert list(tmp_path.iterdir()) == []


def test_a_project_is_made_in_an_empty_folder_only(folder: Path, tmp_path: Path):
    with pytest.raises(InputError, match="is already a project"):
        Project.create(folder, sample_clip())
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(InputError, match=r"contains other files \(thesis.tex\)"):
        Project.create(tmp_path / "full", sample_clip())
    with pytest.raises(InputError, match="is a file; expected a folder"):
        Project.create(tmp_path / "full" / "thesis.tex", sample_clip())
    (tmp_path / "empty").mkdir()
    Project.create(tmp_path / "empty", sample_clip()).close()
    assert not [p.name for p in tmp_path.iterdir() if "partial" in p.name]


def test_names_lead_nowhere(tmp_path: Path):
    inside = tmp_path / "inside"
    for number, name in enumerate(("../../clip", "/etc/clip", "..", "a\0b\nc", "\ud800", "")):
        with Project.create(inside / str(number), replace(sample_clip(), name=name)) as project:
            assert project.clip.name.isprintable() and project.clip.name
            for text in ("../../run", "/etc/run", "C:\\run", "."):
                run = project.runs.start(CONFIG, body=BODY, edits_seen=0, name=text)
                project.runs.finish(run.id, sample_fit(0))
                project.runs.rename(run.id, f"{text}/x")
                assert project.runs.get(run.id).name == f"{text}/x"
            for text in ("", " ", "a\nb", "a\0b", "\ud800", "x" * 201):
                with pytest.raises(InputError, match="cannot be a name; expected one line of 1 to 200 characters"):
                    project.runs.rename(1, text)
    assert [p.name for p in tmp_path.iterdir()] == ["inside"]
    files = {p.relative_to(inside).as_posix() for p in inside.rglob("*.npz")}
    runs = {f"{project}/runs/{run:06d}.npz" for project in range(6) for run in range(1, 5)}
    assert files == runs | {f"{project}/detections.npz" for project in range(6)}


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "films" / "walk.mp4"
    path.parent.mkdir()
    return write_video(path)


def test_a_linked_video_is_found_again(tmp_path: Path, video: Path):
    here = tmp_path / "here"
    Project.create(here / "walk.tcfit", replace(sample_clip(), source=video)).close()
    with Project.open(here / "walk.tcfit") as project:
        assert project.clip.source == video.resolve() or project.clip.source.samefile(video)  # pyright: ignore
        assert project.media.problem == ""
    # Moved together, the relative path counts; the project alone, the absolute one.
    (tmp_path / "there").mkdir()
    shutil.move(here, tmp_path / "there" / "here")
    shutil.copytree(video.parent, tmp_path / "there" / "films")
    moved = tmp_path / "there" / "here" / "walk.tcfit"
    with Project.open(moved) as project:
        assert project.media.path and project.media.path.samefile(tmp_path / "there" / "films" / "walk.mp4")
    shutil.rmtree(tmp_path / "there" / "films")
    with Project.open(moved) as project:
        assert project.media.path and project.media.path.samefile(video)
    video.write_bytes(b"another film")
    with Project.open(moved) as project:
        assert "differs from what the project was created with" in project.media.problem
    video.unlink()
    with Project.open(moved) as project:
        assert project.media.path is None and "no longer there" in project.media.problem
        assert project.clip.source is None
        other = tmp_path / "other.mp4"
        project.relink(write_video(other, seed=1))
        assert project.clip.source and project.clip.source.samefile(other)
        with pytest.raises(InputError, match="cannot be read"):
            project.relink(tmp_path / "nothing.mp4")
        with pytest.raises(InputError, match="not a video"):
            project.relink(project.folder / database.NAME)
        os.mkfifo(tmp_path / "pipe.mp4")
        with pytest.raises(InputError, match="neither a file nor a folder"):
            project.relink(tmp_path / "pipe.mp4")
        assert project.clip.source and project.clip.source.samefile(other)
    with Project.open(moved) as project:
        assert project.clip.source and project.clip.source.samefile(other) and not project.media.problem


@pytest.mark.parametrize("read_only", [False, True])
@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("/nowhere/walk.mp4", "is no longer there"),
        ("/private/walk.mp4", r"cannot be accessed \(Permission denied\)"),
        ("/" + 300 * "x", "cannot be accessed"),
        ("a\0b", "cannot be accessed"),
    ],
)
def test_a_video_that_may_not_be_looked_for_keeps_no_project_closed(
    folder: Path, place: str, words: str, read_only: bool, monkeypatch: pytest.MonkeyPatch
):
    link = media.MediaLink(relative=f"..{place}", absolute=place, fingerprint="")
    with closing(sqlite3.connect(folder / database.NAME)) as connection, connection:
        connection.execute("UPDATE clip SET media = ?", (msgspec.json.encode(link).decode(),))
    look = os.stat

    def stat(path: Any, *args: Any, **named: Any) -> os.stat_result:
        if "private" in str(path):
            raise PermissionError(errno.EACCES, "Permission denied")
        return look(path, *args, **named)

    monkeypatch.setattr(os, "stat", stat)
    with Project.open(folder, read_only=read_only) as project:
        assert project.clip.source is None and re.search(f"{words}.*Relink", project.media.problem)


def test_a_fingerprint_sees_another_start_middle_end_and_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("fitting_core.video.fingerprint._BLOCK", 10)
    content = bytearray(1000)
    seen = set()
    for change in (None, 0, 500, 999):
        changed = bytearray(content)
        if change is not None:
            changed[change] = 1
        path = tmp_path / "film"
        path.write_bytes(changed)
        seen.add(media.fingerprint(path))
    path.write_bytes(content + b"\0")
    seen.add(media.fingerprint(path))
    assert len(seen) == 5


def test_a_file_system_without_locks_is_no_other_tcfit(folder: Path, monkeypatch: pytest.MonkeyPatch):
    def refused(descriptor: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(locking, "_lock", refused)
    with pytest.raises(InputError, match=r"cannot be locked \(No locks available\)") as told:
        Project.open(folder)
    assert not isinstance(told.value, ProjectLocked)
    Project.open(folder, read_only=True).close()


# --- transactions ---


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Database]:
    Database.create(tmp_path / NAME)
    made = Database(tmp_path / NAME, read_only=False)
    yield made
    made.close()


def test_threads_wait_for_the_end_of_a_transaction(store: Database):
    """Else one would begin inside another's, and read or roll back what that one has not finished."""
    insert = "INSERT INTO edits (time, author, action) VALUES ('', '', '')"

    def other() -> int:
        with store.transaction() as connection:
            connection.execute(insert)
        return len(store.rows("SELECT id FROM edits"))

    with ThreadPoolExecutor(2) as pool:
        with pytest.raises(KeyboardInterrupt), store.transaction() as connection:
            connection.execute(insert)
            began, seen = pool.submit(other), pool.submit(store.rows, "SELECT id FROM edits")
            for waiting in (began, seen):
                with pytest.raises(TimeoutError):
                    waiting.result(0.1)
            raise KeyboardInterrupt
        assert began.result(30) == 1 and len(seen.result(30)) <= 1
