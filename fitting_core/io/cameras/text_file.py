"""Calibrations are small texts: what else lies at a path is refused before it is read."""

from pathlib import Path

from fitting_core.files.regular import refusal

_MAX_BYTES = 256 * 2**20
"""COLMAP's list of images has its points in it: some 100 kB an image."""


def text_of(path: Path, *, most: int = _MAX_BYTES) -> str:
    """The file's text.

    Args:
        path: The file.
        most: Bytes that it may have.

    Raises:
        ValueError: It is no file, too large, or no text.
        OSError: It is not there, or cannot be read.
    """
    if why := refusal(path, most=most):
        raise ValueError(why)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("is no text in UTF-8") from None
