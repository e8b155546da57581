"""Which edits stood after each entry of a log, against replaying it; and that asking does not replay it."""

import sys
from collections.abc import Callable
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from tcfit_app.project.edits.standing import Standing


def told(steps: list[str]) -> tuple[Standing[int], list[tuple[int, ...]]]:
    """The states of a log whose entries say their own numbers, and of a short one what stood after each."""
    standing: Standing[int] = Standing()
    done: list[int] = []
    undone: list[int] = []
    after: list[tuple[int, ...]] = [()]
    for number, step in enumerate(steps, 1):
        if step == "undo" and done:
            standing.undo(number)
            undone.append(done.pop())
        elif step == "redo" and undone:
            done.append(undone.pop())
            standing.redo(number, done[-1])
        else:
            standing.say(number, number, counts=step != "remark")
            done.append(number)
            undone.clear()
        after.append(tuple(done) if len(steps) < 100 else ())
    return standing, after


@given(st.lists(st.sampled_from(["say", "say", "remark", "undo", "undo", "redo"]), max_size=60))
@settings(max_examples=150)
def test_it_tells_what_a_replay_of_the_log_tells(steps: list[str]):
    standing, after = told(steps)
    now = set(after[-1])
    remarks = {number for number, step in enumerate(steps, 1) if step == "remark"}
    for seen, then in enumerate(map(set, after)):
        assert set(standing.changes(seen)) == now ^ then
        assert standing.differing(seen) == len((now ^ then) - remarks)
        edits = then - remarks
        assert standing.stood_by(seen) == (edits <= now) and standing.counted(seen) == len(edits)
        assert all(standing.stood_by(seen, k) == (edits <= set(after[k])) for k in range(seen, len(after)))
        assert bool(standing.stood(seen)) == (seen in now)
        assert all(bool(standing.stood(number, seen)) == (number in then) for number in range(len(after)))


def calls(work: Callable[[], Any]) -> int:
    """How many lines of Python it takes."""
    lines = 0

    def trace(frame: Any, event: str, argument: Any) -> Any:
        nonlocal lines
        lines += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return lines


def test_a_hundred_times_as_long_a_log_takes_hardly_longer():
    """Counted for runs that have seen all sorts of states of it: a replay would take a hundred times as many steps."""

    def asked(length: int) -> int:
        standing, after = told((["say"] * 9 + ["undo"]) * (length // 10))
        return calls(lambda: [standing.differing(seen) for seen in range(0, len(after), length // 20)])

    assert asked(50_000) < 4 * asked(500)
