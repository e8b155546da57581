"""SIGKILL at any moment of a running review: what was acknowledged is there, and the project opens."""

import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.kinds import SWAPPABLE, Lock, MarkBad, MoveKeypoint, Nudge, Restore, ShapeHand, SwapSides
from tcfit_app.project.project import Project
from tcfit_app.review.app import ReviewApp
from tcfit_app.review.session.session import Session
from tcfit_app.server.serving import review_server
from tests.drivers.processes import killed_after, needs_fork
from tests.samples.sessions import FRAMES, QUICK, OneBody, small_clip

pytestmark = [needs_fork, pytest.mark.thorough]
Report = Callable[[str], None]
T = TypeVar("T")
_SHAPE = ((0.1, -0.2, 0.3),) * 15
PACE = 0.01
"""Seconds between two things that the user does: drags go before fits, and without a pause no fit would ever end."""


def _serve_and_work(folder: Path, body: BodyModel, seed: int) -> Callable[[Report], None]:
    """A review whose user edits, drags and fits without end; reports what the app has acknowledged."""

    def work(report: Report) -> None:
        rng = np.random.default_rng(seed)
        with (
            Project.open(folder) as project,
            review_server("crash", port=0, open_browser=False, say=lambda text: None) as server,
        ):
            session = Session(project, OneBody(body))  # pyright: ignore[reportArgumentType]
            app = ReviewApp(session, server.viser)
            session.tell = lambda notice: [report(f"run {r.id}") for r in session.fits.runs if r.state == "finished"]
            threading.Thread(target=app.run, daemon=True).start()
            report("opened")
            while True:
                did = _asked(app, lambda: _step(session, rng))
                report(did)
                time.sleep(PACE)
                looks_on = did.startswith("started") and rng.random() < 0.5
                while looks_on and _asked(app, lambda: bool(session.jobs)):
                    time.sleep(PACE)

    return work


def _asked(app: ReviewApp, question: Callable[[], T]) -> T:
    """The answer of the thread that draws."""
    answer: queue.SimpleQueue[T] = queue.SimpleQueue()
    app.post(lambda: answer.put(question()))
    return answer.get()


def _step(session: Session, rng: np.random.Generator) -> str:
    """One thing that a user does; what was acknowledged."""
    frame, joint = int(rng.integers(FRAMES)), int(rng.integers(kp.BODY.stop))
    shown, chance = session.fits.show(FitChoice()), rng.random()
    if chance < 0.02 and len(session.jobs) < 2:
        return f"started {session.fit_everything(QUICK, kind='smplx', gender='neutral').id}"
    if chance < 0.08 and shown is not None:
        xy = session.project.corrected.xy[frame, [joint]] + rng.normal(0, 5, (1, 2))
        drag = session.edit_follower.begin_drag(shown, frame, (joint,), xy)
        edit = MoveKeypoint(frames=(frame,), joints=(joint,), xy=(((float(xy[0, 0]), float(xy[0, 1])),),))
        session.release(drag, edit, author="script", shown=shown)
    elif chance < 0.15:
        session.undo(author="script", shown=shown)
    elif chance < 0.2:
        session.edit(MarkBad(frames=(frame,), joints=(joint,)), author="script", shown=shown)
    elif chance < 0.25:  # of the whole frame, or at last nobody would be left to be fitted
        session.edit(Restore(frames=(frame,), joints=tuple(range(kp.BODY.stop))), author="script", shown=shown)
    elif chance < 0.35:
        session.edit(
            ShapeHand(frames=(frame,), joints=kp.FINGER_JOINTS["left"], name="fist", shape=_SHAPE),
            author="script",
            shown=shown,
        )
    elif chance < 0.4:
        turn = tuple(rng.uniform(-0.5, 0.5, 3).tolist())
        session.edit(
            Lock(frames=(frame,), joints=(kp.INDEX["left_elbow"],), turn=(turn,)), author="script", shown=shown
        )
    elif chance < 0.45:
        some = tuple(range(0, FRAMES, 2))
        session.edit(SwapSides(frames=some, joints=SWAPPABLE["arms"]), author="script", shown=shown)
    elif chance < 0.5:
        moment = time.time_ns()
        session.project.review.set_note(str(moment))
        return f"note {moment}"
    elif chance < 0.53:
        session.project.review.approve(f"script {(moment := time.time_ns())}")
        return f"approved {moment}"
    else:
        session.edit(Nudge(frames=(frame,), joints=(joint,), by=(1.0, 0.0)), author="script", shown=shown)
    return f"edit {session.project.last_edit}"


def _check(folder: Path, reported: list[str]) -> int:
    """Everything that was acknowledged is there; how many entries the log has."""
    with Project.open(folder) as project:
        log = [entry.id for entry in project.log]
        assert log == list(range(1, len(log) + 1)), "no gap"
        states = {run.id: run for run in project.runs.all()}
        said = project.review.now
        for kind, number in (line.split() for line in reported if line != "opened"):
            if kind == "edit":
                assert int(number) <= len(log)
            elif kind == "note":
                assert int(said.note) >= int(number)
            elif kind == "approved":
                assert int(said.approved_by.removeprefix("script ")) >= int(number)
            else:
                run = states[int(number)]
                if kind == "run":
                    assert run.state == "finished"
        for run in states.values():
            assert run.state != "running"
            if run.state == "finished":
                assert len(project.runs.load(run.id).last.params) == FRAMES
        return len(log)


def _killed_again_and_again(folder: Path, body: BodyModel, times: int, longest: float) -> None:
    """So many times at least, and ever later until a fit has been finished before: on a busy computer one takes longer
    than the longest time, in seconds."""
    Project.create(folder, small_clip(body)).close()
    rng, edits, finished = np.random.default_rng(0), 0, set[str]()
    for seed in range(2 * times):
        reported = killed_after(rng.uniform(0.0, longest), _serve_and_work(folder, body, seed))
        assert reported and reported[0] == "opened", reported
        now = _check(folder, reported)
        assert now >= edits
        edits = now
        finished |= {line for line in reported if line.startswith("run")}
        if seed + 1 >= times:
            if finished:
                break
            longest *= 2
    assert edits > 10 * times and finished, "it was killed at work"


def test_killed_at_work(tmp_path: Path, tiny_body: BodyModel):
    _killed_again_and_again(tmp_path / "a.tcfit", tiny_body, 4, 4.0)


@pytest.mark.slow
def test_killed_fifty_times(tmp_path: Path, tiny_body: BodyModel):
    _killed_again_and_again(tmp_path / "a.tcfit", tiny_body, 50, 4.0)
