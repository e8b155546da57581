"""Calibrations are small text files: anything else is refused before it is read."""

from pathlib import Path

from fitting_core.files.regular import refusal

_MAX_BYTES = 256 * 2**20
"""COLMAP's list of images includes their points: some 100 kB per image."""


def text_of(path: Path, *, most: int = _MAX_BYTES) -> str:
    """The file's text.

    Args:
        path: The file.
        most: Largest size in bytes.

    Raises:
        ValueError: It is not a file, is too large, or is not text.
        OSError: It does not exist, or cannot be read.
    """
    if why := refusal(path, most=most):
        raise ValueError(why)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("is not UTF-8 text") from None
