"""An input of viser's that shows part of a tab's state."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import viser

from fitting_core.errors import InputError
from tcfit_app.review.tab.tab import Tab
from tcfit_app.server.viser_bridge import put_back

Value = TypeVar("Value", str, int, float, Any)


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


def take_uploads(tab: Tab, handle: viser.GuiUploadButtonHandle, take: Callable[[viser.UploadedFile], None]) -> None:
    """Do something with each file that is uploaded, on the thread that draws; viser keeps none of them."""

    async def uploaded(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
        file = event.target.value  # now: another upload may take its place
        put_back(handle, viser.UploadedFile(name="", content=b""))
        tab.do(lambda: take(file))

    handle.on_upload(uploaded)


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


_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number that is typed into a field: what it may be, and how that is said."""

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
        """What was typed, as an int where it is to be whole. Raises InputError, in the field's own words."""
        text = given.strip()
        value = float(text) if _NUMBER.fullmatch(text) else math.nan
        if not self.low <= value <= self.high or (self.whole and value != int(value)):
            raise InputError(f"{self.label} is {text[:20] or 'empty'}; expected {self.range}.")
        return int(value) if self.whole else value

    @staticmethod
    def shown(value: float) -> str:
        """A value as the field has it."""
        return f"{value:.10g}"


class NumberField(Field[str]):
    """A Field for a number. Its input is a text: viser's own for numbers drops letters without a word, so that 1e9
    becomes 19, and puts what is out of range right, without a word too.

    Args:
        tab: whose state it is.
        handle: made by `tab.client.gui.add_text`.
        take: given what the user has typed.
    """

    def show(self, value: str, *, wrong: bool = False) -> None:
        """See `Field.show`; what is typed in another way, such as 5. or 1e2, stays."""
        typed = self._handle.value.strip()
        same = _NUMBER.fullmatch(typed) is not None and Number.shown(float(typed)) == value
        super().show(value, wrong=wrong or same)


def frame_number(label: str, text: str) -> int | None:
    """A frame's number that was typed into a text field, None if nothing was. Raises InputError if it is no number."""
    given = text.strip()
    if given and not (given.isdecimal() and len(given) < 12):
        raise InputError(f"{label} is {given[:20]!r}; expected a whole number, or nothing.")
    return int(given) if given else None
