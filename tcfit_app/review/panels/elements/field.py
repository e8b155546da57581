"""An input of viser's that shows part of a tab's state."""

import logging
import math
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import viser

from fitting_core.errors import InputError
from tcfit_app.review.tab.tab import Tab
from tcfit_app.server.viser_bridge import put_back

Value = TypeVar("Value", str, int, float, Any)
Handle = TypeVar("Handle", bound=viser.GuiInputHandle[Any])

_log = logging.getLogger(__name__)


class Field(Generic[Value]):
    """Lets the user set a value, and follows it when something else sets it.

    viser reports what the server itself assigns, too: such echoes come without a client and are left out. And while
    something that the user did still waits for the drawing thread, the state is behind the input and not shown in it:
    a slider would jump back under the pointer.

    Args:
        tab: whose state it is.
        handle: made by `tab.client.gui`.
        take: given what the user has set, on the thread that draws.
    """

    def __init__(self, tab: Tab, handle: viser.GuiInputHandle[Value], take: Callable[[Value], None]) -> None:
        self._tab, self._handle, self._take = tab, handle, take
        self._like = handle.value
        self._given, self._taken = 0, 0  # one thread counts each
        handle.on_update(self._updated)  # pyright: ignore[reportArgumentType]

    async def _updated(self, event: viser.GuiEvent[viser.GuiInputHandle[Value]]) -> None:
        if event.client is None:
            return
        value = event.target.value
        if not _sound(self._handle, self._like):
            return
        self._given += 1
        self._tab.do(lambda: self._set(value))

    def _set(self, value: Value) -> None:
        self._taken += 1
        self._take(value)

    @property
    def waiting(self) -> bool:
        """Whether something was entered that the state does not know yet."""
        return self._given != self._taken

    def show(self, value: Value, *, wrong: bool = False) -> None:
        """Bring it to the state.

        Args:
            value: of the state.
            wrong: what was entered cannot be used, so it is not in the state, and stays where it is.
        """
        if not self.waiting and not wrong and self._handle.value != value:
            self._handle.value = value


def only_read(handle: Handle) -> Handle:
    """An input whose value is read when a button is pressed; of strange values that a page sends it keeps none."""
    usual = handle.value

    async def updated(event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            _sound(handle, usual)

    handle.on_update(updated)  # pyright: ignore[reportArgumentType]
    return handle


def _sound(handle: viser.GuiInputHandle[Any], usual: object) -> bool:
    """Whether an input has a value that it can have; else it gets its usual one back."""
    if _alike(handle.value, usual):
        return True
    _log.warning("A value from the page is dropped: %r is none like %r", handle.value, usual)
    put_back(handle, usual)
    return False


def _alike(value: object, usual: object) -> bool:
    """Whether a value is of the kind that an input has: a strange page sends anything, such as a file to a slider."""
    if isinstance(usual, int | float) and not isinstance(usual, bool):
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if isinstance(usual, tuple):
        return isinstance(value, tuple) and len(value) == len(usual) and all(map(_alike, value, usual))
    return type(value) is type(usual)


class Dropdown(Field[str]):
    """A Field whose options come and go."""

    def __init__(self, tab: Tab, handle: viser.GuiDropdownHandle[Any], take: Callable[[str], None]) -> None:
        super().__init__(tab, handle, take)
        self._dropdown = handle

    def offer(self, options: Sequence[str], value: str, *, wrong: bool = False) -> None:
        """Bring it to these options, each of which there is only once, and to one of them; `wrong` as in `show`."""
        if tuple(options) != self._dropdown.options:
            self._dropdown.options = tuple(options)
        self.show(value, wrong=wrong)


def frame_number(label: str, text: str) -> int | None:
    """A frame's number that was typed into a text field, None if nothing was. Raises InputError if it is no number."""
    given = text.strip()
    if given and not (given.isdecimal() and len(given) < 12):
        raise InputError(f"{label} is {given[:20]!r}; expected a whole number, or nothing.")
    return int(given) if given else None
