"""Impossible paths on the command line, refused before anything is read. Imports nothing heavy."""

import errno
import os
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from fitting_core.errors import InputError
from fitting_core.files.regular import legible

_LONGEST_NAME, _LONGEST = 255, 4095
"""Bytes of a file's name and of a path, as Linux has them."""
_NAMES_OR_PATHS = ("body_model", "detector")
"""Options that take a name or a path."""
_PRIOR = "pose_prior="
"""A value of --set that may name a file."""


def check_paths(options: Any) -> None:
    """Raise InputError for a path that is too long or not UTF-8.

    Results store the paths of their input, and OpenCV, SQLite and JSON accept only UTF-8. Without this check, such a
    name failed only after the fit.

    Args:
        options: A command's, with those of its groups.
    """
    for path in _paths_in(options):
        if why := _fault(path):
            raise InputError(f"{legible(str(path))[:200]}: {why}")


def _paths_in(options: Any) -> Iterator[Path]:
    if isinstance(options, Path):
        yield options
    elif isinstance(options, str):
        if options.startswith(_PRIOR):
            yield Path(options.removeprefix(_PRIOR))
    elif isinstance(options, tuple):
        for value in options:
            yield from _paths_in(value)
    elif is_dataclass(options):
        for field in fields(options):
            value = getattr(options, field.name)
            yield from _paths_in(Path(value) if field.name in _NAMES_OR_PATHS and value else value)


def _fault(path: Path) -> str:
    """Why the path is impossible; empty if it is not."""
    written = os.fsencode(path)
    if b"\0" in written:
        return "has a null character, which no path can have."
    if any(len(part) > _LONGEST_NAME for part in written.split(b"/")) or len(written) > _LONGEST:
        return f"is too long; expected names of at most {_LONGEST_NAME} bytes, and {_LONGEST} for the whole path."
    try:
        written.decode("utf-8")
    except UnicodeDecodeError:
        return "has a name that is not UTF-8. Rename it."
    try:
        path.stat()
    except OSError as error:  # other problems are reported where the path is used
        if error.errno == errno.ELOOP:
            return "is a link that leads to itself. Choose another place."
    return ""
