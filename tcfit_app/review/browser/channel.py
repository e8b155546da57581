"""The app's own script in viser's page, and its connection to the server.

viser has no hover and no clicking on points, and its keys move the camera; so our own script draws keypoints, timeline
and notices over viser's canvas, and handles pointer and keyboard. The page fetches its modules (`web/`) from the
server. States are sent as viser's RunJavascriptMessages, which contain only a call with JSON. Events come back as the
value of a hidden text field.
"""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import viser

from fitting_core.render.colors import COLORS
from tcfit_app.review.browser.page_events import PageEvent, Stranger, decode
from tcfit_app.review.browser.page_states import STATES, PageRequest, PageState
from tcfit_app.server.screen import Dropped
from tcfit_app.server.uploads import UPLOAD_BYTES
from tcfit_app.server.viser_bridge import field_id, run_javascript

CALLS = ("connect", "receive", "perform", "dress", "setColorTable")
"""Functions that the server calls in the page, in its order, even while the modules are loading."""
Receive = Callable[[PageEvent], None]


class Channel:
    """The script in one browser tab. Create it when the client connects; it ends with the client."""

    def __init__(self, client: viser.ClientHandle, receive: Receive, *, timeline: bool = False) -> None:
        """Load the script into the client's page.

        Args:
            client: The tab.
            receive: Receives the page's events in order, in viser's event loop: it must only pass them on.
            timeline: There will be a timeline, for which the page keeps space from the start.
        """
        self._client = client
        self._receive = receive
        self._last, self._dropped = 0, Dropped()
        self._sent: dict[str, PageState | None] = {}
        self._field = client.gui.add_text("", "", visible=False)
        self._field.on_update(self._take)  # pyright: ignore[reportArgumentType]
        run_javascript(client, loading())
        run_javascript(client, page_call("connect", field_id(self._field), timeline, UPLOAD_BYTES))

    def send(self, name: str, state: PageState | None) -> None:
        """Set the page's state of this name, one of STATES; None removes it.

        Unchanged states are not sent again, so drawing code sends everything each time. On a slow connection only the
        newest state of each name waits.
        """
        assert name in STATES and (state is None or type(state) is STATES[name]), f"{state} is no {name}"
        if self._sent.get(name) != state:
            run_javascript(self._client, page_call("receive", name, state), key=f"tcfit {name}")
            self._sent[name] = state

    def ask(self, request: PageRequest) -> None:
        """Request an action of the page; a repeated request repeats it."""
        run_javascript(self._client, page_call("perform", request))

    async def _take(self, event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
        # A coroutine: viser calls these in order of arrival, but functions in any order on several threads.
        try:
            envelope = decode(event.target.value)
        except msgspec.DecodeError as error:
            self._dropped.note(error)
            return
        if envelope.number <= self._last:
            self._dropped.note(f"number {envelope.number} after {self._last}")
            return
        self._last = envelope.number
        if isinstance(envelope.event, Stranger):  # the page reports it
            self._dropped.note(envelope.event)
            return
        self._receive(envelope.event)


def loading() -> str:
    """JavaScript that loads the script into a page. A page with another version is reloaded."""
    ahead = tuple(path for path in web_files() if not path.startswith(_LIST))
    values = web_version(), ahead, viser.__version__, CALLS
    return f"({loader()})({', '.join(map(_json, values))})"


def page_call(name: str, *values: object) -> str:
    """JavaScript that calls one of CALLS in a page with a Channel."""
    assert name in CALLS
    return f"tcfit.{name}({', '.join(map(_json, values))})"


def _json(value: object) -> str:
    """JSON that is safe in a script, even inside HTML."""
    return msgspec.json.encode(value, enc_hook=_plain_number).decode().replace("</", "<\\/")


def _plain_number(value: object) -> object:
    """numpy's numbers, which come from arrays of frames and keypoints."""
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"{type(value)} cannot be sent to the page")


_FOLDER = Path(__file__).with_name("web")
_LIST = "/tcfit/home/"
"""Before the modules of the list's page, which is not viser's."""
_LOADER = "load.js"
"""The one that is not a module: the server sends it for the page to run."""


@cache
def web_files() -> dict[str, bytes]:
    """The page's modules by URL path, such as "/tcfit/picture/overlay.js"; "/tcfit/colors.js" is made from COLORS."""
    found = sorted(path for path in _FOLDER.rglob("*.js") if path.name != _LOADER)
    colors = {"/tcfit/colors.js": f"export const COLORS = {_json(COLORS)};\n".encode()}
    return colors | {f"/tcfit/{path.relative_to(_FOLDER).as_posix()}": path.read_bytes() for path in found}


@cache
def web_version() -> str:
    """Changes whenever a module changes."""
    parts = [part for path, content in web_files().items() for part in (path.encode(), content)]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def loader() -> str:
    """A JavaScript function that loads the modules, given their version and paths, viser's version, and the calls to
    queue."""
    return (_FOLDER / _LOADER).read_text(encoding="utf-8")
