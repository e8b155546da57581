"""Fits in the background: their order, their news, and their ends."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tcfit_app.fitting.process_queue import Work
from tcfit_app.home.queue import WAITING, Job, JobQueue
from tests.drivers.waiting import until
from tests.tcfit_app.home.acted import act

ACTED, AFTERWARDS = (Job(kind=kind, writes=False, run=act) for kind in ("act", "act afterwards"))


@pytest.fixture
def queue() -> Iterator[JobQueue]:
    def place(key: str, job: Job) -> Path:
        if key == "open":
            raise ValueError("anna has it open: fit it there.")
        return Path(key)

    made = JobQueue(place, lambda keys: None)
    try:
        yield made
    finally:
        made.close()


def test_one_after_the_other_and_what_failed_says_why(queue: JobQueue):
    queue.add(["fails", "open", "dies", "good"], ACTED)
    assert queue.on("good") == WAITING and queue.busy
    until(lambda: not queue.busy)
    assert queue.on("good") is None
    ends = [queue.on(key) for key in ("fails", "open", "dies")]
    assert all(end is not None and end.ended == "failed" for end in ends)
    assert [end.step.partition(" (")[0] for end in ends if end] == [
        "Nobody was found.",
        "anna has it open: fit it there.",
        "Its process ended with exit code 3. Memory may have run out.",
    ]
    queue.cancel(["fails", "open", "dies"])
    assert queue.on("fails") is None


def test_the_one_that_runs_can_be_cancelled_and_the_next_begins(queue: JobQueue):
    queue.add(["hangs", "good"], ACTED)
    until(lambda: (work := queue.on("hangs")) is not None and work.share == 0.5)
    queue.cancel(["hangs"])
    until(lambda: not queue.busy)
    assert queue.on("hangs") is None


def test_its_end_stops_what_runs(queue: JobQueue):
    queue.add(["hangs", "good"], ACTED)
    until(lambda: (work := queue.on("hangs")) is not None and work.share == 0.5)
    begun = time.monotonic()
    queue.close()
    assert time.monotonic() - begun < 10 and not queue.busy
    assert not [thread for thread in threading.enumerate() if thread.name == "tcfit works in the background"]


def test_a_clip_waits_for_one_job_of_each_kind_in_their_order(queue: JobQueue):
    queue.add(["hangs", "says"], ACTED)
    queue.add(["hangs", "says"], AFTERWARDS)
    queue.add(["says"], ACTED)
    until(lambda: (work := queue.on("hangs")) is not None and work.share == 0.5)
    queue.cancel(["hangs"])
    until(lambda: not queue.busy)
    assert queue.on("hangs") is None and queue.on("says") == Work(step="Said", ended="done")


def test_an_unforeseen_error_is_the_end_of_one_job_only():
    def place(key: str, job: Job) -> Path:
        if key == "odd":
            raise ZeroDivisionError("unforeseen")
        return Path(key)

    def fail(keys: object) -> None:
        if threading.current_thread().name == "tcfit works in the background":
            raise ZeroDivisionError("in a page")

    queue = JobQueue(place, fail)
    try:
        queue.add(["odd", "says"], ACTED)
        until(lambda: not queue.busy)
        odd = queue.on("odd")
        assert odd is not None and odd.ended == "failed" and "unforeseen" in odd.step
        assert queue.on("says") == Work(step="Said", ended="done")
    finally:
        queue.close()
