"""Database values, checked when they are read: a damaged one makes its row unusable, and no other."""

import logging
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from fitting_core.errors import InputError

T = TypeVar("T")
Count = Annotated[int, msgspec.Meta(ge=0, le=2**52)]
"""A count or an id."""
_LISTED = 10
"""Maximum number of warnings in the terminal: a completely damaged table would flood it."""
_log = logging.getLogger(__name__)


class DamagedValue(InputError):
    """A value of a row that cannot be read."""


class Columns:
    """A table row whose values are checked as they are read."""

    def __init__(self, row: sqlite3.Row) -> None:
        self._row = row

    def read(self, column: str, read: Callable[[Any], T]) -> T:
        """A value. `read` converts SQLite's value; its ValueError or TypeError becomes a DamagedValue."""
        try:
            return read(self._row[column])
        except (ValueError, TypeError, RecursionError, OverflowError) as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
            raise DamagedValue(f"its {column.replace('_', ' ')} cannot be read ({reason})") from error


class Damage:
    """The damaged rows of a database, each reported once in the terminal. Thread-safe.

    Args:
        path: of the database; None: report nothing.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._found: dict[str, None] = {}

    @property
    def found(self) -> tuple[str, ...]:
        """In words, in the order of discovery."""
        return tuple(self._found)

    def read(self, row: sqlite3.Row, name: str, make: Callable[[Columns], T]) -> T | None:
        """What `make` reads from a row; None if a value is damaged, which is reported under the row's name."""
        try:
            return make(Columns(row))
        except DamagedValue as error:
            self.note(f"{name}: {error}")
            return None

    def note(self, what: str) -> None:
        """Record a damaged row, in words, unless it was recorded before."""
        text = f"{what}; it is left out"
        if text in self._found:
            return
        self._found[text] = None
        if self._path is None:
            return
        if len(self._found) <= _LISTED:
            _log.warning("%s is damaged: %s. If you have a backup, restore it.", self._path, text)
        elif len(self._found) == _LISTED + 1:
            _log.warning("%s: more values are damaged; the app lists all.", self._path)


@contextmanager
def undamaged(path: Path) -> Iterator[None]:
    """Turns damage of a clip's row into an InputError: without it there is no project. `path` is the database's."""
    try:
        yield
    except DamagedValue as error:
        raise InputError(f"{path}: of the clip, {error}. It is damaged: restore it from a backup.") from error


def of(kind: Any) -> Callable[[Any], Any]:
    """Reads a value of a type that msgspec supports, without conversion."""
    return lambda value: msgspec.convert(value, kind)


def or_none(read: Callable[[Any], T]) -> Callable[[Any], T | None]:
    """The same, allowing NULL."""
    return lambda value: None if value is None else read(value)


def json_of(kind: Any) -> Callable[[Any], Any]:
    """Reads JSON text."""
    return lambda value: msgspec.json.decode(text(value), type=kind)


def text(value: Any) -> str:
    """Any text."""
    return msgspec.convert(value, str)


def line(value: Any) -> str:
    """A text of one line, such as a name."""
    found = text(value)
    if not 0 < len(found) <= 200 or not found.isprintable():
        raise ValueError(f"it has {len(found)} characters, expected one line of 1 to 200")
    return found


def time(value: Any) -> datetime:
    """A plausible time, with its time zone."""
    found = datetime.fromisoformat(text(value))
    if found.tzinfo is None or not 1970 <= found.year < 2200:
        raise ValueError(f"{text(value)[:40]!r} is not a valid time")
    return found
