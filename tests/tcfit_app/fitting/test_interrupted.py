"""A fit that is killed in its first phase keeps the frames fitted so far, and is continued from them."""

import os
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
import viser

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.phases import independent
from tcfit_app.cli.main import main
from tcfit_app.fitting import fits
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.imports.given import read_given
from tcfit_app.project.edits.kinds import MarkBad
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Given, Source
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tcfit_app.review.panels.review_panel import ReviewPanel
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData
from tests.drivers.lone_page import lone_page
from tests.drivers.processes import killed_after, needs_fork
from tests.samples.sessions import FRAMES, PATIENCE, QUICK, OneBody, idle, newest, session_of, small_clip, until

_AT_ONCE = 3
"""Frames that are fitted together, and so are there first."""


def fit_until_killed(folder: Path, body: BodyModel) -> Callable[[Callable[[str], None]], None]:
    """A process that is killed as soon as the first frames are stored."""

    def work(report: Callable[[str], None]) -> None:
        independent._AT_ONCE, fits.KEPT_EVERY = _AT_ONCE, 0.0
        with Project.open(folder) as project:
            session, store = Session(project, OneBody(body)), project.runs.store_partial  # pyright: ignore[reportArgumentType]

            def stored(run: int, fit: object) -> None:
                store(run, fit)  # pyright: ignore[reportArgumentType]
                os.kill(os.getpid(), signal.SIGKILL)

            project.runs.store_partial = stored  # pyright: ignore[reportAttributeAccessIssue]
            report("opened")
            session.fit_everything(QUICK, kind="smplx", gender="neutral")
            while True:
                session.take_news()
                time.sleep(0.01)

    return work


@pytest.fixture(scope="module")
def killed(tiny_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose first fit was killed; not to be changed."""
    folder = tmp_path_factory.mktemp("killed") / "walk.tcfit"
    Project.create(folder, small_clip(tiny_body)).close()
    assert killed_after(PATIENCE, fit_until_killed(folder, tiny_body)) == ["opened"]
    return folder


@pytest.fixture
def folder(killed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(killed, tmp_path / "walk.tcfit"))


def continued(session: Session, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Continue the interrupted run to its end; how many frames were fitted from the camera step on, block by block."""
    found: list[int] = []
    fit = independent._Frames._all_stages
    monkeypatch.setattr(
        independent._Frames, "_all_stages", lambda run, depth: (found.append(len(run.frames)), fit(run, depth))[1]
    )
    (run,) = session.fits.runs
    session.resume(run, *session.interrupted(run)())
    idle(session)
    return found


@needs_fork
def test_frames_of_a_killed_fit_are_on_show_and_the_run_is_not_taken_for_a_finished_one(
    folder: Path, tiny_body: BodyModel
):
    with session_of(folder, tiny_body) as session:
        (run,) = session.fits.runs
        assert (run.state, run.stored, run.partial) == ("interrupted", False, True)
        until(session, lambda: session.stored.show(FitChoice()))
        shown = newest(session)
        assert shown.phase == 1 and shown.result is None and shown.there is not None
        assert shown.has(0) and 0 < shown.there.sum() < FRAMES
        for command in (
            lambda: session.rerun_frames(shown, QUICK, (range(2),)),
            lambda: session.rerun_shape(shown, QUICK),
            lambda: session.project.runs.load(run.id),
            lambda: read_given(
                Given(start=Source(run=run.id)), session.project, session.project.clip, tiny_body, session.bodies
            ),
        ):
            with pytest.raises(InputError):
                command()
        data = DrawingData(session, lambda: None)
        assert "Continue it" in data.problem("suspects", shown), "its figures are not measured for ever"
    assert glance(folder).fit is None


@needs_fork
def test_a_killed_fit_is_continued_without_fitting_its_frames_again(
    folder: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(independent, "_AT_ONCE", _AT_ONCE)
    whole = fit_clip(small_clip(tiny_body), tiny_body, QUICK)
    with session_of(folder, tiny_body) as session:
        found = continued(session, monkeypatch)
        assert found[0] == 0 and sum(found) > 0
        after = newest(session)
        assert session.fits.runs == (after.run,), "it takes the interrupted run's place"
        assert after.run.state == "finished" and after.phase == 3
        assert torch.allclose(after.params.body_pose, whole.last.params.body_pose, atol=1e-4)
    assert not list((folder / "runs").glob("*.partial.npz"))


@needs_fork
def test_frames_edited_since_are_fitted_again(folder: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(independent, "_AT_ONCE", _AT_ONCE)
    with session_of(folder, tiny_body) as session:
        session.edit(MarkBad(frames=(0,), joints=(4,)), author="me")
        assert continued(session, monkeypatch)[0] == 1


@pytest.mark.parametrize("by_user", [True, False])
def test_frames_stay_when_a_fit_is_cancelled_or_tcfit_closed(
    tmp_path: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch, by_user: bool
):
    monkeypatch.setattr(independent, "_AT_ONCE", 1)
    monkeypatch.setattr(fits, "KEPT_EVERY", 0.0)
    Project.create(tmp_path / "a.tcfit", small_clip(tiny_body)).close()
    file = tmp_path / "a.tcfit" / "runs" / "000001.partial.npz"
    with session_of(tmp_path / "a.tcfit", tiny_body) as session:
        session.fit_everything(QUICK, kind="smplx", gender="neutral")
        until(session, file.exists)
        if by_user:
            session.cancel()
            idle(session)
    with session_of(tmp_path / "a.tcfit", tiny_body) as session:
        (run,) = session.fits.runs
        assert (run.state, run.stored, run.partial) == ("cancelled", False, True)


@needs_fork
@pytest.mark.parametrize("panel", [FitPanel, ReviewPanel])
def test_continue_is_pressed_and_the_export_waits_for_it(
    panel: type,
    panel_server: viser.ViserServer,
    folder: Path,
    tiny_body: BodyModel,
    capsys: pytest.CaptureFixture[str],
):
    target = folder.parent / "exports"
    assert main(["export", str(folder), "--formats", "npz", "--out", str(target)]) != 0
    assert "no fit to export" in capsys.readouterr().err and not target.exists()
    with Project.open(folder) as project, lone_page(panel_server, project, bodies=OneBody(tiny_body)) as tested:
        tested.only(panel)
        (run,) = tested.page.tab.session.fits.runs
        tested.until(lambda: "Continue<" in tested.html())
        tested.click("Continue")
        tested.until(lambda: not tested.page.tab.session.jobs and project.runs.get(run.id).stored)
        assert [(one.id, one.state) for one in project.runs.all()] == [(run.id, "finished")]
        assert "Continue" not in tested.html()
