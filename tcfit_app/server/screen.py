"""Checks what a page sends before viser gets it: only widgets on show can be used, and only so fast.

Everything else is dropped. No page of tcfit sends it, except in the rare case that a widget has just gone.
"""

import asyncio
import logging
import math
import time
from collections.abc import Callable, Collection
from typing import Any

import viser
from websockets.asyncio.server import ServerConnection

from tcfit_app.server import viser_bridge
from tcfit_app.server.page_messages import (
    MOST,
    CommandTriggerMessage,
    FileTransferPart,
    FileTransferStartUpload,
    GuiUpdateMessage,
    TransformControlsDragEndMessage,
    TransformControlsDragStartMessage,
    TransformControlsUpdateMessage,
    Value,
    ViewerCameraMessage,
    read,
    written,
)
from tcfit_app.server.uploads import NoRoom, UploadRoom, Uploads

MESSAGES_A_SECOND = 200.0
"""Of one page, on average: a page sends 130 while a drag and the camera's flight are drawn at 60 frames a second."""
AHEAD = 400.0
"""Messages that may come at once; later ones wait, and the page with them."""
_ROUNDING = 1e-6
"""By which a slider's end may be missed."""
_log = logging.getLogger(__name__)


class Dropped:
    """Logs the first dropped message of a page, and no later one: a hostile page may send anything, for ever."""

    def __init__(self) -> None:
        self._noted = False

    def note(self, what: object) -> None:
        """Something was dropped; `what` may be anybody's text."""
        if not self._noted:
            self._noted = True
            _log.info("Dropped a message that pages may not send, the first of this page: %r", str(what)[:300])


class Screen:
    """A websocket as viser sees it."""

    def __init__(self, connection: ServerConnection, room: UploadRoom) -> None:
        self.client: Callable[[], viser.ClientHandle | None] = lambda: None
        """Finds viser's tab, which there is from the first message about the camera."""
        self._connection = connection
        self._uploads = Uploads(room)
        self._dropped = Dropped()
        self._ahead, self._since = AHEAD, time.monotonic()

    # --- what viser uses of a connection ---

    @property
    def subprotocol(self) -> str | None:
        """viser's version."""
        return self._connection.subprotocol

    async def send(self, message: bytes) -> None:
        """To the page."""
        await self._connection.send(message)

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Hang up."""
        await self._connection.close(code, reason)

    async def recv(self) -> bytes:
        """The next message that the page may send."""
        while True:
            sent = await self._connection.recv()
            await self._slow_down()
            try:
                message = read(sent)
                _CHECKS[type(message)](self, message)
            except NoRoom as error:
                self._tell(str(error))
            except ValueError as error:
                self._dropped.note(error)
            else:
                return written(message)

    # --- the rest ---

    def end(self) -> None:
        """The page is gone."""
        self._uploads.end()

    async def _slow_down(self) -> None:
        now = time.monotonic()
        self._ahead = min(AHEAD, self._ahead + MESSAGES_A_SECOND * (now - self._since)) - 1
        self._since = now
        if self._ahead < 0:
            await asyncio.sleep(-self._ahead / MESSAGES_A_SECOND)

    def _check_camera(self, message: ViewerCameraMessage) -> None:
        if math.dist(message.position, message.look_at) < 1e-9 or math.hypot(*message.up_direction) < 1e-9:
            raise ValueError("a camera that looks nowhere")

    def _check_turn(self, message: TransformControlsUpdateMessage) -> None:
        if math.hypot(*message.wxyz) < 1e-9:
            raise ValueError("rings that are turned nowhere")

    def _check_value(self, message: GuiUpdateMessage) -> None:
        widget, value = self._widget(message.uuid, FITS), message.updates.value
        # The script's events are the value of a hidden text field.
        seen = isinstance(widget, viser.GuiTextHandle) or viser_bridge.is_on_show(widget)
        if not seen or not FITS[type(widget)](widget, value):
            raise ValueError(f"{str(value)[:100]!r} for {type(widget).__name__}")

    def _check_upload(self, message: FileTransferStartUpload) -> None:
        if not viser_bridge.is_on_show(self._widget(message.source_component_uuid, {viser.GuiUploadButtonHandle})):
            raise ValueError("an upload to something other than an upload button")
        self._uploads.begin(message)

    def _widget(self, uuid: str, kinds: Collection[type]) -> viser.GuiInputHandle[Any] | None:
        """One of the tab's own (there are no others), if it is of these kinds and switched on."""
        client = self.client()
        widget = None if client is None else viser_bridge.find_input(client, uuid)
        return widget if widget is not None and type(widget) in kinds and not widget.disabled else None

    def _tell(self, text: str) -> None:
        client = self.client()
        assert client is not None, "it has an upload button"
        client.add_notification("The file cannot be uploaded", text, color="red", auto_close_seconds=12.0)


_CHECKS: dict[type, Callable[[Screen, Any], None]] = {
    ViewerCameraMessage: Screen._check_camera,
    GuiUpdateMessage: Screen._check_value,
    CommandTriggerMessage: lambda screen, message: None,  # viser looks whether there is such a command
    # Of rings too: it knows those that are there by their names.
    TransformControlsDragStartMessage: lambda screen, message: None,
    TransformControlsUpdateMessage: Screen._check_turn,
    TransformControlsDragEndMessage: lambda screen, message: None,
    FileTransferStartUpload: Screen._check_upload,
    FileTransferPart: lambda screen, message: screen._uploads.take(message),
}
"""They raise ValueError for what no page sends, NoRoom for what is merely too much."""


def _in_range(widget: viser.GuiSliderHandle[Any] | viser.GuiNumberHandle[Any], value: Value) -> bool:
    least, most = (MOST * sign if end is None else end for sign, end in ((-1, widget.min), (1, widget.max)))
    return isinstance(value, float) and least - _ROUNDING <= value <= most + _ROUNDING


def _are_numbers(widget: object, value: Value) -> bool:
    return isinstance(value, tuple) and all(abs(number) <= MOST for number in value)


FITS: dict[type, Callable[[Any, Value], bool]] = {
    viser.GuiTextHandle: lambda widget, value: isinstance(value, str),
    viser.GuiDropdownHandle: lambda widget, value: value in widget.options,
    viser.GuiNumberHandle: _in_range,
    viser.GuiSliderHandle: _in_range,
    viser.GuiVector2Handle: _are_numbers,
}
"""Which values the widgets take that tcfit uses."""
