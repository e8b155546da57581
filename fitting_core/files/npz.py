"""npz archives: written whole, and read with care, since strangers may have made them: plain arrays only."""

import math
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from fitting_core.files.atomic import replacing
from fitting_core.files.regular import most_unpacked, refusal

MAX_BYTES = 2 * 2**30
"""Maximum unpacked size of an archive; an hour of poses has 0.2 GB."""
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def write_npz(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays by name, whole or not at all; equal arrays give equal bytes. Raises OSError if that fails."""
    with replacing(path) as draft:
        np.savez_compressed(draft, allow_pickle=False, **arrays)


def read_npz(path: Path, keys: Collection[str] | None = None, *, most: int = MAX_BYTES) -> dict[str, np.ndarray]:
    """The arrays of an archive by name.

    Sizes are checked before anything is unpacked: neither a zip that unpacks to more than its table says nor an array
    that declares more elements than it has takes memory.

    Args:
        path: The archive.
        keys: Read only these; None: all.
        most: Unpacked bytes of all that is read.

    Raises:
        OSError: It cannot be opened.
        ValueError: It is no npz archive of plain arrays, is damaged, or too large; the message says which.
    """
    _check_file(path)
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = {m.filename.removesuffix(".npy"): m for m in archive.infolist() if m.filename.endswith(".npy")}
            chosen = {name: m for name, m in members.items() if keys is None or name in keys}
            size = sum(member.file_size for member in chosen.values())
            if size > (most := most_unpacked(path.stat().st_size, most)):
                raise ValueError(
                    f"unpacks to {size / 2**30:.1f} GB, expected at most {most / 2**30:.1f} GB of its size"
                )
            return {name: _array(archive, name, member) for name, member in chosen.items()}
    except (OSError, ValueError):
        raise
    # A changed byte makes zipfile, zlib and numpy raise any of a dozen types: all mean the same to the user.
    except Exception as error:
        raise ValueError(f"is not a complete npz archive, it is damaged or was cut off ({error})") from error


def npz_names(path: Path) -> tuple[str, ...]:
    """Names of an archive's arrays, without reading them.

    Raises:
        OSError: It cannot be opened.
        ValueError: It is no npz archive.
    """
    _check_file(path)
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            return tuple(name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy"))
    except OSError:
        raise
    except Exception as error:  # as in `read_npz`
        raise ValueError(f"is not an npz archive, it is damaged or was cut off ({error})") from error


def _check_file(path: Path) -> None:
    if why := refusal(path):
        raise ValueError(why)


def _array(archive: zipfile.ZipFile, name: str, member: zipfile.ZipInfo) -> np.ndarray:
    try:
        with archive.open(member) as stream:
            _check(stream, name, member.file_size)
        with archive.open(member) as stream:
            return npy.read_array(stream, allow_pickle=False)
    except (OSError, EOFError, RuntimeError, zipfile.BadZipFile) as error:
        raise ValueError(f"'{name}' is damaged ({error})") from error


def _check(stream: IO[bytes], name: str, size: int) -> None:
    version = npy.read_magic(stream)
    if version not in _HEADERS:
        raise ValueError(f"'{name}' is of npy version {version}, expected 1.0 or 2.0")
    shape, _, dtype = _HEADERS[version](stream)
    if dtype.hasobject:
        raise ValueError(f"'{name}' is an array of Python objects, expected numbers")
    if math.prod(shape) * dtype.itemsize > size:
        raise ValueError(f"'{name}' declares the shape {shape}, and holds {size} bytes")
