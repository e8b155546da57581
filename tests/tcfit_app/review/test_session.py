"""A session: what edits, fits and drags do to a project, and what is shown of them meanwhile."""

import gc
import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from fitting_core.fit.events import FramesFitted, PhaseFinished
from fitting_core.fit.grounded import grounding_of_params
from fitting_core.fit.phase_figures import evaluate_objective
from fitting_core.fit.phases import independent
from fitting_core.fit.stages import Stages
from fitting_core.results.fit_result import FitResult
from fitting_core.results.given_start import GivenStart
from tcfit_app.fitting import edit_follower, live, worker
from tcfit_app.fitting import fits as fits_module
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.fitting.jobs import Job, RerunFrames, around
from tcfit_app.fitting.reports import DragEnded, JobEnded, RunningJob
from tcfit_app.project.edits.kinds import MarkBad, MoveKeypoint, Nudge
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import Given, Source
from tcfit_app.review.panels.fit.fit_texts import result_of
from tcfit_app.review.session.session import Session
from tcfit_app.review.shared.drawing_data import DrawingData
from tests.drivers import waiting
from tests.samples.scenes import finished
from tests.samples.sessions import FRAMES, QUICK, held, idle, newest, session_of, small_clip, told, until
from tests.tcfit_app.review.test_other_views import second_view

WRIST = kp.INDEX["right_wrist"]


@pytest.fixture
def folder(fitted_walk: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(fitted_walk, tmp_path / "walk.tcfit"))


@pytest.fixture
def session(folder: Path, tiny_body: BodyModel) -> Iterator[Session]:
    with session_of(folder, tiny_body) as made:
        yield made


def moved(session: Session, by: float, frame: int = 4) -> tuple[MoveKeypoint, np.ndarray]:
    xy = session.project.corrected.xy[frame, [WRIST]] + by
    return MoveKeypoint(frames=(frame,), joints=(WRIST,), xy=(((float(xy[0, 0]), float(xy[0, 1])),),)), xy


def drag(session: Session, shown: Shown, by: float, frame: int = 4) -> None:
    edit, xy = moved(session, by, frame)
    begun = session.edit_follower.begin_drag(shown, frame, (WRIST,), xy)
    session.release(begun, edit, author="me", shown=shown)


def test_a_fit_streams_in_phase_by_phase(tiny_body: BodyModel, tmp_path: Path):
    folder = tmp_path / "a.tcfit"
    Project.create(folder, small_clip(tiny_body)).close()
    with session_of(folder, tiny_body) as session:
        assert session.fits.show(FitChoice()) is None
        run = session.fit_everything(QUICK, kind="smplx", gender="neutral")
        phases, revisions = set(), []
        job = next(iter(session.jobs.values()))
        assert job.run == run.id and job.title == f"Fit {session.project.clip.name}"

        def look() -> bool:
            if (shown := session.fits.show(FitChoice())) is not None:
                phases.add(shown.phase)
                revisions.append(shown.revision)
            return not session.jobs

        until(session, look)
        assert 3 in phases and revisions == sorted(revisions)
        assert [p.phase for p in session.fits.fit(session.fits.runs[0]).phases] == [1, 2, 3]
        first, last = session.fits.show(FitChoice(phase=1)), newest(session)
        assert first is not None and first.phase == 1 and not torch.equal(first.params.betas, last.params.betas)
        assert [n.kind for n in told(session)] == ["done"]


