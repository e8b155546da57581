"""Everything of viser that tcfit uses beyond its documented Python API, and a check that it is there.

No other file imports a private module of viser or touches a private attribute of its objects (a test holds this), so
that a new version of viser is looked through here, and in the page's `viser/bridge.js`.
"""

import gzip
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from threading import Lock
from types import SimpleNamespace
from typing import Any
from zipfile import ZipFile

import viser
import websockets.asyncio.server
from websockets.datastructures import Headers

from fitting_core.errors import InputError

TESTED = "1.1.1"
"""The version that tcfit is tested with."""
_SERIES = TESTED.rpartition(".")[0]

Vector = tuple[float, float, float]


def _unfit(missing: Sequence[str] = ()) -> InputError:
    without = f", which lacks {', '.join(missing)}" if missing else ""
    return InputError(
        f"tcfit needs viser {_SERIES}.x, found {viser.__version__}{without}. Install it: pip install viser=={TESTED}"
    )


try:
    from viser import _gui_api, _gui_handles, _icons, _messages
    from viser.infra import _infra
except ImportError as error:
    raise _unfit([str(error.name)]) from error

_NEEDED = {
    _messages: (
        "RunJavascriptMessage SetCameraFovMessage SetCameraNearMessage SetCameraFarMessage SetCameraUpDirectionMessage "
        "SetCameraPositionMessage SetCameraLookAtMessage SetCameraMinOrbitDistanceMessage "
        "SetCameraMaxOrbitDistanceMessage"
    ),
    _gui_api: "svg_from_icon",
    _gui_handles: "svg_from_icon",
    _icons: "ICONS_DIR",
    _infra: "websockets",
}
"""What is used of viser's private modules."""


def check() -> None:
    """Check that this is a version of viser that tcfit knows. Raises InputError if it is another version, or lacks
    something that is used here."""
    needed = [(module, name) for module, names in _NEEDED.items() for name in names.split()]
    missing = [f"{module.__name__}.{name}" for module, name in needed if not hasattr(module, name)]
    if missing or not viser.__version__.startswith(f"{_SERIES}."):
        raise _unfit(missing)


_NEEDED_OF_GUI = ("_gui_input_handle_from_uuid", "_container_handle_from_uuid")


def check_gui(server: viser.ViserServer) -> None:
    """Check that a server's widgets can be found by their ids. Raises InputError as `check`."""
    if missing := [name for name in _NEEDED_OF_GUI if not hasattr(server.gui, name)]:
        raise _unfit(missing)


# --- messages to the page ---


def run_javascript(receiver: viser.ViserServer | viser.ClientHandle, source: str, *, key: str | None = None) -> None:
    """Run a script in the page of one browser tab, or of all that there are and will be.

    Args:
        receiver: The tab, or the server for all of them.
        source: The script.
        key: Where several scripts of one key wait for a slow connection, only the newest is sent.
    """
    message = _messages.RunJavascriptMessage(source=source)
    if key is not None:
        message.redundancy_key = lambda: key
    if isinstance(receiver, viser.ViserServer):
        receiver._websock_server.queue_message(message)
    else:
        receiver._websock_connection.queue_message(message)


def place_camera(
    client: viser.ClientHandle,
    *,
    fov: float,
    near: float,
    far: float,
    up: Vector,
    position: Vector,
    look_at: Vector,
    least_distance: float,
    most_distance: float,
) -> None:
    """Move the viewer's camera, regardless of its last report.

    viser's own setters leave out what equals the last report, which may be older than the last command.
    """
    # In the order in which the browser must apply them: a bound on the distance moves a camera that is beyond it.
    messages = (
        _messages.SetCameraFovMessage(fov),
        _messages.SetCameraNearMessage(near),
        _messages.SetCameraFarMessage(far),
        _messages.SetCameraUpDirectionMessage(up),
        _messages.SetCameraPositionMessage(position),
        _messages.SetCameraLookAtMessage(look_at),
        _messages.SetCameraMinOrbitDistanceMessage(least_distance),
        _messages.SetCameraMaxOrbitDistanceMessage(most_distance),
    )
    with client.atomic():
        for message in messages:
            client._websock_connection.queue_message(message)


def show_jpeg(node: viser.ImageHandle, data: bytes) -> None:
    """Show an image that is encoded already; viser's own way takes arrays and encodes them."""
    node._format = "jpeg"
    node._data = data


def field_id(field: viser.GuiTextHandle) -> str:
    """The id by which the page's script finds a text field, to send its value."""
    return field._impl.uuid


def put_back(field: viser.GuiInputHandle[Any] | viser.GuiUploadButtonHandle, value: object) -> None:
    """Undo a strange value that a page has sent to an input, and that viser has taken already: its own setter would
    turn every later value into the strange one's type."""
    field._impl.value = value


