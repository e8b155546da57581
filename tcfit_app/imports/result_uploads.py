"""Files that a browser sends: kept under names of our own while they are read."""

import io
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fitting_core.errors import InputError
from tcfit_app.project.storage.names import name_of_file

_STARTS: dict[bytes, str] = {b"PK\x03\x04": ".zip", b"\x1f\x8b": ".tar.gz", b"\x80": ".pkl"}
"""By a file's first bytes: what it is called here. The name that it came with never becomes part of a path."""


@contextmanager
def upload(name: str, content: bytes) -> Iterator[Path]:
    """An uploaded file on the disk, as long as the block lasts; errors about it have the name that the user knows.

    Raises:
        InputError: It is nothing that is read from uploads.
    """
    shown = name_of_file(name)
    suffix = next((suffix for start, suffix in _STARTS.items() if content.startswith(start)), None)
    if suffix is None:
        found = "is empty" if not content else "is no result"
        raise InputError(f"{shown}: {found}; expected an npz, a zip of SMPLify-X's results, or one of their pickles.")
    if suffix == ".zip" and _has_arrays(content):
        suffix = ".npz"
    with tempfile.TemporaryDirectory(prefix="tcfit-upload-") as folder:
        path = Path(folder) / f"upload{suffix}"
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
