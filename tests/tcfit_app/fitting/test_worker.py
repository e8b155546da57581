"""The worker: order, cancelling, pausing, failures, drags in between, and that it always ends."""

import threading
import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.config.schema import SolverSettings, Temporal
from fitting_core.errors import InputError
from fitting_core.fit.events import FitEvent, FramesFitted, Iteration, PhaseFinished, PhaseStarted
from fitting_core.fit.fitting import Refit, fit_clip, rerun_events
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting import worker as worker_module
from tcfit_app.fitting.jobs import FitEverything, FitShape, RerunFrames
from tcfit_app.fitting.live import Correction, LiveCorrection
from tcfit_app.fitting.reports import (
    DragEnded,
    DragMoved,
    JobEnded,
    JobReported,
    JobStarted,
    Report,
)
from tcfit_app.fitting.worker import LiveDrag, Worker
from tests.drivers.waiting import until
from tests.samples import sessions
from tests.samples.scenes import arms_in_motion, clip_of, finished, hidden, keypoints_of, noisy
from tests.samples.sessions import PATIENCE

QUICK = replace(sessions.QUICK, temporal=Temporal(mode="sliding_window", window_size=3, stages=(5,)))
CONVERGED = replace(QUICK, settings=SolverSettings(iterations=60, sequence_tolerance=1e-9))
WRIST = kp.INDEX["right_wrist"]
NOTHING = FitResult(
    phases=(),
    camera=Camera(focal=(1.0, 1.0), center=(0.5, 0.5), size=(1, 1)),
    config=QUICK,
    observed=np.zeros((0, 55), bool),
)
JobFinished, JobCancelled, JobFailed = ((JobEnded, how) for how in ("finished", "cancelled", "failed"))
DragFinished, DragAbandoned, DragFailed = ((DragEnded, how) for how in ("finished", "abandoned", "failed"))
Kind = type | tuple[type, str]
"""A kind of report, or one that ended so."""


def is_of(report: Any, *kinds: Kind) -> bool:
    plain = [kind if isinstance(kind, tuple) else (kind, "") for kind in kinds]
    return any(isinstance(report, kind) and how in ("", getattr(report, "how", "")) for kind, how in plain)


@dataclass
class Kept:
    """A sink that remembers, or fails."""

    results: list[tuple[Any, Any]] = field(default_factory=list)
    error: Exception | None = None

    @property
    def last(self) -> Any:
        return self.results[-1][1]

    def keep(self, job: Any, result: Any) -> None:
        if self.error is not None:
            raise self.error
        self.results.append((job, result))

    def keep_drag(self, correction: Correction, xy: Any, refit: Refit, edit: int | None) -> None:
        self.keep(correction, refit.params)


@dataclass
class Counting:
    """A job of `steps` iterations, each of which waits for `gate`."""

    steps: int = 5
    fails_at: int | None = None
    phases: tuple[int, ...] = (3,)
    title: str = "counting"
    seconds: float = 0.0
    gate: threading.Event = field(default_factory=threading.Event)
    waiting: bool = False
    done: int = 0
    closed: bool = False

    def run(self) -> Generator[FitEvent, None, FitResult]:
        try:
            yield PhaseStarted(phase=3, title="count")
            for i in range(self.steps):
                self.waiting = True
                assert self.gate.wait(PATIENCE)
                time.sleep(self.seconds)
                if i == self.fails_at:
                    raise InputError("Step cannot be taken. Take another.")
                self.done = i + 1
                yield Iteration(phase=3, label=f"step {i + 1}", share=(i + 1) / self.steps, cost=1.0)
            return NOTHING
        finally:
            self.closed = True


def opened(job: Counting) -> Counting:
    job.gate.set()
    return job


@dataclass
class Reader:
    """The draw loop's side: everything that came out of the worker so far."""

    source: SimpleQueue[Report]
    reports: list[Report] = field(default_factory=list)
    moved: list[DragMoved] = field(default_factory=list)

    def look(self) -> "Reader":
        while not self.source.empty():
            report = self.source.get()
            (self.moved if isinstance(report, DragMoved) else self.reports).append(report)
        return self

    def of(self, *kinds: Kind) -> list[Any]:
        return [r for r in self.look().reports if is_of(r, *kinds)]

    def wait(self, *kinds: Kind, count: int = 1) -> list[Any]:
        until(lambda: len(self.of(*kinds)) >= count)
        return self.of(*kinds)


@pytest.fixture
def kept() -> Kept:
    return Kept()


@pytest.fixture
def worker(kept: Kept) -> Iterator[Worker]:
    made = Worker(kept)
    yield made
    assert made.close(PATIENCE), "the worker's thread does not end"


@pytest.fixture
def reader(worker: Worker) -> Reader:
    return Reader(worker.reports)


