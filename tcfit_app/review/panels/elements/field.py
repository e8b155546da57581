"""An input of viser's that shows part of a tab's state."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import viser

from fitting_core.errors import InputError
from tcfit_app.review.tab.tab import Tab

Value = TypeVar("Value", str, int, float, Any)
When = Callable[[], bool]


def always() -> bool:
    """Nothing depends on the state."""
    return True


class Field(Generic[Value]):
    """Lets the user set a value, and follows it when something else sets it.

    viser also reports values that the server assigned: such echoes come without a client and are ignored. While a
    user's change is still waiting for the drawing thread, the state is behind the input and is not shown in it:
    otherwise a slider would jump back under the pointer.

    Args:
        tab: the tab whose state it shows.
        handle: made by `tab.client.gui`.
        take: receives what the user set, on the drawing thread.
        read: its value in the state, for `draw`; None keeps what it shows.
        off: whether it cannot be set now, for `draw`.
        when: whether it is shown, for `draw`.
    """

    def __init__(
        self,
        tab: Tab,
        handle: viser.GuiInputHandle[Value],
        take: Callable[[Value], object],
        read: Callable[[], Value | None] = lambda: None,
        *,
        off: Callable[[], object] = lambda: False,
        when: When = always,
    ) -> None:
        self._tab, self._handle, self._take, self._read, self._off = tab, handle, take, read, off
        self._when = when
        self._given, self._taken = 0, 0  # one thread counts each
        handle.on_update(self._updated)  # pyright: ignore[reportArgumentType]

    async def _updated(self, event: viser.GuiEvent[viser.GuiInputHandle[Value]]) -> None:
        if event.client is None:
            return
        value = event.target.value
        self._given += 1
        self._tab.do(lambda: self._set(value))

    def _set(self, value: Value) -> None:
        self._taken += 1
        self._take(value)

    def draw(self) -> None:
        """Update to the state."""
        if (value := self._read()) is not None:
            self.show(value)  # pyright: ignore[reportArgumentType] - the solved type variable
        if self._handle.visible is not (there := self._when()):
            self._handle.visible = there
        self.enable(not self._off())

    @property
    def waiting(self) -> bool:
        """Whether something was entered that the state does not know yet."""
        return self._given != self._taken

    def show(self, value: Value) -> None:
        """Show a value, unless something else was entered meanwhile."""
        if not self.waiting and self._handle.value != value:
            self._handle.value = value

    def enable(self, on: bool) -> None:
        """Whether the user can set it."""
        if self._handle.disabled is on:
            self._handle.disabled = not on


def for_writers(tab: Tab, *handles: viser.GuiInputHandle[Any]) -> None:
    """Disable inputs of what a read-only project cannot take."""
    for handle in handles:
        handle.disabled = tab.session.project.read_only


class Dropdown(Field[str]):
    """A Field with options; `options`, if given, returns those of now, which must be distinct."""

    def __init__(
        self,
        tab: Tab,
        handle: viser.GuiDropdownHandle[Any],
        take: Callable[[str], object],
        read: Callable[[], str | None] = lambda: None,
        *,
        options: Callable[[], Sequence[str]] | None = None,
        off: Callable[[], object] = lambda: False,
        when: When = always,
    ) -> None:
        super().__init__(tab, handle, take, read, off=off, when=when)
        self._dropdown, self._options = handle, options

    def draw(self) -> None:
        """See `Field.draw`."""
        if self._options is not None and (options := tuple(self._options())) != self._dropdown.options:
            self._dropdown.options = options
        super().draw()


_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number typed into a field: its valid range, and how to state it."""

    label: str
    """The field's."""
    low: float
    high: float
    whole: bool = False
    of: str = ""
    """Where the bounds come from, in words."""

    @property
    def range(self) -> str:
        """In words: "a whole number, 2 to 157 (the clip has 157 frames)"."""
        kind = "a whole number" if self.whole else "a number"
        return f"{kind}, {self.low:,.10g} to {self.high:,.10g}" + (f" ({self.of})" if self.of else "")

    def read(self, given: str) -> float:
        """What was typed, as an int where a whole number is required. Raises InputError with the field's label."""
        text = given.strip()
        value = float(text) if _NUMBER.fullmatch(text) else math.nan
        if not self.low <= value <= self.high or (self.whole and value != int(value)):
            raise InputError(f"{self.label} is {text[:20] or 'empty'}; expected {self.range}.")
        return int(value) if self.whole else value

    @staticmethod
    def shown(value: float) -> str:
        """A value as the field shows it."""
        return f"{value:.10g}"


class NumberField(Field[str]):
    """A Field for a number. Its input is a text: viser's own number input drops letters silently, so that 1e9
    becomes 19, and silently clamps what is out of range.

    Args:
        tab: the tab whose state it shows.
        handle: made by `tab.client.gui.add_text`.
        take: receives what the user typed.
    """

    def show(self, value: str) -> None:
        """See `Field.show`; another spelling of the same value, such as 5. or 1e2, stays."""
        typed = self._handle.value.strip()
        same = _NUMBER.fullmatch(typed) is not None and Number.shown(float(typed)) == value
        if not same:
            super().show(value)


def frame_number(label: str, text: str) -> int | None:
    """A frame number typed into a text field, None if empty. Raises InputError if it is not a number."""
    given = text.strip()
    if given and not (given.isdecimal() and len(given) < 12):
        raise InputError(f"{label} is {given[:20]!r}; expected a whole number, or nothing.")
    return int(given) if given else None
