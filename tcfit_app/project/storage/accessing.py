"""File system errors in words for users."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fitting_core.errors import InputError


@contextmanager
def accessing(path: Path) -> Iterator[None]:
    """Turns file system errors into an InputError naming the file or folder."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read or written ({error.strerror or error}). Free space, or allow reading and writing "
            "there; what was stored before is still there."
        ) from error