@pytest.fixture(scope="module")
def clip(tiny_body: BodyModel) -> Clip:
    return clip_of(hidden(noisy(keypoints_of(tiny_body, arms_in_motion(6)), 2.0), kp.HANDS, kp.FACE))


@pytest.fixture(scope="module")
def result(clip: Clip, tiny_body: BodyModel) -> FitResult:
    return fit_clip(clip, tiny_body, QUICK)


def same(a: BodyParams, b: BodyParams) -> bool:
    return all(torch.equal(values, getattr(b, name)) for name, values in vars(a).items())


def test_a_whole_fit_reports_keeps_and_returns_what_the_core_gives(
    worker: Worker, reader: Reader, kept: Kept, clip: Clip, tiny_body: BodyModel, result: FitResult
):
    job = FitEverything(clip=clip, body=tiny_body, config=QUICK)
    number = worker.submit(job)
    (end,) = reader.wait(JobEnded)
    assert is_of(end, JobFinished) and end.job == number and isinstance(kept.last, FitResult)
    assert same(kept.last.last.params, result.last.params)
    events = [r.event for r in reader.of(JobReported)]
    assert [e.phase for e in events if isinstance(e, PhaseStarted)] == [1, 2, 3]
    assert [e.phase for e in events if isinstance(e, PhaseFinished)] == [1, 2, 3]
    for phase in (1, 3):
        fitted = [e for e in events if isinstance(e, FramesFitted) and e.phase == phase]
        assert [i for e in fitted for i in e.frames] == list(range(6))
    assert [type(r) for _, r in kept.results] == [
        type(e) for e in events if isinstance(e, PhaseFinished | FramesFitted)
    ] + [FitResult]
    assert all(work is job for work, _ in kept.results)


def test_a_rerun_of_windows_is_one_after_the_other(
    worker: Worker, reader: Reader, kept: Kept, clip: Clip, tiny_body: BodyModel, result: FitResult
):
    windows = (range(0, 2), range(4, 6))
    before = replace(result, phases=result.phases[:2])
    start = before.last.params
    job = RerunFrames(clip=clip, body=tiny_body, config=QUICK, start=before, windows=windows)
    worker.submit(job)
    (end,) = reader.wait(JobEnded)
    once = finished(rerun_events(clip, tiny_body, QUICK, start, windows[0])).params
    twice = finished(rerun_events(clip, tiny_body, QUICK, once, windows[1])).params
    assert is_of(end, JobFinished) and same(kept.last.last.params, twice)
    assert [p.phase for p in kept.last.phases] == [1, 2, 3] and kept.last.phases[:2] == result.phases[:2]
    assert kept.last.last.notes == ("Re-run frames 0–1, 4–5: window of phase 3, the rest as in the run before",)
    windows_told = [r.event for r in reader.of(JobReported) if isinstance(r.event, FramesFitted)]
    assert [e.frames for e in windows_told] == list(windows)
    assert torch.equal(windows_told[1].params.body_pose, twice.body_pose[4:6])
    assert reader.of(JobStarted) and job.title == "Re-run frames 0–1, 4–5"


def test_only_the_shape(
    worker: Worker, reader: Reader, kept: Kept, clip: Clip, tiny_body: BodyModel, result: FitResult
):
    """From the poses of phase 1 it finds the fit's own shape, and then the fit's own phase 3."""
    worker.submit(FitShape(clip=clip, body=tiny_body, config=QUICK, start=result))
    (end,) = reader.wait(JobEnded)
    assert is_of(end, JobFinished) and [p.phase for p in kept.last.phases] == [1, 2, 3]
    for found, before in zip(kept.last.phases, result.phases, strict=True):
        assert torch.allclose(found.params.betas, before.params.betas, atol=1e-9)
        assert torch.allclose(found.params.body_pose, before.params.body_pose, atol=1e-6)
        assert found.frame_cost == pytest.approx(before.frame_cost, rel=1e-6)
    assert kept.last.last.objective == pytest.approx(result.last.objective, rel=1e-6)
    assert [r.event.phase for r in reader.of(JobReported) if isinstance(r.event, PhaseStarted)] == [2, 3]


def test_jobs_run_in_order_and_a_failure_leaves_the_worker_usable(worker: Worker, reader: Reader, caplog):
    jobs = [opened(Counting()), opened(Counting(fails_at=2)), opened(Counting())]
    numbers = [worker.submit(job) for job in jobs]
    ends = reader.wait(JobEnded, count=3)
    assert [(e.how, e.job) for e in ends] == list(zip(["finished", "failed", "finished"], numbers, strict=True))
    assert ends[1].reason == "Step cannot be taken. Take another."
    assert "Traceback" not in caplog.text and "Step cannot be taken" in caplog.text
    assert [job.done for job in jobs] == [5, 2, 5] and all(job.closed for job in jobs)