def test_bodies_of_the_first_phase_can_be_looked_at_before_it_is_finished(
    tiny_body: BodyModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(independent, "_AT_ONCE", 2)
    folder = tmp_path / "a.tcfit"
    Project.create(folder, small_clip(tiny_body)).close()
    seen: list[Shown] = []
    with session_of(folder, tiny_body) as session:
        keep = session.fits.keep

        def keep_and_look(job: Job, found: PhaseFinished | FramesFitted | FitResult) -> None:
            keep(job, found)
            if isinstance(found, FramesFitted) and found.phase == 1:
                seen.append(newest(session))
                with pytest.raises(InputError, match="is in its first pass"):
                    session.fits.fit(seen[-1].run)

        monkeypatch.setattr(session.fits, "keep", keep_and_look)
        session.fit_everything(QUICK, kind="smplx", gender="neutral")
        idle(session)
        first = session.fits.show(FitChoice(phase=1))
    reached = [[frame for frame in range(FRAMES) if shown.has(frame)] for shown in seen]
    assert reached == [list(range(min(n, FRAMES))) for n in range(2, FRAMES + 2, 2)]
    assert all(shown.phase == 1 and shown.result is None for shown in seen)
    assert first is not None and first.result is not None and first.has(FRAMES - 1)
    torch.testing.assert_close(seen[0].params.camera_translation[:2], first.params.camera_translation[:2])


def test_a_fit_that_ends_in_its_first_phase_leaves_the_one_before_on_show(
    session: Session, monkeypatch: pytest.MonkeyPatch
):
    """Also when bodies of it were to be seen."""
    before, keep = newest(session), session.fits.keep

    def keep_and_fail(job: Job, found: PhaseFinished | FramesFitted | FitResult) -> None:
        keep(job, found)
        assert newest(session).run.id != before.run.id
        raise InputError("no more")

    monkeypatch.setattr(session.fits, "keep", keep_and_fail)
    run = session.fit_everything(QUICK, kind="smplx", gender="neutral")
    idle(session)
    after = session.fits.run(run.id)
    assert after is not None and after.state == "failed" and after not in session.fits.showable()
    assert newest(session).run.id == before.run.id and newest(session).has(0)


def test_a_rerun_is_a_run_of_its_own_with_its_parent(session: Session):
    before = newest(session)
    config = replace(QUICK, temporal=replace(QUICK.temporal, weight=3000.0))
    run = session.rerun_frames(before, config, (range(2, 5),))
    assert (run.kind, run.parent, run.frames) == ("frames", before.run.id, range(2, 5))
    assert newest(session).phase == 3, "until its frames come in, the run shows those it starts from"
    idle(session)
    after = newest(session)
    assert after.run.id == run.id and after.run.config.temporal.weight == 3000.0
    pose, was = after.params.body_pose, before.params.body_pose
    assert torch.equal(pose[:2], was[:2]) and torch.equal(pose[5:], was[5:]) and not torch.equal(pose[2:5], was[2:5])
    first = session.fits.show(FitChoice(run=run.id, phase=1))
    assert first is not None and torch.equal(
        first.params.body_pose, session.fits.fit(before.run).phases[0].params.body_pose
    )
    assert session.fits.show(FitChoice(run=before.run.id)) is not None, "the run before is still there"


def test_a_released_drag_is_saved_and_its_fit_becomes_the_corrections(
    session: Session, folder: Path, tiny_body: BodyModel
):
    before = newest(session)
    edit, xy = moved(session, 25.0)
    begun = session.edit_follower.begin_drag(before, 4, (WRIST,), xy)
    assert begun is not None
    until(session, lambda: session.edit_follower.live)
    live = session.edit_follower.live
    assert live is not None and live.frames == range(1, FRAMES) and live.run == before.run.id
    session.release(begun, edit, author="me", shown=before)
    assert session.project.last_edit == 1, "saved at release, before the fit has converged"
    idle(session)
    after = newest(session)
    assert session.edit_follower.live is None and after.run.kind == "corrections" and after.run.parent == before.run.id
    assert after.run.edits_seen == 1 and session.edits_since(after.run) == 0 and session.edits_since(before.run) == 1
    assert torch.equal(after.params.body_pose[0], before.params.body_pose[0])
    assert not torch.equal(after.params.body_pose[4], before.params.body_pose[4])
    costs = evaluate_objective(
        session.project.clip_by(after.camera), tiny_body, after.run.config, after.params
    ).frame_cost
    assert after.result is not None
    np.testing.assert_allclose(after.result.frame_cost[1:], costs[1:])
    drag(session, after, -10.0)
    idle(session)
    again = newest(session)
    assert again.run.id == after.run.id and again.revision > after.revision, "corrections of corrections are one run"
    with Project.open(folder, read_only=True) as copy:
        stored = copy.runs.load(again.run.id)
        assert (
            torch.equal(stored.last.params.body_pose, again.params.body_pose)
            and copy.runs.get(again.run.id).edits_seen == 2
        )
    whole = grounding_of_params(
        Stages.of_clip(session.project.clip_by(again.camera), tiny_body, stored.config), stored.last.params
    )
    assert whole is not None and stored.grounding is not None, "gravity and contacts are those of the corrected fit"
    np.testing.assert_allclose(stored.grounding.contacts.probability, whole.contacts.probability)


def test_windows_of_a_later_drag_are_no_earlier_ones(session: Session):
    """Meshes are kept by their revision: one that came again would show the body of the drag before."""
    seen: list[int] = []
    for frame in (1, 6):
        shown = newest(session)
        edit, xy = moved(session, 25.0, frame)
        begun = session.edit_follower.begin_drag(shown, frame, (WRIST,), xy)
        until(session, lambda: session.edit_follower.live)
        assert session.edit_follower.live is not None
        seen.append(session.edit_follower.live.revision)
        session.release(begun, edit, author="me", shown=shown)
        idle(session)
        assert session.edit_follower.live is None
    assert seen[1] > seen[0]


def test_the_end_of_one_drag_leaves_another_tabs_alone(session: Session, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(worker, "LINGER", 0.05)
    shown, follower = newest(session), session.edit_follower
    one, other = (follower.begin_drag(shown, frame, (WRIST,), moved(session, 25.0, frame)[1]) for frame in (1, 6))
    assert one is not None and other is not None
    until(session, lambda: follower.window(shown.run.id, 0) and follower.window(shown.run.id, FRAMES - 1))
    one.abandon()
    until(session, lambda: follower.window(shown.run.id, 0) is None)
    left = follower.window(shown.run.id, FRAMES - 1)
    assert left is not None and left is follower.live and 6 in left.frames
    other.abandon()
    until(session, lambda: not follower.busy)
    assert follower.live is None and follower.window(shown.run.id, FRAMES - 1) is None


def test_corrections_of_a_run_that_was_deleted_are_not_kept(session: Session):
    shown = newest(session)
    edit, xy = moved(session, 25.0)
    begun = session.edit_follower.begin_drag(shown, 4, (WRIST,), xy)
    until(session, lambda: session.edit_follower.live)
    session.delete(shown.run.id)
    session.release(begun, edit, author="me", shown=shown)
    until(session, lambda: not session.edit_follower.busy)
    assert session.fits.runs == () and session.project.runs.all() == []
    assert told(session)[-1].kind == "error" and "was deleted" in told(session)[-1].text


def test_a_fit_that_is_not_in_memory_is_read_beside_the_drawing_thread(
    session: Session, monkeypatch: pytest.MonkeyPatch
):
    gate, threads, load = threading.Event(), [], session.project.runs.load

    def slowly(run: int, at: int | None = None) -> FitResult:
        threads.append(threading.current_thread())
        assert gate.wait(60)
        return load(run)

    monkeypatch.setattr(session.project.runs, "load", slowly)
    run = session.fits.runs[0]
    assert session.stored.show(FitChoice()) is None and session.stored.fit(run) is None
    assert session.stored.phases(run) == () and result_of(session, run) is None and session.stored.reading(run)
    gate.set()
    until(session, lambda: session.stored.show(FitChoice()))
    assert session.stored.fit(run) is not None and session.stored.phases(run) == (1, 2, 3)
    assert len(threads) == 1 and threads[0] is not threading.current_thread()


def test_a_fit_that_cannot_be_read_says_so_each_time(session: Session):
    run = session.fits.runs[0]
    (session.project.folder / "runs" / "000001.npz").write_bytes(b"no archive")
    until(session, lambda: not session.stored.reading(run))
    for _ in range(2):
        with pytest.raises(InputError, match=r"000001\.npz"):
            session.stored.show(FitChoice())
    assert result_of(session, run) is None


def test_fits_on_show_do_not_evict_each_other(session: Session, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fits_module, "KEPT_FITS", 1)
    project, loaded, load = session.project, [], session.project.runs.load
    for _ in range(3):
        first = project.runs.get(1)
        project.runs.finish(project.runs.start(first.config, body=first.body, edits_seen=0).id, load(1))
    monkeypatch.setattr(project.runs, "load", lambda run, at: loaded.append(run) or load(run))
    runs = session.fits.runs
    until(session, lambda: all([session.stored.here(run) for run in runs]))
    for _ in range(3):
        assert all([session.stored.here(run) for run in runs])
    assert sorted(loaded) == [1, 2, 3, 4]
    monkeypatch.setattr(fits_module, "IN_USE", 0.0)
    until(session, lambda: session.stored.here(runs[0]))
    session.fits.forget(4)
    until(session, lambda: session.stored.here(runs[3]))
    assert not session.fits.held(runs[1]), "what nobody looks at makes room"


def test_a_drag_goes_on_from_what_was_kept_since_it_began(session: Session, monkeypatch: pytest.MonkeyPatch):
    """The second begins before the first is released, as where two people correct neighbours."""
    started: list[torch.Tensor] = []
    rerun = live.rerun_events

    def noted(clip, body, config, params, frames, **named):
        started.append(params.body_pose)
        return rerun(clip, body, config, params, frames, **named)

    monkeypatch.setattr(live, "rerun_events", noted)
    before = newest(session)
    drags = []
    for frame, by in ((0, 30.0), (5, -30.0)):
        edit, xy = moved(session, by, frame)
        drags.append((session.edit_follower.begin_drag(before, frame, (WRIST,), xy), edit))
    for begun, edit in drags:
        session.release(begun, edit, author="me", shown=before)
        # The worker takes steps of both in turn, so that of two releases either may come first.
        until(session, lambda: not torch.equal(pose(session, slice(0, 2)), before.params.body_pose[:2]))
    idle(session)
    after = pose(session, slice(0, 2))
    assert torch.equal(started[1][:2], after), "the second window is held by what the first drag led to"
    assert session.edits_since(newest(session).run) == 0


def test_an_edit_whose_drag_could_not_be_followed_is_followed_after_it(
    session: Session, monkeypatch: pytest.MonkeyPatch
):
    before = newest(session)
    monkeypatch.setattr(live.LiveCorrection, "resolve", lambda _: 1 / 0)
    edit, xy = moved(session, 25.0)
    begun = session.edit_follower.begin_drag(before, 4, (WRIST,), xy)
    until(session, lambda: told(session))
    assert "could not follow" in told(session)[-1].title
    session.release(begun, edit, author="me", shown=before)
    idle(session)
    assert newest(session).run.kind == "corrections" and session.edits_since(newest(session).run) == 0
    monkeypatch.setattr(live.LiveCorrection, "release", lambda _: 1 / 0)
    drag(session, newest(session), 12.0)
    idle(session)
    assert session.edits_since(newest(session).run) == 0, "it failed after its release"


def test_a_run_that_is_being_read_does_not_hide_a_newer_one(folder: Path, tiny_body: BodyModel):
    with session_of(folder, tiny_body) as session:
        drag(session, newest(session), 25.0)
        idle(session)
    with session_of(folder, tiny_body) as session:
        run, load = session.fits.runs[-1], session.project.runs.load
        read, gone_on = threading.Event(), threading.Event()

        def slow(number: int, at: int | None = None) -> object:
            fit = load(number, at)
            if threading.current_thread() is reader:
                read.set()
                gone_on.wait(10)
            return fit

        session.project.runs.load = slow  # pyright: ignore[reportAttributeAccessIssue]
        reader = threading.Thread(target=lambda: session.fits.fit(run))
        reader.start()
        assert read.wait(10)
        drag(session, newest(session), -10.0)
        idle(session)
        kept = pose(session, 4)
        gone_on.set()
        reader.join()
        assert torch.equal(pose(session, 4), kept)


def test_costs_of_a_rerun_are_those_of_its_frames_alone(session: Session, tiny_body: BodyModel):
    before = newest(session)
    start = session.fits.fit(before.run)
    clip = session.project.clip_by(before.camera)
    found = finished(RerunFrames(clip=clip, body=tiny_body, config=QUICK, start=start, windows=(range(2, 4),)).run())
    expected = evaluate_objective(clip, tiny_body, QUICK, found.last.params)
    np.testing.assert_allclose(found.last.frame_cost[2:4], expected.frame_cost[2:4])
    others = [0, 1, *range(4, FRAMES)]
    assert (found.last.frame_cost[others] == start.last.frame_cost[others]).all(), "as in the run before"


def test_a_cancelled_shape_keeps_its_second_phase(session: Session):
    before = newest(session)
    first = session.fits.fit(before.run).phases[0]
    config = replace(QUICK, shape_sample=replace(QUICK.shape_sample, size=5, seed=3))
    slow = replace(config, temporal=replace(QUICK.temporal, mode="sliding_window", window_size=3))
    run = session.rerun_shape(before, slow)
    assert session.fits.phases(run) == (1,), "the shape is found again"
    until(session, lambda: newest(session).phase == 3)
    betas = newest(session).params.betas
    assert torch.equal(betas, betas[:1].expand_as(betas)), "frames that are still to come have the new shape, too"
    session.cancel(run.id)
    idle(session)
    after = session.fits.run(run.id)
    assert after is not None and after.state == "cancelled" and session.fits.phases(after) == (1, 2)
    second = session.fits.fit(after).phases[1].params
    assert torch.equal(second.body_pose, first.params.body_pose) and not torch.equal(second.betas, first.params.betas)


def test_the_fit_follows_edits_once_they_settle(session: Session, monkeypatch: pytest.MonkeyPatch):
    before = newest(session)
    for _ in range(3):
        session.edit(Nudge(frames=(4,), joints=(WRIST,), by=(8.0, 0.0)), author="me", shown=before)
    assert not session.jobs
    until(session, lambda: session.jobs)
    assert len(session.jobs) == 1, "one job for all of them"
    idle(session)
    after = newest(session)
    assert after.run.kind == "corrections" and not torch.equal(after.params.body_pose[4], before.params.body_pose[4])
    session.undo(author="me", shown=after)
    idle(session)
    assert newest(session).revision > after.revision, "undo is followed too"
    session.edit_follower.after_edits = False
    session.edit(Nudge(frames=(4,), joints=(WRIST,), by=(8.0, 0.0)), author="me", shown=after)
    assert not session.edit_follower.busy
    session.edit_follower.after_edits = True
    monkeypatch.setattr(edit_follower, "MOST_FOLLOWED", 3)
    session.edit(MarkBad(frames=(4,), joints=(WRIST,)), author="me", shown=after)
    until(session, lambda: not session.edit_follower.busy)
    assert not session.jobs and "re-run them" in told(session)[-1].text


def test_fits_follow_edits_of_other_views_and_say_that_a_view_needs_a_new_fit(session: Session, tiny_body: BodyModel):
    before, project = newest(session), session.project
    entry = project.add_view(second_view(tiny_body))
    session.edit_follower.edited(entry, before)
    until(session, lambda: not session.edit_follower.busy)
    assert not session.jobs and told(session)[-1].title == "Fit the clip again"
    assert session.edits_since(before.run) == 1
    mark = project.edit_of_view(entry.id, MarkBad(frames=(8,), joints=(WRIST,)))
    session.edit(mark, author="me", shown=before)
    until(session, lambda: session.jobs)
    idle(session)
    after = newest(session)
    assert after.run.kind == "corrections" and not torch.equal(after.params.body_pose[6], before.params.body_pose[6])


def nudge(session: Session, frame: int, shown: Shown | None) -> None:
    session.edit(Nudge(frames=(frame,), joints=(WRIST,), by=(25.0, 0.0)), author="me", shown=shown)


def pose(session: Session, frame: int | slice) -> torch.Tensor:
    return newest(session).params.body_pose[frame]


def test_frames_of_a_run_under_way_are_fitted_again_when_it_has_finished(session: Session):
    before = newest(session)
    nudge(session, 0, None)
    nudge(session, 7, None)
    with held(session):
        first = session.rerun_frames(before, QUICK, (range(0, 2),))
        second = session.rerun_frames(newest(session), QUICK, (range(6, 8),))
        assert second.parent == first.id
    idle(session)
    found = [session.fits.show(FitChoice(run=run.id)) for run in (first, second)]
    one, both = (shown.params.body_pose for shown in found if shown is not None)
    assert not torch.equal(one[0], before.params.body_pose[0]) and torch.equal(one[2:], before.params.body_pose[2:])
    assert torch.equal(both[:6], one[:6]) and not torch.equal(both[7], one[7])


def test_nothing_goes_on_from_a_run_that_did_not_finish(session: Session):
    with held(session):
        first = session.rerun_frames(newest(session), QUICK, (range(0, 2),))
        second = session.rerun_frames(newest(session), QUICK, (range(6, 8),))
        session.cancel(first.id)
    idle(session)
    after = session.fits.run(second.id)
    assert after is not None and after.state == "failed" and "did not finish" in after.message


def test_frames_of_a_run_that_ended_after_its_first_phase_are_not_fitted_again(session: Session):
    session.fit_everything(replace(QUICK, last_phase=1), kind="smplx", gender="neutral")
    idle(session)
    runs = session.fits.runs
    with pytest.raises(InputError, match=r"Fit 2 ended after its first pass.*Fit the shape again"):
        session.rerun_frames(newest(session), QUICK, (range(2, 5),))
    assert session.fits.runs == runs


def test_a_drag_that_overtook_an_edit_stays(session: Session):
    before = newest(session)
    with held(session):
        nudge(session, 4, before)
        until(session, lambda: session.jobs)
        drag(session, before, 40.0, frame=5)
        until(session, lambda: newest(session).run.kind == "corrections")
        dragged = pose(session, 5)
    idle(session)
    away = torch.linalg.norm(before.params.body_pose[5] - dragged)
    assert torch.linalg.norm(pose(session, 5) - dragged) < 0.2 * away, "fitted again from the drag on, with both edits"
    assert session.edits_since(newest(session).run) == 0


def test_an_edit_that_came_while_the_fit_followed_is_not_written_over(
    session: Session, monkeypatch: pytest.MonkeyPatch
):
    before = newest(session)
    run = RerunFrames.run

    def edited_meanwhile(job: RerunFrames):
        if session.project.last_edit == 1:
            nudge(session, 1, None)
        return run(job)

    monkeypatch.setattr(RerunFrames, "run", edited_meanwhile)
    nudge(session, 0, before)
    idle(session)
    after = newest(session).run
    assert after.kind == "corrections" and after.edits_seen == 2, "both are in: frame 0 was followed again"


def test_edits_made_while_the_fit_follows_others_are_followed_together(
    session: Session, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(edit_follower, "SETTLING", 0.0)
    monkeypatch.setattr(edit_follower, "MOST_FOLLOWED", FRAMES - 1)
    before = newest(session)
    with held(session):
        for frame in (0, 7, 1, 6, 0):
            nudge(session, frame, before)
            session.take_news()
        assert len(session.jobs) == 1 and session.edit_follower.busy
    idle(session)
    assert not told(session), "each of them is few frames: that they wait together is nothing to refuse"
    assert session.edits_since(newest(session).run) == 0
    for frame in (0, 7):
        assert not torch.equal(pose(session, frame), before.params.body_pose[frame])


def test_cancelling_what_follows_edits_cancels_those_that_wait_for_it(
    session: Session, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(edit_follower, "SETTLING", 0.0)
    before = newest(session)
    with held(session):
        for frame in (0, 7):
            nudge(session, frame, before)
            session.take_news()
        session.cancel()
    idle(session)
    assert newest(session).run.id == before.run.id and session.edits_since(before.run) == 2


def fits_alive() -> int:
    gc.collect()
    return sum(type(one) is FitResult for one in gc.get_objects())


def test_edits_leave_no_fits_in_memory_but_those_of_runs(session: Session, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(edit_follower, "SETTLING", 0.0)
    data, before = DrawingData(session, lambda: None), fits_alive()
    for frame in range(6):
        nudge(session, frame, newest(session))
        idle(session)
        until(session, lambda: data.queue(newest(session)) is not None)
    kept, runs = fits_alive() - before, len(session.fits.runs)
    data.close()
    assert runs == 2 and kept <= runs + 1, "and the worker's last job"


def test_edits_of_two_runs_are_both_followed(session: Session):
    before = newest(session)
    other = session.rerun_frames(before, QUICK, (range(0, 2),))
    idle(session)
    nudge(session, 0, before)
    nudge(session, 7, newest(session))  # before the first has settled
    idle(session)
    followed = {run.parent for run in session.fits.runs if run.kind == "corrections"}
    assert followed == {before.run.id, other.id}


def test_edits_that_no_window_holds_stay_unseen(session: Session):
    before = newest(session)
    nudge(session, 0, None)
    nudge(session, 7, before)
    idle(session)
    after = newest(session)
    assert after.run.kind == "corrections" and torch.equal(after.params.body_pose[0], before.params.body_pose[0])
    assert session.project.frames_edited_since(after.run.edits_seen) == {0, 7}, "counted from the first that is not in"
    partly = session.rerun_frames(after, QUICK, (range(6, 8),))
    wholly = session.rerun_frames(after, QUICK, (range(0, 8),))
    assert (partly.edits_seen, wholly.edits_seen) == (0, 2)


def test_a_fit_without_its_body_follows_nothing_and_says_so(folder: Path):
    with session_of(folder, None) as session:
        shown = newest(session)
        edit, xy = moved(session, 25.0)
        assert session.edit_follower.begin_drag(shown, 4, (WRIST,), xy) is None
        session.edit(edit, author="me", shown=shown)
        until(session, lambda: not session.edit_follower.busy)
        assert told(session)[-1].kind == "error" and "There is no neutral smplx body" in told(session)[-1].text


@pytest.mark.parametrize("barred", [("finish",), ("finish", "end")])
def test_a_fit_that_finds_no_room_on_the_disk_is_written_later(
    session: Session, monkeypatch: pytest.MonkeyPatch, barred: tuple[str, ...]
):
    full = True
    runs = session.project.runs

    def on_full_disk(write):
        def tried(*given, **named):
            if full:
                raise InputError("the disk is full")
            return write(*given, **named)

        return tried

    for name in barred:
        monkeypatch.setattr(runs, name, on_full_disk(getattr(runs, name)))
    monkeypatch.setattr("tcfit_app.review.session.session.RETRY", 0.0)
    run = session.rerun_frames(newest(session), QUICK, (range(2, 4),))
    idle(session)
    kept = session.fits.run(run.id)
    assert kept is not None and kept.state == ("running" if "end" in barred else "failed") and not kept.stored
    assert any("keep tcfit running" in notice.text for notice in told(session))
    full = False
    session.take_news()
    kept = session.fits.run(run.id)
    assert kept is not None and kept.state == "finished" and "was saved after all" in told(session)[-1].title
    assert newest(session).run.id == run.id and torch.equal(
        session.project.runs.load(run.id).last.params.body_pose, newest(session).params.body_pose
    )


@pytest.mark.parametrize("closing", [False, True])
def test_a_run_whose_end_goes_wrong_is_ended_later(session: Session, monkeypatch: pytest.MonkeyPatch, closing: bool):
    runs, broken = session.project.runs, [OSError("a bad cable")]
    end = runs.end
    monkeypatch.setattr(runs, "end", lambda *given: (_ for _ in ()).throw(broken.pop()) if broken else end(*given))
    monkeypatch.setattr("tcfit_app.review.session.session.RETRY", 0.0)
    begun = [session.fit_everything(QUICK, kind="smplx", gender="neutral") for _ in range(2)]
    if closing:
        session.close()
    else:
        session.cancel()
        idle(session)
        session.take_news()
        assert "a bad cable" in " ".join(notice.text for notice in told(session))
    assert {runs.get(run.id).state for run in begun} == {"cancelled"}


def test_nothing_is_read_from_the_disk_where_a_drag_or_an_edit_begins(
    session: Session, monkeypatch: pytest.MonkeyPatch
):
    before = newest(session)
    drag(session, before, 40.0)
    idle(session)
    corrections = newest(session).run
    assert corrections.kind == "corrections"
    threads, load = [], session.project.runs.load
    monkeypatch.setattr(
        session.project.runs, "load", lambda run, at: threads.append(threading.current_thread()) or load(run, at)
    )
    for begin in (lambda shown: drag(session, shown, 60.0), lambda shown: nudge(session, 1, shown)):
        shown = newest(session)
        del session.fits._versions[corrections.id]
        begin(shown)
        idle(session)
    assert len(threads) > 1 and threading.current_thread() not in threads
    assert session.edits_since(newest(session).run) == 0


def test_cancelled_and_failed_runs_leave_everything_usable(session: Session, monkeypatch: pytest.MonkeyPatch):
    before = newest(session)
    with held(session):  # neither has a phase by then, of which a cancelled run is not nothing
        runs = [session.fit_everything(QUICK, kind="smplx", gender="neutral") for _ in range(2)]
        session.cancel(runs[1].id)
        session.cancel(runs[0].id)
    idle(session)
    assert {session.fits.run(run.id).state for run in runs} == {"cancelled"}  # pyright: ignore
    wrong = replace(QUICK, pose_prior="/nowhere/at all.npz")
    failed = session.fit_everything(wrong, kind="smplx", gender="neutral")
    idle(session)
    after = session.fits.run(failed.id)
    assert after is not None and after.state == "failed" and "nowhere" in after.message
    assert told(session)[-1].kind == "error" and "nowhere" in told(session)[-1].text
    assert newest(session).run.id == before.run.id
    session.rerun_frames(before, QUICK, (range(2, 4),))
    idle(session)
    assert newest(session).run.state == "finished"


def test_news_that_cannot_be_taken_up_leave_the_others(session: Session, monkeypatch: pytest.MonkeyPatch):
    def fail(report: object) -> None:
        raise RuntimeError("no such drag")

    monkeypatch.setattr(session.edit_follower, "take_end", fail)
    session.jobs[99] = RunningJob(number=99, run=None, title="job", phases=(3,))
    session.worker.reports.put(DragEnded(drag=7, how="abandoned"))
    session.worker.reports.put(JobEnded(job=99, how="finished"))
    session.take_news()
    assert not session.jobs
    assert [notice.kind for notice in told(session)] == ["error"] and "no such drag" in told(session)[0].text


def test_read_only(folder: Path, tiny_body: BodyModel):
    with session_of(folder, tiny_body, read_only=True) as session:
        shown = newest(session)
        edit, xy = moved(session, 25.0)
        assert session.edit_follower.begin_drag(shown, 4, (WRIST,), xy) is None
        for command in (
            lambda: session.edit(edit, author="me"),
            lambda: session.project.marks.set([1], "flag", author="me"),
            lambda: session.fit_everything(QUICK, kind="smplx", gender="neutral"),
            lambda: session.rerun_frames(shown, QUICK, (range(2, 4),)),
            lambda: session.project.runs.rename(1, "other"),
        ):
            with pytest.raises(InputError):
                command()
        assert not session.jobs and not session.project.keypoints_version


def test_frames_around():
    assert around([4], 2, 10) == (range(2, 7),)
    assert around([0, 9], 2, 10) == (range(0, 3), range(7, 10))
    assert around([1, 5], 2, 10) == (range(0, 8),), "ranges that touch are one"
    assert around([], 2, 10) == ()


@pytest.mark.parametrize("while_closing", [False, True])
def test_closing_leaves_what_has_ended_by_itself_as_it_ended(
    session: Session, monkeypatch: pytest.MonkeyPatch, while_closing: bool
):
    ended, tell, close = [], session.worker._report, session.worker.close
    monkeypatch.setattr(
        session.worker, "_report", lambda report: (tell(report), ended.append(isinstance(report, JobEnded)))
    )

    def wait() -> None:
        """Without asking for the worker's news."""
        waiting.until(lambda: sum(ended) == 2)

    wrong = replace(QUICK, pose_prior="/nowhere/at all.npz")
    fitted, failed = (session.fit_everything(config, kind="smplx", gender="neutral") for config in (QUICK, wrong))
    if while_closing:
        monkeypatch.setattr(session.worker, "close", lambda: (wait(), close()))
    else:
        wait()
    session.close()
    runs = session.project.runs
    assert [runs.get(run.id).state for run in (fitted, failed)] == ["finished", "failed"]
    assert "nowhere" in runs.get(failed.id).message
    assert not any("cannot be written" in notice.title for notice in told(session))


def test_what_goes_on_from_a_fit_with_a_start_has_the_same_evidence(
    session: Session, folder: Path, tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch
):
    """Frames that are fitted again, the shape, a drag, and all of that after tcfit was started again."""
    given = Given(start=Source(run=1))
    known = session.reading(given, kind="smplx", gender="neutral")()
    config = replace(QUICK, start_deviation=0.05)
    run = session.fit_everything(config, kind="smplx", gender="neutral", known=known)
    idle(session)
    seen: list[GivenStart | None] = []
    of = Stages.of

    def noted(*arguments: Any, **options: Any) -> Stages:
        seen.append(options.get("start"))
        return of(*arguments, **options)

    monkeypatch.setattr(Stages, "of", noted)

    def all_have_it(opened: Session, do: Callable[[], object]) -> Shown:
        seen.clear()
        do()
        idle(opened)
        assert seen and all(start is not None and len(start) == FRAMES for start in seen)
        after = newest(opened)
        assert opened.fits.fit(after.run).start is not None and after.run.given.start == given.start
        return after

    after = all_have_it(session, lambda: session.rerun_frames(newest(session), config, (range(2, 4),)))
    assert (after.run.kind, after.run.parent) == ("frames", run.id)
    shape = all_have_it(session, lambda: session.rerun_shape(after, config)).run
    assert shape.kind == "shape" and session.fits.phases(shape) == (1, 2, 3)
    session.close()
    session.project.close()
    with session_of(folder, tiny_body) as again:
        after = all_have_it(again, lambda: drag(again, newest(again), 25.0))
        assert after.run.kind == "corrections"
        stored = again.project.runs.load(after.run.id).start
        assert stored is not None and known.start is not None and stored.about == known.start.about
        np.testing.assert_array_equal(stored.points, known.start.points)
