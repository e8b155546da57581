"""Whether a path is a file that can be read: a plain one, and not of an absurd size.

Opening a named pipe waits for a writer, and a device like /dev/zero never ends: both are recognised without opening
them.
"""

import os
import re
import stat
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fitting_core.errors import InputError

MAX_BYTES = 4 * 2**30
"""Maximum size of a file that is read whole: SMPL-X's pickles have 0.5 GB, an hour of keypoints in JSON 1 GB."""
StrPath = str | os.PathLike[str]
"""A path as users of the library give it."""
_KINDS: dict[Callable[[int], bool], str] = {
    stat.S_ISDIR: "a folder",
    stat.S_ISFIFO: "a named pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISCHR: "a device",
    stat.S_ISBLK: "a device",
}
_KERNEL = (("proc",), ("sys",))
"""Roots whose files say that they are empty, and may never be read to an end."""


def refusal(path: Path, *, most: int | None = MAX_BYTES, expected: str = "a file") -> str:
    """Why a path cannot be read as a file, in words that follow its name; empty if it can. Raises OSError if there is
    nothing at the path, or it may not be looked at.

    Args:
        path: Links are followed.
        most: Bytes; None: any number.
        expected: What kind of file, in words.
    """
    try:
        found = path.stat()
    except ValueError:  # a null byte
        return f"is not a path, expected that of {expected}"
    if not stat.S_ISREG(found.st_mode):
        kind = next((name for is_kind, name in _KINDS.items() if is_kind(found.st_mode)), "something else")
        return f"is {kind}, expected {expected}"
    if not found.st_size and path.resolve().parts[1:2] in _KERNEL:
        return f"is a file of the kernel, expected {expected}"
    if most is not None and found.st_size > most:
        unit, name = (2**30, "GB") if most >= 2**30 else (2**20, "MB")
        return f"has {found.st_size / unit:.1f} {name}, expected at most {most / unit:.1f} {name}"
    return ""


def regular_file(path: Path, *, most: int | None = MAX_BYTES) -> Path:
    """The path, if it is that of a file that can be read.

    Args:
        path: Links are followed.
        most: Bytes; None: any number.

    Raises:
        InputError: It is a folder, a named pipe, a socket or a device, or the file is too large.
        OSError: There is nothing at the path, or it may not be looked at.
    """
    if why := refusal(path, most=most):
        raise InputError(f"{path}: {why}.")
    return path


def most_unpacked(size: int, most: int = MAX_BYTES) -> int:
    """Bytes that a compressed file of `size` bytes may expand to, at most `most`: poses and vertices shrink to a tenth
    at best, a bomb to a thousandth."""
    return min(2**28 + 50 * size, most)


def legible(name: str) -> str:
    """A name as text: what is not UTF-8 in it, as file names may have it, becomes question marks in diamonds."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def at_home(path: str | Path) -> Path:
    """A path with the user's folder for a leading ~; where there is no such user it stays, as in a shell."""
    return Path(os.path.expanduser(path))


_DEEPEST = 32
"""Parts of a key. The parser's memory goes with the square: a key of 60 kB took 3.8 GB."""
_PART = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_DEEP = re.compile(f"(?:{_PART}){{{_DEEPEST}}}")


def parsed_toml(text: str) -> dict[str, Any]:
    """The table that a text holds. Raises ValueError if it is not TOML, or is nested too deeply."""
    if found := _DEEP.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"line {line} has a key of more than {_DEEPEST} parts with dots between them")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
