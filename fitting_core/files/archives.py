"""What a user downloaded: a file, a folder, a zip or a tar, all as one list of members.

Members are only ever read as streams and never unpacked under the names that an archive gives them.
"""

import lzma
import os
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file

MAX_DEPTH = 5
"""Folders below the given one that are looked into."""
MAX_MEMBER_BYTES = 2 * 2**30
"""Unpacked size of the largest member that is copied or read; SMPL-X's pickles are some 0.5 GB."""
MAX_LISTED_BYTES = 32 * 2**30
"""A compressed tar must be unpacked to be listed; listing stops at this size."""
_CHUNK = 2**20


@dataclass(frozen=True, kw_only=True)
class Member:
    """A file in a folder or archive."""

    path: PurePosixPath
    """Its path, which begins with the name of the folder or archive."""
    size: int
    """Unpacked size declared by the archive, bytes."""
    open: Callable[[], IO[bytes]]

    def copy_to(self, target: Path) -> None:
        """Write its bytes to a new file. Raises InputError if it is larger than a body model can be, or larger than its
        archive says."""
        if self.size > MAX_MEMBER_BYTES:
            limit = MAX_MEMBER_BYTES / 2**30
            raise InputError(f"{self.path}: unpacks to {self.size / 2**30:.1f} GB, expected at most {limit:.0f} GB")
        left = self.size
        with self.open() as source, target.open("xb") as copy:
            while chunk := source.read(_CHUNK):
                left -= len(chunk)
                if left < 0:
                    raise InputError(f"{self.path}: holds more than the {self.size} bytes that it declares")
                copy.write(chunk)


@contextmanager
def open_members(path: Path) -> Iterator[list[Member]]:
    """The files at a path: itself, those of a folder and its subfolders, or those in an archive. Raises InputError if
    it does not exist, is neither file nor folder, is a damaged or encrypted archive, or its members point outside."""
    if not path.exists():
        raise InputError(f"{path}: does not exist. Give a file, a folder of files or the downloaded archive.")
    try:
        if not path.is_dir():
            regular_file(path, most=None)
        suffixes = (opener for suffix, opener in _OPENERS.items() if path.name.lower().endswith(suffix))
        with (_folder if path.is_dir() else next(suffixes, _single))(path) as members:
            yield members
    except (zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError, EOFError) as error:
        raise InputError(f"{path}: is damaged or was cut off ({error}). Download it again.") from error
    # zipfile's way to say that a member is encrypted or packed in a way that it does not know.
    except RuntimeError as error:
        raise InputError(f"{path}: cannot be unpacked ({error}). Unpack it yourself and give the folder.") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read or copied ({error.strerror or error}).") from error


def files_below(folder: Path, *, depth: int = MAX_DEPTH) -> Iterator[Path]:
    """Files in a folder and some levels of subfolders, sorted, without hidden ones, pipes and devices."""
    base = len(folder.parts)
    for root, folders, files in os.walk(folder, followlinks=True):
        here = Path(root)
        visible = sorted(name for name in folders if not name.startswith("."))
        folders[:] = visible if len(here.parts) - base < depth else []
        yield from (here / name for name in sorted(files) if not name.startswith(".") and (here / name).is_file())


@contextmanager
def _single(path: Path) -> Iterator[list[Member]]:
    inside = PurePosixPath(path.absolute().parent.name, path.name)
    yield [Member(path=inside, size=path.stat().st_size, open=partial(path.open, "rb"))]


@contextmanager
def _folder(path: Path) -> Iterator[list[Member]]:
    top = path.absolute()
    yield [
        Member(
            path=PurePosixPath(top.name, *file.relative_to(top).parts),
            size=file.stat().st_size,
            open=partial(file.open, "rb"),
        )
        for file in files_below(top)
    ]


@contextmanager
def _zip(path: Path) -> Iterator[list[Member]]:
    with zipfile.ZipFile(path) as archive:
        yield [
            Member(path=_inside(path, info.filename), size=info.file_size, open=partial(archive.open, info))
            for info in archive.infolist()
            if not info.is_dir()
        ]


@contextmanager
def _tar(path: Path) -> Iterator[list[Member]]:
    with tarfile.open(path) as archive:
        yield list(_tar_members(path, archive))


def _tar_members(path: Path, archive: tarfile.TarFile) -> Iterator[Member]:
    listed = 0
    for info in archive:
        listed += info.size
        if listed > MAX_LISTED_BYTES:
            raise InputError(
                f"{path}: unpacks to more than {MAX_LISTED_BYTES / 2**30:.0f} GB. Give the model file itself."
            )
        if info.isfile():
            yield Member(path=_inside(path, info.name), size=info.size, open=partial(_extract, archive, info))


def _extract(archive: tarfile.TarFile, info: tarfile.TarInfo) -> IO[bytes]:
    stream = archive.extractfile(info)
    assert stream is not None, "only plain files are listed"
    return stream


def _inside(archive: Path, name: str) -> PurePosixPath:
    """A member's path below its archive's name; one that points elsewhere shows that the archive is not genuine."""
    member = PurePosixPath(name)
    if member.is_absolute() or ".." in member.parts or "\\" in name or ":" in name:
        raise InputError(
            f"{archive}: its member '{name}' points outside of it. Download it again from the official site."
        )
    return PurePosixPath(archive.name.split(".")[0]) / member


_OPENERS: dict[str, Callable] = {
    ".zip": _zip,
    ".whl": _zip,
    ".tar": _tar,
    ".tar.gz": _tar,
    ".tgz": _tar,
    ".tar.xz": _tar,
    ".tar.bz2": _tar,
}
