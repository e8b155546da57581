"""What goes wrong while the app draws: told once in the tab, and the rest goes on."""

import asyncio
import logging

import pytest

from tcfit_app.fitting.reports import Notice
from tcfit_app.review.browser.page_events import Hello
from tcfit_app.review.page import AGAIN, Faults
from tests.drivers.lone_page import LonePage


def test_a_fault_is_told_once_and_tried_again_a_little_later(caplog: pytest.LogCaptureFixture):
    told: list[Notice] = []
    tried: list[float] = []
    wrong: list[Exception | None] = [ValueError("one")]
    faults = Faults(told.append)

    def attempt(now: float) -> None:
        def draw() -> None:
            tried.append(now)
            if wrong[0] is not None:
                raise wrong[0]

        faults.attempt("draw", draw, now)

    for tick in range(61):  # a second of the loop, and a little more
        attempt(tick / 60 * AGAIN)
    assert tried == [0.0, AGAIN] and len(told) == 1 and "ValueError: one" in told[0].text
    assert [record.levelno for record in caplog.records] == [logging.ERROR], "nor does the terminal fill"
    wrong[0] = KeyError("two")
    attempt(2 * AGAIN)
    assert len(told) == 2, "another fault is news"
    wrong[0] = None
    attempt(3 * AGAIN)
    wrong[0] = KeyError("two")
    attempt(3 * AGAIN)
    assert len(told) == 3, "and so is one that comes back"


class _Waiter:
    """Of an event that another thread waits for: the waiters change while the event wakes them, a few times."""

    def __init__(self, event: asyncio.Event, times: int) -> None:
        self._event, self.times = event, times

    def done(self) -> bool:
        if self.times:
            self.times -= 1
            self._event._waiters.append(self)  # pyright: ignore
            self._event._value = False  # pyright: ignore[reportAttributeAccessIssue]
        return True


def test_only_an_event_whose_waiters_changed_is_set_again_at_once(caplog: pytest.LogCaptureFixture):
    told: list[Notice] = []
    event = asyncio.Event()
    waiter = _Waiter(event, 1)
    event._waiters.append(waiter)  # pyright: ignore
    Faults(told.append).attempt("draw", event.set, 0.0)
    assert not waiter.times and event.is_set() and not told and not caplog.records
    calls = []

    def save() -> None:
        calls.append(0)
        if len(calls) == 1:
            raise RuntimeError("deque mutated during iteration")

    Faults(told.append).attempt("save", save, 0.0)
    assert len(calls) == 1 and len(told) == 1, "saving again would hide that something was not saved"


@pytest.fixture
def tested(sample_page: LonePage) -> LonePage:
    sample_page.page.receive(Hello("a tab", 1000, 700))
    return sample_page


def calls(tested: LonePage, name: str) -> int:
    """How many states of a name were sent to the page's script."""
    queue = tested.page.tab.client._websock_connection.queue_message  # pyright: ignore[reportAttributeAccessIssue]
    return sum(f'tcfit.receive("{name}"' in getattr(c.args[0], "source", "") for c in queue.call_args_list)  # pyright: ignore[reportAttributeAccessIssue]


def test_a_part_that_cannot_be_drawn_is_told_and_the_others_are_drawn(
    tested: LonePage, monkeypatch: pytest.MonkeyPatch
):
    page = tested.page
    with monkeypatch.context() as broken:
        broken.setattr(page.timeline, "draw", lambda: 1 / 0)
        for tick in range(30):
            page.draw(tick / 60)
    assert [notice.title for notice in tested.notices] == ["Something went wrong in tcfit"]
    assert "timeline" in tested.notices[0].text and calls(tested, "header") == 1
    page.draw(2 * AGAIN)
    assert calls(tested, "timeline") == 1 and len(tested.notices) == 1


def test_what_could_not_be_sent_is_sent_once_it_can(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    page = tested.page
    send = page.tab.channel.send

    def refuse(name: str, state: object) -> None:
        if name == "marks":
            raise ValueError("no marks")
        send(name, state)  # pyright: ignore[reportArgumentType]

    with monkeypatch.context() as broken:
        broken.setattr(page.tab.channel, "send", refuse)
        page.draw(0.0)
    assert calls(tested, "marks") == 0
    page.draw(2 * AGAIN)
    assert calls(tested, "marks") == 1
    page.draw(3 * AGAIN)
    assert calls(tested, "marks") == 1
