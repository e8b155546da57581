"""Opening result files: torch's, pickles and joblib's, compressed or not."""

import bz2
import gzip
import io
import lzma
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from fitting_core.errors import InputError
from fitting_core.files.regular import most_unpacked, regular_file
from fitting_core.files.restricted_pickle import Stream
from fitting_core.files.torch_pickles import MAX_BYTES, of_torch_zip, unpickled

_LZ4 = b"\x04\x22\x4d\x18"
_PICKLE = b"\x80"


class _Inflated(io.RawIOBase):
    """A zlib stream as a file.

    Args:
        file: Where it lies.
    """

    def __init__(self, file: BinaryIO) -> None:
        super().__init__()
        self._file, self._packed = file, zlib.decompressobj()

    def readable(self) -> bool:
        """It can only be read."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer, or a part of it; 0 at the end."""
        found = b""
        while not found and not self._packed.eof:
            source = self._packed.unconsumed_tail or self._file.read(2**16)
            found = self._packed.decompress(source, len(buffer))
            if not source and not found:
                raise EOFError("the compressed data ends early")
        buffer[: len(found)] = found
        return len(found)


_UNPACKED: dict[bytes, Callable[[BinaryIO], Any]] = {
    b"\x78": lambda file: io.BufferedReader(_Inflated(file), 2**16),
    b"\x1f\x8b": lambda file: gzip.GzipFile(fileobj=file),
    b"BZh": bz2.BZ2File,
    b"\x5d\x00": lzma.LZMAFile,
    b"\xfd7zXZ": lzma.LZMAFile,
}
"""joblib's compression formats, by first bytes: zlib, gzip, bz2, lzma, xz."""


@contextmanager
def opened_result(path: Path) -> Iterator[Any]:
    """The content of a file of Python objects while the block lasts: arrays in it are read on access.

    Args:
        path: Of a plain file.

    Yields:
        Usually a dictionary; None if it is not a file of Python objects.

    Raises:
        InputError: It is damaged, too large, or refers to what could run code.
    """
    with ExitStack() as open_files:
        file = open_files.enter_context(regular_file(path).open("rb"))
        start = file.read(8)
        file.seek(0)
        if start.startswith(b"PK"):
            try:
                archive = open_files.enter_context(zipfile.ZipFile(file))
            except Exception as error:  # a changed byte makes zipfile raise any of a dozen types
                if path.suffix.lower() not in (".npz", ".zip"):
                    raise InputError(f"is damaged or was cut off ({str(error)[:80]})") from error
                yield None
            else:
                yield _of_zip(archive, most_unpacked(path.stat().st_size, MAX_BYTES))
        elif start.startswith(_PICKLE):
            yield unpickled(Stream(file, path.stat().st_size, most=MAX_BYTES))
        elif start.startswith(_LZ4):
            raise InputError("is packed with lz4, which cannot be read here. Save it with another compression")
        else:
            unpack = next((unpack for magic, unpack in _UNPACKED.items() if start.startswith(magic)), None)
            yield None if unpack is None else _of_packed(unpack, file)


def _of_packed(unpack: Callable[[BinaryIO], Any], file: BinaryIO) -> Any:
    try:
        holds_pickle = unpack(file).read(1) == _PICKLE
    except (OSError, EOFError, zlib.error, lzma.LZMAError):
        return None
    most = most_unpacked(file.seek(0, io.SEEK_END), MAX_BYTES)
    file.seek(0)
    return unpickled(Stream(unpack(file), None, most=most)) if holds_pickle else None


def _of_zip(archive: zipfile.ZipFile, left: int) -> Any:
    members = {member.filename: member for member in archive.infolist()}
    if (size := sum(member.file_size for member in members.values())) > left:
        raise InputError(f"unpacks to {size / 2**30:.1f} GB, expected at most {left / 2**30:.1f} GB of its size")
    pickled = next((name for name in members if PurePosixPath(name).name == "data.pkl"), None)
    return None if pickled is None else of_torch_zip(archive, pickled)
