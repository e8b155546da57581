"""Database values, each checked on its own: damage to one value does not affect the rest of the project."""

import logging
import sqlite3
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

T = TypeVar("T")
Count = Annotated[int, msgspec.Meta(ge=0, le=2**52)]
"""A count or an id."""
_LISTED = 10
"""Maximum number of warnings in the terminal: a completely damaged table would flood it."""
UNKNOWN_TIME = datetime.fromtimestamp(0, UTC)
"""Replaces a damaged time."""
_log = logging.getLogger(__name__)


class Damage:
    """The damage found in a database, each item reported once in the terminal. Thread-safe.

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

    def note(self, what: str, instead: str) -> None:
        """Record a damaged value, unless it was recorded before.

        Args:
            what: Where it is, and what is wrong.
            instead: What happens instead.
        """
        text = f"{what}; {instead}"
        if text in self._found:
            return
        self._found[text] = None
        if self._path is None:
            return
        if len(self._found) <= _LISTED:
            _log.warning("%s is damaged: %s. If you have a backup, restore it.", self._path, text)
        elif len(self._found) == _LISTED + 1:
            _log.warning("%s: more values are damaged; the app lists all.", self._path)


class Columns:
    """A table row whose values are read individually.

    Args:
        row: from SQLite.
        name: of the row, for users.
        damage: collects errors.
    """

    def __init__(self, row: sqlite3.Row, name: str, damage: Damage) -> None:
        self._row, self._name, self._damage = row, name, damage

    def read(self, column: str, read: Callable[[Any], T], default: T, instead: str) -> T:
        """A value, or its replacement.

        Args:
            column: its name.
            read: converts SQLite's value; raises ValueError or TypeError.
            default: used if it does.
            instead: what happens then, in words for users.
        """
        try:
            return read(self._row[column])
        except (ValueError, TypeError, RecursionError, OverflowError) as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
            self._damage.note(f"{self._name}: its {column.replace('_', ' ')} cannot be read ({reason})", instead)
            return default


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
