"""Uploaded files, on disk for as long as they are read."""

import io
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.files.atomic import scratch_folder
from tcfit_app.project.storage.names import name_of_file

_STARTS: dict[bytes, str] = {
    b"PK\x03\x04": ".zip",
    b"\x1f\x8b": ".tar.gz",
    b"\x93NUMPY": ".npy",
    **dict.fromkeys(
        (b"\x80", b"\x78\x01", b"\x78\x5e", b"\x78\x9c", b"\x78\xda", b"BZh", b"\x5d\x00\x00", b"\xfd7zXZ"), ".pkl"
    ),
}
"""By a file's first bytes: its suffix here. The uploaded name never becomes part of a path."""


@contextmanager
def upload(name: str, content: bytes) -> Iterator[Path]:
    """An uploaded file on disk for the `with` block; errors use the name that the user knows. Raises InputError if it
    is not a kind of file that can be uploaded."""
    shown = name_of_file(name)
    suffix = next((suffix for start, suffix in _STARTS.items() if content.startswith(start)), None)
    if suffix is None:
        found = "is empty" if not content else "is not a result"
        raise InputError(
            f"{shown}: {found}; expected an npz, a zip of SMPLify-X's results, one of their pickles, or a learned "
            "system's result."
        )
    if suffix == ".zip" and _has_arrays(content):
        suffix = ".npz"
    with kept_as(f"upload{suffix}", content, shown) as path:
        yield path


@contextmanager
def kept_as(name: str, content: bytes, shown: str) -> Iterator[Path]:
    """A file with this name and content for the `with` block; errors use the user's name."""
    with scratch_folder() as folder:
        path = folder / name
        path.write_bytes(content)
        try:
            yield path
        except InputError as error:
            raise InputError(str(error).replace(str(path), shown).replace(path.name, shown)) from error


def _has_arrays(content: bytes) -> bool:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return any(member.endswith(".npy") for member in archive.namelist())
    except (OSError, ValueError, zipfile.BadZipFile):
        return False
