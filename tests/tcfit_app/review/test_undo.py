"""Undo brings the fit back that was on show before the edit, bit for bit; and redo the one after it."""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.files.npz import read_npz, write_npz
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting import edit_follower
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import MarkBad, MoveKeypoint, Nudge, SetDepth
from tcfit_app.project.project import Project
from tcfit_app.project.storage.changes import Frames
from tcfit_app.project.storage.run_files import write_run
from tcfit_app.review.session.session import Session
from tests.samples.project_samples import FRAMES as EDITED
from tests.samples.project_samples import assert_same_fit, random_edit
from tests.samples.sessions import FRAMES, QUICK, held, idle, newest, session_of, told, until

WRIST = kp.INDEX["right_wrist"]


@pytest.fixture
def folder(fitted_walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(edit_follower, "SETTLING", 0.0)
    return Path(shutil.copytree(fitted_walk, tmp_path / "walk.tcfit"))


@pytest.fixture
def session(folder: Path, tiny_body: BodyModel) -> Iterator[Session]:
    with session_of(folder, tiny_body) as made:
        yield made


def on_show(session: Session) -> FitResult:
    return session.fits.fit(newest(session).run)


def nudge(session: Session, frame: int) -> None:
    session.edit(Nudge(frames=(frame,), joints=(WRIST,), by=(25.0, 0.0)), author="me", shown=newest(session))


def drag(session: Session, frame: int, by: float) -> None:
    shown = newest(session)
    xy = session.project.corrected.xy[frame, [WRIST]] + by
    begun = session.edit_follower.begin_drag(shown, frame, (WRIST,), xy)
    edit = MoveKeypoint(frames=(frame,), joints=(WRIST,), xy=((tuple(xy[0].tolist()),),))
    session.release(begun, edit, author="me", shown=shown)


def drag_in_depth(session: Session, frame: int, to: float) -> None:
    shown = newest(session)
    begun = session.edit_follower.begin_drag(shown, frame, (WRIST,), np.array([to]), in_depth=True)
    session.release(begun, SetDepth(frames=(frame,), joints=(WRIST,), depth=((to,),)), author="me", shown=shown)


def undo(session: Session) -> None:
    assert session.undo(author="me", shown=newest(session)) is not None


def redo(session: Session) -> None:
    assert session.redo(author="me", shown=newest(session)) is not None


def edit_at_random(session: Session, rng: np.random.Generator) -> None:
    """Drags in the image and in depth, and every kind of edit."""
    kind, frame = rng.integers(12), int(rng.integers(FRAMES))
    if kind < 2:
        drag(session, frame, float(rng.normal(0, 40)))
    elif kind < 4:
        drag_in_depth(session, frame, float(rng.uniform(-0.5, 0.5)))
    else:
        session.edit(random_edit(int(rng.integers(10_000))), author="me", shown=newest(session))


def walk(session: Session, steps: int, seed: int) -> None:
    """Random edits, undos and redos, and every fit beside the one that was there when the same edits stood."""
    rng, length = np.random.default_rng(seed), EDITED
    assert length <= FRAMES
    fits, at = [on_show(session)], 0
    for _ in range(steps):
        step = rng.random()
        if step < 0.3 and at > 0:
            undo(session)
            at -= 1
        elif step < 0.45 and at < len(fits) - 1:
            redo(session)
            at += 1
        else:
            edit_at_random(session, rng)
            at += 1
            idle(session)
            fits[at:] = [on_show(session)]
        idle(session)
        assert_same_fit(on_show(session), fits[at])
    while at > 0:
        undo(session)
        at -= 1
        idle(session)
        assert_same_fit(on_show(session), fits[at])
    assert not [notice for notice in told(session) if notice.kind == "error"]


def hurry(session: Session, steps: int, seed: int) -> None:
    """The same without waiting for the fit, which may be anywhere then: in the end it is what it was."""
    rng, before = np.random.default_rng(seed), on_show(session)
    for _ in range(steps):
        if rng.random() < 0.3 and session.project.undoable is not None:
            undo(session)
        elif rng.random() < 0.2 and session.project.redoable is not None:
            redo(session)
        else:
            edit_at_random(session, rng)
        if rng.random() < 0.5:
            session.take_news()
    while session.project.undoable is not None:
        undo(session)
    idle(session)
    assert_same_fit(on_show(session), before)
    assert not [notice for notice in told(session) if notice.kind == "error"]


def test_some_random_edits_are_undone_and_redone(session: Session):
    walk(session, 12, seed=1)


def test_some_random_edits_are_undone_before_the_fit_has_followed(session: Session):
    hurry(session, 12, seed=2)


@pytest.mark.slow
def test_a_thousand_random_edits_are_undone_and_redone(session: Session):
    walk(session, 1000, seed=3)


@pytest.mark.slow
def test_a_thousand_random_edits_are_undone_before_the_fit_has_followed(session: Session):
    hurry(session, 1000, seed=4)


def test_corrections_are_hidden_once_all_are_undone(session: Session, folder: Path, tiny_body: BodyModel):
    drag(session, 4, 40.0)
    idle(session)
    corrected = newest(session)
    other = session.rerun_frames(corrected, QUICK, (range(2),))
    idle(session)
    shown = FitChoice(run=corrected.run.id)
    session.undo(author="me", shown=corrected)
    idle(session)
    assert [run.name for run in session.fits.runs] == ["Fit 1", other.name]
    now = session.fits.show(shown)
    assert now is not None and now.run.id == corrected.run.parent, "not the newest"
    session.redo(author="me", shown=now)
    idle(session)
    again = session.fits.show(shown)
    assert again is not None and again.run.id == corrected.run.id and not again.run.deleted
    assert_same_fit(session.fits.fit(again.run), session.project.runs.load(corrected.run.id))
    session.undo(author="me", shown=again)
    idle(session)
    edit = Nudge(frames=(1,), joints=(WRIST,), by=(25.0, 0.0))
    session.edit(edit, author="me", shown=session.fits.show(shown))
    idle(session)
    assert [run.id for run in session.fits.runs if run.kind == "corrections"] == [corrected.run.id], "used again"
    assert not session.project.runs.all(deleted=True)


def test_a_drag_in_depth_is_taken_back(session: Session):
    """What is fitted anew to the detections alone would stay in the minimum that the drag has led to."""
    before = on_show(session)
    drag_in_depth(session, 4, 0.6)
    idle(session)
    assert not np.array_equal(on_show(session).last.frame_cost, before.last.frame_cost)
    undo(session)
    idle(session)
    assert_same_fit(on_show(session), before)
    assert session.edits_since(newest(session).run) == 0


def test_an_undo_does_not_wait_for_a_long_fit(session: Session):
    before = on_show(session)
    drag(session, 4, 40.0)
    idle(session)
    with held(session):
        undo(session)
        until(session, lambda: not session.edit_follower.busy)
        assert_same_fit(on_show(session), before)


def test_a_restart_in_between_changes_nothing(folder: Path, tiny_body: BodyModel):
    with session_of(folder, tiny_body) as session:
        fits = [on_show(session)]
        for frame in (1, 5):
            drag(session, frame, 30.0)
            idle(session)
            fits.append(on_show(session))
    for back in (True, True, False):
        with session_of(folder, tiny_body) as session:
            (undo if back else redo)(session)
            idle(session)
            wanted = fits[1] if session.project.undoable is not None else fits[0]
            assert_same_fit(on_show(session), wanted)


def test_what_was_followed_together_is_followed_again_without_what_was_undone(session: Session):
    before = on_show(session)
    with held(session):
        nudge(session, 0)
        nudge(session, 7)
        session.take_news()
    idle(session)
    both = on_show(session)
    undo(session)
    idle(session)
    one = on_show(session).last.params.body_pose
    assert not np.array_equal(one[0], before.last.params.body_pose[0])
    assert np.array_equal(one[7], before.last.params.body_pose[7])
    redo(session)
    idle(session)
    assert_same_fit(on_show(session), both)
    undo(session)
    undo(session)
    idle(session)
    assert_same_fit(on_show(session), before)


def test_an_edit_that_was_not_followed_leaves_the_fit_alone_when_it_is_undone(session: Session):
    before = newest(session)
    session.edit_follower.after_edits = False
    nudge(session, 4)
    session.edit_follower.after_edits = True
    undo(session)
    idle(session)
    assert newest(session).revision == before.revision


def test_undoing_what_a_whole_fit_was_made_with_is_followed(session: Session):
    session.edit(MarkBad(frames=(4,), joints=(WRIST,)), author="me")
    session.fit_everything(QUICK, kind="smplx", gender="neutral")
    idle(session)
    before = on_show(session)
    undo(session)
    idle(session)
    assert newest(session).run.kind == "corrections"
    assert not np.array_equal(on_show(session).last.params.body_pose[4], before.last.params.body_pose[4])
    assert session.edits_since(newest(session).run) == 0


def test_a_change_that_is_damaged_is_followed_as_any_other_edit(folder: Path, tiny_body: BodyModel):
    with session_of(folder, tiny_body) as session:
        drag(session, 4, 40.0)
        idle(session)
        after = on_show(session)
        changes = folder / "runs" / "000002"
    (file,) = changes.glob("*.npz")
    file.write_bytes(file.read_bytes()[:-100])
    with session_of(folder, tiny_body) as session:
        undo(session)
        idle(session)
        assert not np.array_equal(on_show(session).last.params.body_pose[4], after.last.params.body_pose[4])
        assert session.edits_since(newest(session).run) == 0


def as_earlier(folder: Path, *, undone: bool) -> None:
    """Store run 2 and its only change as earlier versions did: the change in the run's file, and what it replaced in
    the folder; after an undo the other way round, and the run marked as deleted."""
    with Project.open(folder) as project:
        changes, run = project.runs.changes(2), project.runs.get(2)
        (change,) = changes.standing()
        with_change, without = (project.runs.load(2, at) for at in (None, 0))
        inside, beside = (without, with_change) if undone else (with_change, without)
        seen = change.about.edits_seen if undone else 0
        frames = Frames.of(beside, tuple(range(*window) for window in change.about.windows), seen)
        changes.forget([change])
        changes.add(frames, seen=change.about.seen, edits=change.about.edits)
        write_run(folder / "runs" / "000002.npz", inside)
        project.runs._update(2, moment=False, deleted=run.started.isoformat() if undone else None)
        if undone:
            project.undo(author="me")
    file = folder / "runs" / "000002" / "000001.npz"
    arrays = read_npz(file)
    about = msgspec.json.decode(str(arrays["about"])) | {"format": "tcfit change 1", "taken_back": undone}
    write_npz(file, arrays | {"about": np.array(msgspec.json.encode(about).decode())})
    with closing(sqlite3.connect(folder / "project.sqlite")) as connection, connection:
        connection.execute("UPDATE runs SET edits_seen = ? WHERE id = 2", (0 if undone else 1,))


@pytest.mark.parametrize("undone", [False, True])
def test_changes_of_an_earlier_version_are_undone_and_redone(folder: Path, tiny_body: BodyModel, undone: bool):
    with session_of(folder, tiny_body) as session:
        before = on_show(session)
        drag(session, 4, 40.0)
        idle(session)
        after = on_show(session)
    as_earlier(folder, undone=undone)
    with session_of(folder, tiny_body) as session:
        for step in (redo, undo, redo) if undone else (undo, redo, undo):
            step(session)
            idle(session)
            assert_same_fit(on_show(session), after if step == redo else before)
            assert session.edits_since(newest(session).run) == 0
        assert len(session.fits.runs) == 1 + (session.project.redoable is None)
        assert not session.project.runs.all(deleted=True)


def test_undoing_a_remark_leaves_the_corrections(folder: Path, tiny_body: BodyModel):
    with session_of(folder, tiny_body) as session:
        session.project.marks.set([1], "flag", author="me")
        drag(session, 4, 40.0)
        session.project.marks.set([2], "flag", author="me")
        idle(session)
        after = on_show(session)
        undo(session)
        nudge(session, 7)
        idle(session)
        undo(session)
        idle(session)
        assert_same_fit(on_show(session), after)


def test_the_oldest_changes_become_part_of_the_fit(folder: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tcfit_app.project.storage.changes._MOST", 1)
    with session_of(folder, tiny_body) as session:
        for frame in (1, 6):
            drag(session, frame, 40.0)
            idle(session)
        after = on_show(session)
        assert not list((folder / "runs" / "000002").iterdir())
    with session_of(folder, tiny_body) as session:
        assert_same_fit(on_show(session), after)
        undo(session)
        idle(session)
        assert newest(session).run.id == 2 and session.edits_since(newest(session).run) == 0
        assert not np.array_equal(on_show(session).last.params.body_pose[6], after.last.params.body_pose[6])


def test_deleted_corrections_are_purged_with_their_changes(session: Session, folder: Path):
    drag(session, 4, 40.0)
    idle(session)
    session.delete(newest(session).run.id)
    session.project.runs.purge()
    assert [entry.name for entry in (folder / "runs").iterdir()] == ["000001.npz"]


def test_corrections_stay_on_show_in_a_project_that_is_opened_again(folder: Path, tiny_body: BodyModel):
    with session_of(folder, tiny_body) as session:
        nudge(session, 1)
        idle(session)
        corrections = newest(session).run
    with session_of(folder, tiny_body) as session:
        shown = newest(session).run
        assert shown.id == corrections.id and shown.kind == "corrections"
        nudge(session, 6)
        assert session.as_corrected(shown).id == corrections.id, "before its fit follows"
        idle(session)
        assert session.as_corrected(shown).id == newest(session).run.id == corrections.id
        undo(session)
        idle(session)
        assert session.as_corrected(shown).id == corrections.id, "one edit is left"
        undo(session)
        idle(session)
        assert session.as_corrected(shown).id == corrections.parent


def test_all_corrections_of_a_run_are_in_one(folder: Path, tiny_body: BodyModel):
    for frame in (1, 6):
        with session_of(folder, tiny_body) as session:
            first = session.fits.show(FitChoice(run=1))
            session.edit(Nudge(frames=(frame,), joints=(WRIST,), by=(25.0, 0.0)), author="me", shown=first)
            idle(session)
            assert [run.id for run in session.fits.runs] == [1, 2]
            assert session.edits_since(newest(session).run) == 0
