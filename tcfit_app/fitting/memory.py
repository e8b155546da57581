"""Memory that was freed goes back to the system."""

import ctypes
import sys


def give_back() -> None:
    """Ask the C library to return what it keeps of freed memory, where it can: glibc's on Linux.

    A fit's large temporaries leave it with hundreds of megabytes that nobody uses: of 1365 MB that a review took after
    five fits, 317 went back.
    """
    if sys.platform == "linux" and (trim := getattr(ctypes.CDLL(None), "malloc_trim", None)) is not None:
        trim(0)
