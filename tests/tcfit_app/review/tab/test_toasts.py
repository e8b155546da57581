"""Messages that pass: the same one is on show once, with how often it came."""

from unittest.mock import MagicMock

from tcfit_app.fitting.reports import Notice
from tcfit_app.review.tab.tab import LONG, Toasts

REFUSED = Notice(title="Interpolate: not possible", text="Correct it in a second frame first.", kind="error")
OTHER = Notice(title="Copy: not possible", text="This is the first frame.", kind="error")


class Corner:
    """What is in a tab's corner."""

    def __init__(self) -> None:
        self.titles: list[str] = []
        self.seconds = 0.0

    def add_notification(self, title: str, text: str, **_: object) -> MagicMock:
        handle = MagicMock()
        handle.remove.side_effect = lambda: self.titles.remove(title)
        self.titles.append(title)
        return handle


def test_the_same_message_is_on_show_once_and_counted():
    corner = Corner()
    toasts = Toasts(corner, lambda: corner.seconds)  # pyright: ignore[reportArgumentType]
    for _ in range(3):
        toasts.show(REFUSED)
    assert corner.titles == ["Interpolate: not possible (3 times)"]
    toasts.show(OTHER)
    toasts.show(REFUSED)
    assert corner.titles == ["Copy: not possible", "Interpolate: not possible (4 times)"]


def test_a_message_that_had_gone_is_new():
    corner = Corner()
    toasts = Toasts(corner, lambda: corner.seconds)  # pyright: ignore[reportArgumentType]
    toasts.show(REFUSED)
    corner.titles.clear()  # the browser takes it away
    corner.seconds = LONG + 0.1
    toasts.show(REFUSED)
    assert corner.titles == ["Interpolate: not possible"]
