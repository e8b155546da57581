"""Locks that the system takes back when the process that holds them ends, however it ends.

Not filelock: on Windows it locks the first byte, and the names of who holds a project could not be read.
"""

import errno
import os
import sys
from pathlib import Path

_HELD = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)
"""Error numbers of a lock that is held: the first two of Unix, the others of Windows."""


def try_lock(descriptor: int) -> bool:
    """Lock an open file until its descriptor is closed; False if another process has the lock. Raises OSError if the
    file system has no locks, as some network drives."""
    try:
        _lock(descriptor)
    except OSError as error:
        if error.errno in _HELD:
            return False
        raise
    return True


def locked(path: Path) -> int | None:
    """Make a file if it is missing, and lock it.

    Returns:
        A descriptor for the caller to close. None if another process has the lock.

    Raises:
        OSError: The file cannot be opened, or the file system knows no locks.
    """
    while True:
        # No links: others who may write in the folder could redirect the file.
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            if not try_lock(descriptor):
                os.close(descriptor)
                return None
            if _is_at(descriptor, path):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # who had the lock has just deleted the file


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except FileNotFoundError:
        return False


if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int) -> None:
        # A byte behind all content, which must stay readable.
        os.lseek(descriptor, 1 << 20, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)

else:
    import fcntl

    def _lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
