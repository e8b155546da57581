"""Inputs and buttons of panels, whose callbacks only say what the user did."""

from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Any

import viser

if TYPE_CHECKING:
    from tcfit_app.page import Page


class Field:
    """An input that shows a part of the page's state.

    viser calls back for values that the server sets, too: these have no client, and are no wish of the user's.

    Args:
        page: whose state it is.
        handle: a number, dropdown, text, checkbox or slider.
        entered: takes what the user entered, on the drawing thread.
    """

    def __init__(self, page: "Page", handle: Any, entered: Callable[[Any], None]) -> None:
        self.handle = handle
        self._page, self._entered = page, entered
        self._waiting = 0
        handle.on_update(self._updated)

    async def _updated(self, event: viser.GuiEvent) -> None:
        if event.client is None:
            return
        value = event.target.value
        self._waiting += 1
        self._page.do(lambda: self._take(value))

    def _take(self, value: Any) -> None:
        self._waiting -= 1
        self._entered(value)

    @property
    def waiting(self) -> bool:
        """Whether something was entered that the state does not know yet."""
        return self._waiting > 0

    def show(self, value: Any, *, wrong: bool = False) -> None:
        """Bring it to the state's value, unless the user has gone on typing.

        Args:
            value: of the state.
            wrong: what was entered cannot be used, so it is not in the state, and stays where it is.
        """
        if not self._waiting and not wrong and self.handle.value != value:
            self.handle.value = value


def on_press(page: "Page", handle: Any, pressed: Callable[[], None]) -> None:
    """Have a button do something on the drawing thread."""

    async def clicked(event: viser.GuiEvent) -> None:
        page.do(pressed)

    handle.on_click(clicked)


def on_choice(page: "Page", handle: Any, chosen: Callable[[str], None]) -> None:
    """Have a group of buttons do something on the drawing thread."""

    async def clicked(event: viser.GuiEvent) -> None:
        if event.client is not None:
            value = event.target.value
            page.do(lambda: chosen(value))

    handle.on_click(clicked)


class Shown:
    """Properties of an element, each sent only when it changes."""

    def __init__(self, handle: Any) -> None:
        self.handle = handle
        self._sent: dict[str, Hashable] = {}

    def show(self, **properties: Any) -> None:
        """Bring it to these."""
        for name, value in properties.items():
            if name not in self._sent or self._sent[name] != value:
                self._sent[name] = value
                if getattr(self.handle, name) != value:
                    setattr(self.handle, name, value)
