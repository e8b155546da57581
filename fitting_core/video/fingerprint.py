"""Fast identification of videos and image folders by content."""

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file
from fitting_core.video.frame_names import natural_key

_BLOCK = 1 << 20
"""Bytes: of a file as many are read at its start, its middle and its end. All of it would take seconds a gigabyte."""


def fingerprint(path: Path) -> str:
    """Tells apart other content, though not every change: a hash of the size and of three blocks of a file.

    Of a folder: of its files' names and sizes, and of the content of the first one.

    Raises:
        InputError: It cannot be read.
    """
    try:
        if path.is_dir():
            return fingerprint_of_images(visible_files(path))
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is neither a file nor a folder; expected a video or a folder of images.")
        digest = hashlib.sha256()
        _add_blocks(digest, path)
        return digest.hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}). Allow reading it.") from error


def fingerprint_of_images(files: Sequence[Path]) -> str:
    """`fingerprint` of a folder that holds these files, in natural order. Raises OSError if one cannot be read."""
    digest = hashlib.sha256("\n".join(f"{file.name}/{file.stat().st_size}" for file in files).encode())
    for file in files[:1]:
        _add_blocks(digest, file)
    return digest.hexdigest()


def visible_files(folder: Path) -> list[Path]:
    """Those of a folder whose names do not begin with a dot, in natural order."""
    visible = [file for file in folder.iterdir() if file.is_file() and not file.name.startswith(".")]
    return sorted(visible, key=lambda file: natural_key(file.name))


def _add_blocks(digest: "hashlib._Hash", file: Path) -> None:
    with regular_file(file, most=None).open("rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        digest.update(str(size).encode())
        for start in (0, (size - _BLOCK) // 2, size - _BLOCK):
            stream.seek(max(0, start))
            digest.update(stream.read(_BLOCK))