def find_input(client: viser.ClientHandle, uuid: str) -> viser.GuiInputHandle[Any] | None:
    """One of a tab's own inputs, by its id in the page."""
    return client.gui._gui_input_handle_from_uuid.get(uuid)  # pyright: ignore[reportReturnType]


def is_on_show(field: viser.GuiInputHandle[Any] | None) -> bool:
    """Whether an input is visible, and the folders that it lies in are."""
    if field is None or not field.visible:
        return False
    containers = field._impl.gui_api._container_handle_from_uuid
    around = containers.get(field._impl.parent_container_id)
    while isinstance(around, viser.GuiFolderHandle):
        if not around.visible:
            return False
        around = containers.get(around._impl.parent_container_id)
    return True


# --- the server ---


def watch_connections(
    server: viser.ViserServer, connected: Callable[[int], None], disconnected: Callable[[int], None]
) -> None:
    """Receive the numbers of tabs that come and go, in their own connection's context, before viser's tabs are made."""

    async def come(client: _infra.WebsockClientConnection) -> None:
        connected(client.client_id)

    async def gone(client: _infra.WebsockClientConnection) -> None:
        disconnected(client.client_id)

    server._websock_server.on_client_connect(come)
    server._websock_server.on_client_disconnect(gone)


_CURTAIN = b"""<style>
html::before { content: "Opening the clip ..."; position: fixed; inset: 0; z-index: 900; pointer-events: none;
  display: grid; place-items: center; font: 16px system-ui, sans-serif; background: #fff; color: transparent;
  animation: tcfit-say 0s 1s forwards, tcfit-lift 0s 30s forwards; }
html.tcfit-drawn::before { left: calc(100% - 342px); content: "Preparing the panels ..."; }
html.tcfit-ready::before { display: none; }
@keyframes tcfit-say { to { color: #868e96; } }
@keyframes tcfit-lift { to { visibility: hidden; } }
@media (prefers-color-scheme: dark) { html:not(.tcfit-light)::before { background: #1a1b1e; } }
html.tcfit-dark::before { background: #1a1b1e; }
</style><script>{
  const chosen = /\\btcfit-theme=(dark|light)/.exec(document.cookie);
  if (chosen) document.documentElement.classList.add(`tcfit-${chosen[1]}`);
}</script>"""
"""Over viser's own panel, and its theme, until the app's picture and panels are there (the page's `curtain.js`); at the
latest after 30 seconds: what keeps them away is seen then."""


def curtained(headers: Headers, body: bytes) -> bytes:
    """A page of viser's, compressed or not, behind a curtain, its length put right in `headers`; all else as it is."""
    if not headers.get("Content-Type", "").startswith("text/html"):
        return body
    made = _curtained(body, headers.get("Content-Encoding") == "gzip")
    del headers["Content-Length"]
    headers["Content-Length"] = str(len(made))
    return made


@lru_cache(maxsize=2)  # with and without compression
def _curtained(body: bytes, compressed: bool) -> bytes:
    page = gzip.decompress(body) if compressed else body
    page = page.replace(b"<head>", b"<head>" + _CURTAIN, 1).replace(b"<title>Viser<", b"<title>tcfit<", 1)
    return gzip.compress(page, compresslevel=1) if compressed else page


def let_tabs_leave() -> None:
    """viser warns, on standard error, of what is sent to a tab that was closed a moment ago."""
    warnings.filterwarnings("ignore", "Queued a .* on a closed connection")


_starting = Lock()


@contextmanager
def network_server(serve: Callable[..., Any]) -> Iterator[None]:
    """Within the block only viser gets `serve` instead of websockets' function.

    viser takes neither a socket nor a check of requests, and a proxy in front would leave its own port open to
    everybody on this computer.
    """
    stand_in = SimpleNamespace(
        asyncio=SimpleNamespace(server=SimpleNamespace(serve=serve)),
        datastructures=websockets.datastructures,
        exceptions=websockets.exceptions,
    )
    with _starting:
        seen_by_viser: Any = _infra
        original, seen_by_viser.websockets = seen_by_viser.websockets, stand_in
        try:
            yield
        finally:
            seen_by_viser.websockets = original


# --- icons ---


@cache
def _icons_archive() -> ZipFile:
    return ZipFile(_icons.ICONS_DIR / "tabler-icons.zip")


@cache
def icon(name: str) -> str:
    """An icon as SVG."""
    return _icons_archive().read(f"{name}.svg").decode()


def keep_icons_open() -> None:
    """viser opens its archive of 5000 icons again for each icon: 60 ms, for each of seven in front of every tab."""
    for user in (_gui_api, _gui_handles):
        setattr(user, "svg_from_icon", icon)  # noqa: B010
