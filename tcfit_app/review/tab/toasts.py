"""Passing messages in a corner of a tab: a repeated one replaces the previous one, with a count."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import viser

from tcfit_app.fitting.reports import Notice

_COLORS: dict[str, Literal["blue", "green", "red"]] = {"info": "blue", "done": "green", "error": "red"}
SHORT, LONG = 4.0, 12.0
"""Seconds for which a message stays; errors stay longer."""


@dataclass(frozen=True, kw_only=True)
class _Toast:
    handle: viser.NotificationHandle
    until: float
    count: int


class Toasts:
    """The messages of one tab.

    Args:
        client: viser's tab.
        clock: in seconds.
    """

    def __init__(self, client: viser.ClientHandle, clock: Callable[[], float] = time.monotonic) -> None:
        self._client, self._clock = client, clock
        self._shown: dict[Notice, _Toast] = {}

    def show(self, notice: Notice) -> None:
        """Show a notice, for its full time even if it was already shown."""
        now = self._clock()
        self._shown = {text: toast for text, toast in self._shown.items() if toast.until > now}
        before = self._shown.pop(notice, None)
        if before is not None:
            before.handle.remove()  # rather than updated: the user may have closed it
        count = before.count + 1 if before is not None else 1
        stay = LONG if notice.kind == "error" else SHORT
        handle = self._client.add_notification(
            notice.title if count == 1 else f"{notice.title} ({count} times)",
            notice.text,
            color=_COLORS[notice.kind],
            auto_close_seconds=stay,
        )
        self._shown[notice] = _Toast(handle=handle, until=now + stay, count=count)
