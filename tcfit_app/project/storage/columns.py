"""Values of the database, each checked by itself: a damaged one costs itself, and not the project."""

import logging
import sqlite3
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

T = TypeVar("T")
Count = Annotated[int, msgspec.Meta(ge=0, le=2**52)]
"""What counts something, or numbers it."""
_LISTED = 10
"""So much is told in the terminal: a table whose every row is damaged would fill it."""
UNKNOWN_TIME = datetime.fromtimestamp(0, UTC)
"""Stands in for a time that is damaged."""
_log = logging.getLogger(__name__)


class Damage:
    """What was found damaged in a database, each thing told once in the terminal. Thread-safe.

    Args:
        path: of the database; None: nothing is told.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._found: dict[str, None] = {}

    @property
    def found(self) -> tuple[str, ...]:
        """In words, in the order in which it was found."""
        return tuple(self._found)

    def note(self, what: str, instead: str) -> None:
        """Tell of a damaged value, unless it was told before.

        Args:
            what: Where it is, and what is wrong with it.
            instead: What becomes of it.
        """
        text = f"{what}; {instead}"
        if text in self._found:
            return
        self._found[text] = None
        if self._path is None:
            return
        if len(self._found) <= _LISTED:
            _log.warning("%s is damaged: %s. If there is a backup, take it from there.", self._path, text)
        elif len(self._found) == _LISTED + 1:
            _log.warning("%s: more values are damaged; the app lists them all.", self._path)


class Columns:
    """A row of a table, of which each value is read by itself.

    Args:
        row: as SQLite has it.
        name: of the row, for the user.
        damage: takes what is wrong.
    """

    def __init__(self, row: sqlite3.Row, name: str, damage: Damage) -> None:
        self._row, self._name, self._damage = row, name, damage

    def read(self, column: str, read: Callable[[Any], T], default: T, instead: str) -> T:
        """A value, or what stands in for it.

        Args:
            column: its name.
            read: makes it of what SQLite has; raises ValueError or TypeError.
            default: if it does.
            instead: what becomes of it then, in words for the user.
        """
        try:
            return read(self._row[column])
        except (ValueError, TypeError, RecursionError, OverflowError) as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
            self._damage.note(f"{self._name}: its {column.replace('_', ' ')} cannot be read ({reason})", instead)
            return default


def of(kind: Any) -> Callable[[Any], Any]:
    """Reads a value of a type as msgspec knows it; nothing is converted."""
    return lambda value: msgspec.convert(value, kind)


def or_none(read: Callable[[Any], T]) -> Callable[[Any], T | None]:
    """The same where there may be nothing."""
    return lambda value: None if value is None else read(value)


def json_of(kind: Any) -> Callable[[Any], Any]:
    """Reads a text of JSON."""
    return lambda value: msgspec.json.decode(text(value), type=kind)


def text(value: Any) -> str:
    """A text as it is."""
    return msgspec.convert(value, str)


def line(value: Any) -> str:
    """A text of one line, such as a name."""
    found = text(value)
    if not 0 < len(found) <= 200 or not found.isprintable():
        raise ValueError(f"it has {len(found)} characters, expected one line of 1 to 200")
    return found


def time(value: Any) -> datetime:
    """A moment in our age, with its time zone."""
    found = datetime.fromisoformat(text(value))
    if found.tzinfo is None or not 1970 <= found.year < 2200:
        raise ValueError(f"{text(value)[:40]!r} is no time of ours")
    return found
