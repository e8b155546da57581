"""Other processes for tests of what happens to a project when one dies or may not write."""

import os
import signal
import time
from collections.abc import Callable

import pytest

INTERRUPTIBLE = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""Begins the code of a process that Ctrl-C is to end: one that a shell started in its background ignores that, and so
would all of its children."""
needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork processes")


def start(work: Callable[[Callable[[str], None]], None]) -> tuple[int, int]:
    """Run `work` in a forked process; it gets a function that reports a line. Returns its id and the pipe's end.

    Forked, as a new interpreter takes seconds to import torch.
    """
    source, sink = os.pipe()
    child = os.fork()
    if child:
        os.close(sink)
        return child, source
    os.close(source)
    code = 1
    try:
        work(lambda line: os.write(sink, f"{line}\n".encode()) and None)
        code = 0
    except BaseException as error:
        os.write(sink, f"{type(error).__name__}: {error}\n".encode())
    finally:
        os._exit(code)


def ended(child: int, source: int) -> tuple[int, list[str]]:
    """Exit status of a process once it has ended, and the whole lines that it reported."""
    text = b""
    while block := os.read(source, 1 << 16):
        text += block
    os.close(source)
    status = os.waitpid(child, 0)[1]
    return status, text.decode().split("\n")[:-1]


def killed_after(seconds: float, work: Callable[[Callable[[str], None]], None]) -> list[str]:
    """What a process had reported when SIGKILL hit it: that long after its first line, or earlier by its own hand."""
    child, source = start(work)
    first = os.read(source, 1)
    until = time.monotonic() + seconds
    while time.monotonic() < until and os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    status, lines = ended(child, source)
    assert os.WIFSIGNALED(status), lines
    return [first.decode() + lines[0], *lines[1:]] if lines else []


def succeeded(work: Callable[[Callable[[str], None]], None]) -> list[str]:
    """What a process has reported that must end well."""
    status, lines = ended(*start(work))
    assert status == 0, lines
    return lines
