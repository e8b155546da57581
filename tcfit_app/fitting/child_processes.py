"""Worker processes: new interpreters that ignore Ctrl-C and end with their parent."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

CONTEXT = multiprocessing.get_context("spawn")
"""Start method. A forked process may hang if its parent has used torch."""


@contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Processes started inside ignore Ctrl-C, which a terminal sends to all of them; their parent handles it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def end_with_parent() -> None:
    """Call this in a worker process: it then ends whenever and however its parent does, and not by Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@dataclass
class Child:
    """A process that works for this one, and the pipe between them."""

    process: BaseProcess
    pipe: Connection

    @classmethod
    def started(cls, serve: Callable[..., None], *arguments: object) -> "Child":
        """Start a process that calls `serve` with its end of the pipe and the arguments."""
        ours, theirs = CONTEXT.Pipe()
        process = CONTEXT.Process(target=serve, args=(theirs, *arguments), daemon=True)
        with deaf_to_interrupts():
            process.start()
        theirs.close()
        return cls(process, ours)

    def how_it_ended(self) -> str:
        """Wait for the end of a process that has closed its pipe; the rest of "Its process ended ..."."""
        self.process.join()
        code = self.process.exitcode
        return f"by signal {-code}" if code is not None and code < 0 else f"with exit code {code}"

    def end(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.join()
        self.pipe.close()
