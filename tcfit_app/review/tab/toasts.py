"""Messages that pass in a corner of a tab: one that comes again takes the place of its like, and counts."""

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
    """One that is on show."""

    handle: viser.NotificationHandle
    until: float
    count: int


class Toasts:
    """Those of one tab.

    Args:
        client: viser's tab.
        clock: seconds.
    """

    def __init__(self, client: viser.ClientHandle, clock: Callable[[], float] = time.monotonic) -> None:
        self._client, self._clock = client, clock
        self._shown: dict[Notice, _Toast] = {}

    def show(self, notice: Notice) -> None:
        """Tell the user; for as long as if it had not been told before."""
        now = self._clock()
        self._shown = {told: toast for told, toast in self._shown.items() if toast.until > now}
        before = self._shown.pop(notice, None)
        if before is not None:
            before.handle.remove()  # not updated: the user may have closed it
        count = before.count + 1 if before is not None else 1
        stay = LONG if notice.kind == "error" else SHORT
        handle = self._client.add_notification(
            notice.title if count == 1 else f"{notice.title} ({count} times)",
            notice.text,
            color=_COLORS[notice.kind],
            auto_close_seconds=stay,
        )
        self._shown[notice] = _Toast(handle=handle, until=now + stay, count=count)
