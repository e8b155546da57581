"""The app's own script in viser's page, and the way to it and back.

viser has no hover, no click on points, and keys that move its camera; so a script of our own draws keypoints, timeline
and notices over viser's canvas and watches pointer and keyboard. Down it goes as viser's RunJavascriptMessage, which
carries nothing but a call of `tcfit.receive` with JSON. Up it comes as the value of a hidden text field.
"""

import hashlib
import logging
from collections.abc import Callable
from functools import cache
from importlib.resources import files

import msgspec
import numpy as np
import viser

from tcfit_app.review.browser.page_events import PageEvent, decode
from tcfit_app.review.browser.page_states import STATES, PageState
from tcfit_app.server.viser_bridge import field_id, run_javascript

SCRIPTS = (
    "style",
    "elements",
    "connection",
    "pictures",
    "arrival",
    "projection",
    "skeleton",
    "shapes",
    "overlay",
    "picking",
    "dragging",
    "timeline_data",
    "timeline",
    "timeline_pointer",
    "camera",
    "keys",
    "notice",
    "panels",
    "tabs",
    "number_fields",
    "text_fields",
    "start",
)
"""In the order in which they run, all in one scope."""

Receive = Callable[[PageEvent], None]

_log = logging.getLogger(__name__)


class Channel:
    """The script in one browser tab. To be made when the client connects; it is gone with the client."""

    def __init__(self, client: viser.ClientHandle, receive: Receive) -> None:
        """Put the script into the client's page.

        Args:
            client: The tab.
            receive: Gets the page's events, in order, in viser's event loop: it must only pass them on.
        """
        self._client = client
        self._receive = receive
        self._last = 0
        self._field = client.gui.add_text("", "", visible=False)
        self._field.on_update(self._take)  # pyright: ignore[reportArgumentType]
        run_javascript(client, script())
        run_javascript(client, f"tcfit.connect({_json(field_id(self._field))})")

    def send(self, name: str, state: PageState | None) -> None:
        """Replace the page's state of that name, one of STATES; None takes it away.

        If the connection is slow, the newest state of each name waits, and no other.
        """
        assert name in STATES and (state is None or type(state) is STATES[name]), f"{state} is no {name}"
        run_javascript(self._client, f"tcfit.receive({_json(name)}, {_json(state)})", key=f"tcfit {name}")

    async def _take(self, event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
        # A coroutine: viser calls these in the order of arrival, others in any order from several threads.
        try:
            envelope = decode(event.target.value)
        except msgspec.DecodeError as error:
            _log.warning("An event from the page is dropped: %s", error)
            return
        if envelope.number <= self._last:
            _log.warning("An event from the page is dropped: number %d after %d", envelope.number, self._last)
            return
        self._last = envelope.number
        self._receive(envelope.event)


@cache
def script() -> str:
    """The whole script; it does nothing in a page that has it already."""
    folder = files("tcfit_app.review.browser").joinpath("js")
    parts = [folder.joinpath(f"{name}.js").read_text(encoding="utf-8") for name in SCRIPTS]
    body = "\n".join(parts)
    version = hashlib.sha256(body.encode()).hexdigest()[:16]
    return (
        f'if (!window.tcfit || window.tcfit.version !== "{version}") {{ window.tcfit?.dispose();\n'
        f'(() => {{ "use strict"; const VERSION = "{version}";\n{body}\n}})(); }}'
    )


def _json(value: object) -> str:
    """As JSON that may stand in a script, even within HTML."""
    return msgspec.json.encode(value, enc_hook=_plain_number).decode().replace("</", "<\\/")


def _plain_number(value: object) -> object:
    """numpy's numbers come out of arrays wherever frames and keypoints are counted."""
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"{type(value)} cannot be sent to the page")
