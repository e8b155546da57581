"""The disk is full for a while, at any write of what the user does."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.fitting import edit_follower
from tcfit_app.project.edits.kinds import Nudge
from tcfit_app.review.session.session import Session
from tests.flows.disk import disk
from tests.samples.sessions import QUICK, idle, newest, session_of

WRIST = kp.INDEX["right_wrist"]
WRITES = range(12)
"""How many writes succeed before the disk is full."""


@pytest.fixture
def session(
    fitted_walk: Path, tmp_path: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Session]:
    monkeypatch.setattr(edit_follower, "SETTLING", 0.0)
    monkeypatch.setattr("tcfit_app.review.session.session.RETRY", 0.0)
    with session_of(Path(shutil.copytree(fitted_walk, tmp_path / "walk.tcfit")), tiny_body) as made:
        yield made


def edited(session: Session) -> None:
    session.edit(Nudge(frames=(4,), joints=(WRIST,), by=(25.0, 0.0)), author="me", shown=newest(session))


def undone(session: Session) -> None:
    edited(session)
    idle(session)
    session.undo(author="me", shown=newest(session))


def rerun(session: Session) -> None:
    session.rerun_frames(newest(session), QUICK, (range(2, 4),))


def fitted_again(session: Session) -> None:
    session.fit_everything(QUICK, kind="smplx", gender="neutral")


def imported(session: Session) -> None:
    run = newest(session).run
    fit = session.fits.fit(run)
    session.project.runs.start(fit.config, fit=fit, body=run.body, edits_seen=0, kind="imported")


def assert_only_jobs_run(session: Session) -> None:
    """No run is running, as there is no job; each can be deleted."""
    idle(session)
    session.take_news()
    runs = session.project.runs
    assert [run.name for run in runs.all() if run.state == "running"] == []
    for run in runs.all():
        if run.stored:
            shown, stored = session.fits.fit(run).last.params, runs.load(run.id).last.params
            assert torch.equal(shown.body_pose, stored.body_pose), f"{run.name} on show is not the stored one"
        session.delete(run.id)


@pytest.mark.parametrize("room", WRITES)
def test_full_disk_during_an_undo_loses_no_correction(session: Session, tiny_body: BodyModel, room: int):
    before = newest(session)
    edited(session)
    idle(session)
    corrected = newest(session)
    with disk() as full:
        full.room = room
        with suppress(InputError):
            session.undo(author="me", shown=corrected)
            idle(session)
        full.room = None
        idle(session)
    folder = session.project.folder
    session.close()
    session.project.close()
    with session_of(folder, tiny_body) as again:
        if again.project.undoable is not None:
            again.undo(author="me", shown=newest(again))
            idle(again)
        # The fit may still show the edit, as the notice says; once it is redone and undone it does not.
        for step in (again.redo, again.undo):
            assert step(author="me", shown=newest(again)) is not None
            idle(again)
            if step == again.redo:
                assert torch.equal(newest(again).params.body_pose, corrected.params.body_pose)
        assert torch.equal(newest(again).params.body_pose, before.params.body_pose)


@pytest.mark.parametrize("room", WRITES)
@pytest.mark.parametrize("act", [edited, undone, rerun, fitted_again, imported])
def test_full_disk_leaves_no_run_without_a_job(session: Session, act: Callable[[Session], None], room: int):
    with disk() as full:
        full.room = room
        try:
            act(session)
            idle(session)
        except InputError as error:
            assert "full" in str(error) or "No space" in str(error)
        full.room = None
        assert_only_jobs_run(session)
