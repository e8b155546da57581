"""What is said of a clip and its frames, and who has a project open."""

import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.project.edits.edit_log import NOTE_CHARACTERS, WriteNote
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.glance import glance, stamp
from tcfit_app.project.project import Project
from tcfit_app.project.storage import database
from tcfit_app.project.storage.clip_review import Worst, reviewed
from tcfit_app.project.storage.lock import ProjectLock, ProjectLocked, holder
from tests.samples.project_samples import CONFIG, sample_clip
from tests.samples.waving import waving_fit, waving_project


@pytest.fixture(scope="module")
def waving(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Path:
    return waving_project(tmp_path_factory.mktemp("waving") / "walk.tcfit", free_body)


@pytest.fixture
def folder(waving: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(waving, tmp_path / "walk.tcfit"))


def test_states_come_one_after_the_other(tmp_path: Path, free_body: BodyModel):
    folder = tmp_path / "new.tcfit"
    Project.create(folder, sample_clip()).close()
    assert glance(folder).state == "new"
    waving_project(tmp_path / "walk.tcfit", free_body)
    folder = tmp_path / "walk.tcfit"
    assert glance(folder).state == "fitted"
    for author, reviewer in (("bert", "bert"), ("browser 1a2b3c4d", "")):
        with Project.open(folder) as project:
            project.append(MarkBad(frames=(1,), joints=(3,)), author=author)
        assert (glance(folder).state, glance(folder).review.reviewer) == ("in review", reviewer)
    with reviewed(folder) as review:
        review.approve("anna")
    seen = glance(folder)
    assert (seen.state, seen.review.reviewer) == ("approved", "anna")
    with reviewed(folder) as review:
        review.withdraw()
    assert glance(folder).state == "in review"


def test_an_approval_ends_with_another_edit_and_another_run_but_not_with_remarks(folder: Path):
    with Project.open(folder) as project:
        project.review.approve("anna")
        project.append(WriteNote(frames=(1,), text="hand hidden"))
        project.marks.set([2], "checked")
        project.undo()
        assert project.review.now.state(fitted=True) == "approved"
        project.append(MarkBad(frames=(1,), joints=(3,)))
        assert project.review.now.altered and project.review.now.state(fitted=True) == "in review"
        project.undo()  # it is as it was, but somebody has to look: what followed the edit may not be
        assert project.review.now.altered
        project.review.approve("bert")
        assert not project.review.now.altered
        run = project.runs.start(CONFIG, body=project.runs.get(1).body, edits_seen=project.last_edit)
        project.runs.finish(run.id, waving_fit(1.0))
        assert project.review.now.altered
    seen = glance(folder)
    assert (seen.state, seen.review.altered, seen.notes) == ("in review", True, 1)


def test_what_is_said_stays_and_goes_with_copies(folder: Path, tmp_path: Path):
    worst = Worst(run=2, left=3, score=2.5, frame=4, words="left wrist is 42 px off")
    with Project.open(folder) as project:
        project.review.set_note("  hands\n hidden ")
        project.review.set_worst(worst)
    copied = Path(shutil.copytree(folder, tmp_path / "copy.tcfit"))
    assert (glance(copied).review.note, glance(copied).review.worst) == ("hands hidden", worst)


def test_a_glance_leaves_nothing_behind_and_changes_nothing(folder: Path):
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    mark = stamp(folder)
    seen = glance(folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before
    assert stamp(folder) == mark
    assert (seen.name, seen.frames, seen.fit, seen.first_frame) == ("walk", 6, 2, 7)


def test_a_glance_of_a_project_of_the_first_version(tmp_path: Path, folder: Path):
    with closing(sqlite3.connect(folder / database.NAME)) as connection, connection:
        connection.execute("DROP TABLE review")
        for column in ("runs.kind", "runs.moment", "runs.given", "clip.height", "marks.last_edit", "marks.last_moment"):
            connection.execute("ALTER TABLE {} DROP COLUMN {}".format(*column.split(".")))
        connection.execute("PRAGMA user_version = 2")
    assert (glance(folder).state, glance(folder).fit) == ("fitted", 2)


def test_a_damaged_project_is_told(folder: Path):
    path = folder / database.NAME
    for content in (path.read_bytes()[:5000], b"nonsense" * 1000):
        path.write_bytes(content)
        with pytest.raises(InputError, match="is damaged"):
            glance(folder)


def test_a_clip_without_readable_keypoints_has_no_length(folder: Path):
    for content in (b"", b"PK\x03\x04" + bytes(100), b"x" * 5000):
        (folder / "detections.npz").write_bytes(content)
        assert glance(folder).frames == 0


def test_who_works_is_known_until_the_project_is_closed(folder: Path):
    assert holder(folder) is None
    with Project.open(folder) as project:
        assert holder(folder).process == str(os.getpid())  # pyright: ignore[reportOptionalMemberAccess]
        project.tell_who_works("anna, bert")
        found = glance(folder).holder
        assert found is not None and found.names == "anna, bert"
        with pytest.raises(ProjectLocked, match=rf"process {os.getpid()}, by anna, bert"):
            Project.open(folder)
        with pytest.raises(ProjectLocked), reviewed(folder):
            pass
    assert holder(folder) is None and glance(folder).holder is None


def test_who_was_killed_is_forgotten(folder: Path):
    code = f"""
from pathlib import Path
from tcfit_app.project.storage.lock import ProjectLock
import os
held = ProjectLock(Path({str(folder)!r}))
held.tell("anna")
os._exit(9)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 9
    assert (folder / "project.lock").stat().st_size > 0
    assert holder(folder) is None
    ProjectLock(folder).release()


def test_lists_need_no_torch():
    code = "import sys, tcfit_app.home.catalogue, tcfit_app.home.pictures; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


# --- notes on frames ---


def texts(project: Project) -> list[tuple[range, str]]:
    return [(note.frames, note.text) for note in project.notes]


def test_notes_are_kept_in_the_order_of_their_frames(project: Project):
    late = project.append(WriteNote(frames=(3, 4), text="late"), author="me")
    project.append(WriteNote(frames=(1,), text="early"), author="me")
    assert texts(project) == [(range(1, 2), "early"), (range(3, 5), "late")]
    project.append(WriteNote(frames=(3, 4), text="later", replaces=late.id), author="you")
    assert texts(project) == [(range(1, 2), "early"), (range(3, 5), "later")]
    assert (project.notes[1].author, project.notes[0].author) == ("you", "me")
    assert project.notes[1].id == late.id
    project.append(WriteNote(frames=(3, 4), text="last", replaces=late.id), author="me")
    project.append(WriteNote(frames=(3, 4), text="", replaces=late.id), author="me")
    assert texts(project) == [(range(1, 2), "early")]
    with pytest.raises(InputError, match="no longer exists"):
        project.append(WriteNote(frames=(3, 4), text="again", replaces=late.id), author="me")


def test_undo_and_redo_go_through_them(project: Project):
    first = project.append(WriteNote(frames=(1,), text="one"), author="me")
    project.append(WriteNote(frames=(1,), text="", replaces=first.id), author="me")
    assert not project.notes
    project.undo(author="me")
    assert texts(project) == [(range(1, 2), "one")]
    project.redo(author="me")
    project.undo(author="me")
    project.undo(author="me")
    assert not project.notes


def test_they_are_there_when_it_is_opened_again(project: Project):
    folder = project.folder
    project.append(WriteNote(frames=(2,), text="a  text <b>of</b>\ntwo lines"), author="me")
    project.close()
    with Project.open(folder) as again:
        assert texts(again) == [(range(2, 3), "a  text <b>of</b>\ntwo lines")]


@pytest.mark.parametrize(
    ("note", "message"),
    [
        (WriteNote(frames=(1,), text=""), "is empty"),
        (WriteNote(frames=(), text="x"), "must be on one frame"),
        (WriteNote(frames=(1, 3), text="x"), "consecutive frames"),
        (WriteNote(frames=(999,), text="x"), "no frame 1006; the clip has frames 7 to 12"),
        (WriteNote(frames=(1,), text="x" * (NOTE_CHARACTERS + 1)), "2,001 characters; expected 2,000 at most"),
        (WriteNote(frames=(1,), text="x", replaces=77), "no longer exists"),
    ],
)
def test_senseless_notes_are_refused(project: Project, note: WriteNote, message: str):
    with pytest.raises(InputError, match=message):
        project.append(note, author="me")
    assert not project.notes and project.last_edit == 0
