"""What things may be called. Names are shown and never become paths."""

from fitting_core.errors import InputError
from fitting_core.files.atomic import LONGEST

_LONGEST = 200
_ROOM = 30
"""Bytes for what is put around a file's name while it is written."""


def checked_name(name: str) -> str:
    """A name that a user gave, without blanks around it.

    Raises:
        InputError: It is empty, too long, or would not show on one line.
    """
    stripped = name.strip()
    if not stripped or len(stripped) > _LONGEST or not stripped.isprintable():
        raise InputError(f"{name[:50]!r} cannot be a name; expected one line of 1 to {_LONGEST} characters.")
    return stripped


def portable(name: str) -> str:
    """A file's name without what some system or other does not allow in one."""
    return "".join("_" if c in '/\\:*?"<>|' else c for c in name)


def file_name(name: str, ending: str) -> str:
    """A file's name that every system takes.

    Args:
        name: What it is about; its end is left out if it is too long.
        ending: What follows, which stays.
    """
    most = LONGEST - _ROOM - len(ending.encode())
    return portable(name).encode()[:most].decode(errors="ignore") + ending


def name_of_file(stem: str) -> str:
    """A name made from a file's, which can hold anything."""
    return "".join(c if c.isprintable() else "?" for c in stem).strip()[:_LONGEST] or "?"