def test_a_sink_that_fails_is_told(worker: Worker, reader: Reader, kept: Kept):
    kept.error = OSError("disk full")
    worker.submit(opened(Counting()))
    (end,) = reader.wait(JobEnded)
    assert is_of(end, JobFailed) and "disk full" in end.reason


def test_cancelling_closes_the_generator_at_once(worker: Worker, reader: Reader):
    running, waiting = Counting(steps=10**6, seconds=0.001), Counting()
    numbers = worker.submit(opened(running)), worker.submit(waiting)
    until(lambda: running.done > 3)
    worker.cancel()
    assert {e.job for e in reader.wait(JobCancelled, count=2)} == set(numbers)
    assert running.closed and running.done < 10**6 and not waiting.done
    worker.submit(opened(Counting()))
    reader.wait(JobFinished)


def test_one_job_of_several_is_cancelled(worker: Worker, reader: Reader):
    first, second, third = Counting(), opened(Counting()), opened(Counting())
    numbers = [worker.submit(job) for job in (first, second, third)]
    worker.cancel(numbers[1])
    worker.cancel(numbers[1] + 100)
    first.gate.set()
    assert [e.job for e in reader.wait(JobFinished, count=2)] == [numbers[0], numbers[2]]
    assert second.done == 0 and [e.job for e in reader.of(JobCancelled)] == [numbers[1]]


@pytest.fixture
def correction(clip: Clip, tiny_body: BodyModel, result: FitResult) -> Correction:
    """Of the right wrist in frame 3."""
    params = result.last.params
    return Correction(clip=clip, body=tiny_body, config=CONVERGED, params=params, frame=3, keypoints=(WRIST,), reach=1)


@pytest.fixture
def start(clip: Clip) -> np.ndarray:
    """Where that wrist is."""
    return clip.keypoints.xy[3, [WRIST]]


@pytest.fixture
def long_job(worker: Worker) -> Counting:
    """It has begun."""
    job = Counting(steps=10**6, seconds=0.001)
    worker.submit(opened(job))
    until(lambda: job.done > 2)
    return job


def test_a_long_job_waits_for_a_drag_and_goes_on(
    worker: Worker, reader: Reader, kept: Kept, long_job: Counting, correction: Correction, start: np.ndarray
):
    """The time that it waits does not count as worked."""
    begin, c = time.perf_counter(), correction
    drag = worker.drag(c, start, kept.keep_drag)
    until(lambda: reader.look().moved)
    held = long_job.done
    for step in range(20):
        drag.move(start + 2.0 * step)
        time.sleep(0.015)
    assert long_job.done == held
    drag.release()
    assert len(reader.wait(DragFinished)) == 1
    assert len(kept.results) == 1 and kept.results[0][0] == c and c.frames == range(2, 5)
    plain = finished(rerun_events(c.edited(start + 38.0), c.body, c.converging, c.params, c.frames)).params
    assert not same(plain, c.params) and torch.allclose(kept.last.body_pose, plain.body_pose, atol=0.02)
    until(lambda: long_job.done > held)
    assert {m.drag for m in reader.moved} == {drag.number} and not reader.of(JobEnded)
    reader.reports.clear()
    (last, *_) = reader.wait(JobReported)
    assert 0 < last.worked < time.perf_counter() - begin - 0.3


