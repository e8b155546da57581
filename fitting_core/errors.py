"""The one exception for what a user gave (files, options, clips), and names in its messages."""

from collections.abc import Iterable
from itertools import islice


class InputError(ValueError):
    """Something that the user gave cannot be used.

    The message says what was found, what was expected and what to do. The command line prints it without a
    traceback; a caller of the library catches it as a ValueError.
    """


def short_name(name: object, *, most: int = 40) -> str:
    """A name from a file: the letters of it that can be shown, up to so many."""
    text = "".join(c if c.isprintable() else "?" for c in str(name)[: most + 1])
    return text if len(text) <= most else f"{text[: most - 3]}..."


def some_of(names: Iterable[object], *, most: int = 8) -> str:
    """The first of some names, with commas between them, and how many more there are; "nothing" where there is none."""
    names = list(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(short_name(name) for name in islice(names, most)) or "nothing") + more
