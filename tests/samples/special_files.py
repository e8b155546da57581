"""What may lie where a file is expected: a reader that opens it waits for ever, or fills the memory."""

import os
from collections.abc import Callable
from pathlib import Path


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def full(path: Path) -> None:
    path.symlink_to("/dev/full")


SPECIAL: tuple[Callable[[Path], None], ...] = (pipe, endless, full)
"""What makes each kind."""
