"""Slow work beside the thread that draws: what is asked for comes, and nothing else is done with it."""

import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from fitting_core.errors import InputError
from tcfit_app.review.session import tasks as module
from tcfit_app.review.session.tasks import Step, Task, Tasks
from tests.drivers.waiting import until

PATIENCE = 20.0


@pytest.fixture
def tasks() -> Iterator[Tasks]:
    made = Tasks()
    yield made
    made.close()


def endless(report: Step) -> None:
    while True:
        report("waits", 0.5)
        time.sleep(0.002)


def broken(report: Step) -> None:
    raise InputError("No off-screen OpenGL here.")


def test_a_value_is_there_once_it_is_made(tasks: Tasks):
    gate, woken, asked = threading.Event(), [], []
    tasks.arrived = lambda: woken.append(1)

    def compute() -> int:
        asked.append(threading.current_thread())
        gate.wait(PATIENCE)
        return 7

    assert tasks.get("a", compute) is None and tasks.get("a", compute) is None
    gate.set()
    assert until(lambda: tasks.get("a", compute)) == 7 and until(lambda: woken)
    assert len(asked) == 1 and asked[0] is not threading.current_thread()


def test_what_fails_is_told_and_not_tried_again(tasks: Tasks):
    tried = []

    def compute() -> int:
        tried.append(1)
        raise InputError("no such body")

    tasks.get("a", compute)
    assert until(lambda: tasks.problem("a")) == "no such body"
    assert tasks.get("a", compute) is None and len(tried) == 1 and tasks.problem("b") == ""


def test_many_tabs_do_not_evict_what_each_other_waits_for(tasks: Tasks):
    """As each draw does: all keys of all tabs are asked for again and again, twice as many as are remembered."""
    keys = range(2 * module.KEPT)
    made: list[int] = []

    def compute(key: int) -> int:
        made.append(key)
        return key + 1

    until(lambda: all([tasks.get(key, lambda key=key: compute(key)) for key in keys]))
    for _ in range(3):
        assert all([tasks.get(key, lambda key=key: compute(key)) for key in keys])
    assert sorted(made) == list(keys)


def test_what_nobody_asks_for_any_more_is_not_made_and_not_kept(tasks: Tasks, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "IN_USE", 0.05)
    gate, made = threading.Event(), []
    tasks.get("first", lambda: gate.wait(PATIENCE))
    tasks.get("left", lambda: made.append(1))
    time.sleep(0.1)
    gate.set()
    assert until(lambda: tasks.get("last", lambda: 1)) == 1 and not made
    for key in range(3 * module.KEPT):
        until(lambda key=key: tasks.get(key, lambda: 1))
    time.sleep(0.1)
    tasks.get("one more", lambda: 1)
    assert len(tasks.known) <= module.KEPT


def test_work_ends_on_the_thread_that_takes_it(tasks: Tasks):
    ended: list[tuple[int, threading.Thread]] = []

    def end(task: Task[Any]) -> None:
        ended.append((task.result(), threading.current_thread()))

    task = tasks.submit("Counting", lambda report: 3, then=end)
    until(lambda: task.state == "finished")
    assert not ended, "nothing is done before the drawing thread takes it"
    until(lambda: tasks.take() or ended)
    assert ended == [(3, threading.current_thread())]
    tasks.take()
    assert len(ended) == 1


def test_progress_cancelling_and_failing(tasks: Tasks):
    ended: list[Task[Any]] = []
    one = tasks.submit("Waiting", endless, then=ended.append)
    until(lambda: (one.text, one.share) == ("waits", 0.5))
    one.cancel()
    assert one.stopping or one.state == "cancelled"
    other = tasks.submit("Breaking", broken, then=ended.append)
    until(lambda: tasks.take() or len(ended) == 2)
    assert (one.state, other.state, other.reason) == ("cancelled", "failed", "No off-screen OpenGL here.")
    with pytest.raises(InputError, match="off-screen"):
        other.result()


def test_an_unforeseen_error_is_logged_and_told(tasks: Tasks, caplog: pytest.LogCaptureFixture):
    task = tasks.submit("Dividing", lambda report: 1 // 0)
    until(lambda: task.state == "failed")
    told = "Something went wrong inside tcfit (ZeroDivisionError). Its terminal has the details: please report them."
    assert task.reason == told and "Dividing" in caplog.text and "modulo by zero" in caplog.text


def test_what_a_tab_began_ends_with_it(tasks: Tasks):
    tab, other, ended = object(), object(), []
    mine = tasks.submit("Mine", endless, owner=tab, then=ended.append)
    others = tasks.submit("Other's", endless, owner=other, then=ended.append)
    quick = tasks.submit("Quick", lambda report: 1, owner=tab, then=ended.append)
    until(lambda: quick.state == "finished")
    tasks.leave(tab)
    until(lambda: mine.state == "cancelled")
    tasks.take()
    assert others.state == "running" and not ended, "a tab that is gone hears of nothing"


def test_a_task_whose_owner_is_gone_is_waited_for():
    tasks, tab, steps, ended = Tasks(), object(), threading.Event(), threading.Event()

    def deaf(report: Step) -> None:
        steps.set()
        time.sleep(1.0)  # until its next step
        ended.set()

    tasks.submit("Import", deaf, owner=tab)
    assert steps.wait(PATIENCE)
    tasks.leave(tab)
    assert tasks.busy
    tasks.close()
    assert ended.is_set(), "what it writes to is closed next"


def test_closing_ends_everything():
    tasks = Tasks()
    task = tasks.submit("Waiting", endless)
    tasks.get("a", lambda: 1)
    tasks.close()
    assert task.state == "cancelled"


def test_one_end_that_raises_does_not_lose_the_others(tasks: Tasks):
    ended: list[str] = []

    def raises(task: Task[Any]) -> None:
        raise RuntimeError("no")

    all_of = [
        tasks.submit("A", lambda report: 1, then=raises),
        tasks.submit("B", lambda report: 2, then=lambda task: ended.append(task.title)),
    ]
    until(lambda: all(task.state == "finished" for task in all_of))
    until(lambda: tasks.take() or ended == ["B"])
