"""Files that appear whole or not at all."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LONGEST = 255
"""Bytes that a file's name may have: Linux and macOS; Windows counts UTF-16 units, which are fewer."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A file to write beside `path`, which takes its place when the block ends well, and vanishes when it does not."""
    draft = _draft(path, path.stem)
    if len(os.fsencode(draft.name)) > LONGEST >= len(os.fsencode(path.name)):
        draft = _draft(path, hashlib.sha256(os.fsencode(path.stem)).hexdigest())
    try:
        yield draft
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def _draft(path: Path, stem: str) -> Path:
    return path.with_name(f".{stem}.{os.getpid()}.partial{path.suffix}")
