"""The one exception for what a user gave (files, options, clips), and names in its messages."""

from collections.abc import Iterable

_LONGEST = 40
"""Characters of a name from a file that are shown in a message."""


class InputError(ValueError):
    """Something that the user gave cannot be used.

    The message says what was found, what was expected and what to do. The command line prints it without a
    traceback; a caller of the library catches it as a ValueError.
    """

    def __str__(self) -> str:
        """The message, as `printable`: it may hold names from files."""
        return printable(super().__str__())


_CONTROL = dict.fromkeys((*range(32), *range(127, 160), *range(0x202A, 0x202F), *range(0x2066, 0x206A)), "?")
"""Control characters, and those that reverse the direction of text."""
for _kept in "\n\t":
    del _CONTROL[ord(_kept)]


def printable(text: str) -> str:
    """A text in which names from files cannot control the terminal: question marks in place of control characters."""
    return text.translate(_CONTROL)


def some_of(names: Iterable[object], *, most: int = 8) -> str:
    """The first of some names in a file, shortened, with the number of the others; "nothing" without names."""
    found = [str(name) for name in names]
    shown = ["".join(c if c.isprintable() else "?" for c in name) for name in found[:most]]
    short = [name if len(name) <= _LONGEST else f"{name[: _LONGEST - 3]}..." for name in shown]
    return (", ".join(short) or "nothing") + (f" and {len(found) - most} more" if len(found) > most else "")
