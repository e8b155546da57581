"""Valid names. Names are shown, and never become paths."""

from fitting_core.errors import InputError
from fitting_core.files.atomic import LONGEST

_LONGEST = 200
_ROOM = 30
"""Bytes reserved for what is added to a file's name while it is written."""


def checked_name(name: str) -> str:
    """A name given by a user, stripped of surrounding blanks. Raises InputError if it is empty, too long, or not a
    single line."""
    stripped = name.strip()
    if not stripped or len(stripped) > _LONGEST or not stripped.isprintable():
        raise InputError(f"{name[:50]!r} cannot be a name; expected one line of 1 to {_LONGEST} characters.")
    return stripped


def portable(name: str) -> str:
    """A file name without characters that some systems do not allow."""
    return "".join("_" if c in '/\\:*?"<>|' else c for c in name)


def file_name(name: str, ending: str) -> str:
    """A file name that is valid on every system.

    Args:
        name: What it is about; truncated if too long.
        ending: Appended, never truncated.
    """
    most = LONGEST - _ROOM - len(ending.encode())
    return portable(name).encode()[:most].decode(errors="ignore") + ending


def name_of_file(stem: str) -> str:
    """A name made from a file's name, which may contain anything."""
    return "".join(c if c.isprintable() else "?" for c in stem).strip()[:_LONGEST] or "?"