def test_a_resting_pointer_lets_the_job_go_on(
    worker: Worker,
    reader: Reader,
    kept: Kept,
    long_job: Counting,
    correction: Correction,
    start: np.ndarray,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(worker_module, "LINGER", 0.05)
    drag = worker.drag(correction, start, kept.keep_drag)
    until(lambda: reader.look().moved)
    held = long_job.done
    until(lambda: long_job.done > held + 3)
    drag.move(start + 10)
    count = len(reader.moved)
    until(lambda: len(reader.look().moved) > count)
    drag.abandon()
    assert reader.wait(DragAbandoned)[0].drag == drag.number


def test_drags_of_several_people_are_followed_in_turn(
    worker: Worker,
    reader: Reader,
    kept: Kept,
    clip: Clip,
    correction: Correction,
    start: np.ndarray,
    monkeypatch: pytest.MonkeyPatch,
):
    """Both pointers go on moving; then one rests, which holds jobs for a while but nobody's drag."""
    monkeypatch.setattr(worker_module, "LINGER", PATIENCE)
    order: list[int] = []
    drags: dict[int, LiveDrag] = {}
    resolve = LiveCorrection.resolve
    resting = False

    def moving_on(live: LiveCorrection) -> BodyParams:
        frame = live.correction.frame
        order.append(frame)
        if frame in drags and not resting:
            drags[frame].move(clip.keypoints.xy[frame, [WRIST]] + len(order) % 7)
        return resolve(live)

    monkeypatch.setattr(LiveCorrection, "resolve", moving_on)
    for frame in (1, 4):
        own = replace(correction, frame=frame)
        drags[frame] = worker.drag(own, clip.keypoints.xy[frame, [WRIST]], kept.keep_drag)
        until(lambda frame=frame: order.count(frame) > 5)
    both = order[order.index(4) :]
    assert abs(both.count(1) - both.count(4)) <= 1
    resting = True
    until(lambda: all(drag.live is not None and drag.live.settled for drag in drags.values()))
    third = worker.drag(correction, start, kept.keep_drag)
    until(lambda: third.number in {moved.drag for moved in reader.look().moved})
    for drag in (*drags.values(), third):
        drag.abandon()
    reader.wait(DragAbandoned, count=3)


def test_only_the_newest_move_counts(
    worker: Worker, reader: Reader, kept: Kept, correction: Correction, start: np.ndarray
):
    """The worker is held up while hundreds of moves come: it takes the last of them. Drags go before jobs that wait."""
    job, c = Counting(steps=1), correction
    worker.submit(job)
    waiting = worker.submit(opened(Counting()))
    until(lambda: job.waiting)
    drag = worker.drag(c, start, kept.keep_drag)
    for step in range(300):
        drag.move(start + 0.1 * step)
    drag.release()
    job.gate.set()
    reader.wait(JobFinished, count=2)
    order = [type(r) for r in reader.reports if r in reader.of(DragFinished) or r == JobStarted(job=waiting)]
    assert order == [DragEnded, JobStarted]
    plain = finished(rerun_events(c.edited(start + 0.1 * 299), c.body, c.converging, c.params, c.frames)).params
    (released,) = [found for what, found in kept.results if what == c]
    assert torch.allclose(released.body_pose, plain.body_pose, atol=1e-6) and not reader.moved


def test_a_drag_that_fails_leaves_job_and_worker(
    worker: Worker, reader: Reader, kept: Kept, long_job: Counting, correction: Correction, start: np.ndarray
):
    drag = worker.drag(correction, start, kept.keep_drag)
    until(lambda: reader.look().moved)
    drag.move(np.array([[np.nan, 0.0]]))
    assert reader.wait(DragFailed)[0].drag == drag.number
    held = long_job.done
    until(lambda: long_job.done > held)
    worker.drag(correction, start, kept.keep_drag).release()
    reader.wait(DragFinished)


def test_closing_ends_everything(correction: Correction, start: np.ndarray):
    worker = Worker(Kept())
    reader = Reader(worker.reports)
    job = Counting(steps=10**6, seconds=0.001)
    worker.submit(opened(job))
    until(lambda: job.done > 2)
    worker.submit(Counting())
    worker.drag(correction, start, Kept().keep_drag)
    assert worker.close(PATIENCE)
    assert job.closed and len(reader.of(JobCancelled)) == 2 and len(reader.of(DragAbandoned)) == 1
    assert worker.close(PATIENCE)
    with pytest.raises(RuntimeError, match="closed"):
        worker.submit(Counting())


def test_a_job_that_does_not_come_back_is_told_from_one_that_ends():
    worker, job = Worker(Kept()), Counting()
    worker.submit(job)
    until(lambda: job.waiting)
    assert not worker.close(timeout=0.05)
    job.gate.set()
    assert worker.close(PATIENCE)


COMMANDS = st.lists(
    st.one_of(
        st.tuples(st.just("submit"), st.integers(0, 6), st.one_of(st.none(), st.integers(0, 6))),
        st.sampled_from([("cancel all",), ("cancel last",), ("look",), ("wait",)]),
    ),
    max_size=25,
)


@settings(max_examples=40)
@given(commands=COMMANDS)
def test_every_job_ends_once_whatever_is_commanded(commands: list[tuple]):
    """Started before it ends, one after the other, in the order of the queue; and the thread always ends."""
    worker = Worker(Kept())
    reader, numbers = Reader(worker.reports), []
    for name, *given_ in commands:
        if name == "submit":
            numbers.append(worker.submit(opened(Counting(steps=given_[0], fails_at=given_[1]))))
        elif name == "cancel last" and numbers:
            worker.cancel(numbers[-1])
        elif name == "wait":
            time.sleep(0.002)
        else:
            {"cancel all": worker.cancel}.get(name, reader.look)()
    assert worker.close(PATIENCE)
    assert sorted(e.job for e in reader.of(JobEnded)) == numbers
    started = [r.job for r in reader.of(JobStarted)]
    assert started == sorted(started)
    running: int | None = None
    for report in reader.of(JobStarted, JobReported, JobEnded):
        if isinstance(report, JobStarted):
            assert running is None
            running = report.job
        elif report.job in started:
            assert report.job == running
            running = None if isinstance(report, JobEnded) else running
