"""A process in which things are measured: its memory and its threads are those of what it measures alone."""

from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import torch

from fitting_core.errors import InputError
from fitting_core.fit.fused import ready
from tcfit_app.fitting import child_processes

Measured = dict[str, tuple[float, str]]
"""Value and unit by what was measured."""


class Subject:
    """A process that measures when it is told to.

    Args:
        threads: Of a fit.
    """

    def __init__(self, threads: int) -> None:
        self._pipe, theirs = child_processes.CONTEXT.Pipe()
        self._process = child_processes.CONTEXT.Process(target=_serve, args=(theirs, threads), daemon=True)
        with child_processes.deaf_to_interrupts():
            self._process.start()
        theirs.close()

    def measure(self, function: Callable[..., Measured], *arguments: Any) -> Measured:
        """What a function of a module returns in there.

        Raises:
            InputError: It raised that.
            RuntimeError: It failed otherwise, or the process died.
        """
        self._pipe.send((function, arguments))
        try:
            answer = self._pipe.recv()
        except EOFError as error:
            self._process.join()
            raise RuntimeError(f"a measuring process ended with exit code {self._process.exitcode}") from error
        if isinstance(answer, Exception):
            raise answer
        return answer

    def close(self) -> None:
        """The process ends."""
        self._process.kill()
        self._process.join()
        self._pipe.close()


def _serve(pipe: Connection, threads: int) -> None:
    child_processes.end_with_parent()
    torch.set_num_threads(1)
    ready.use(threads=threads)
    with suppress(EOFError):
        while True:
            function, arguments = pipe.recv()
            try:
                answer: Measured | Exception = function(*arguments)
            except InputError as error:
                answer = error
            except Exception as error:  # raised again where it was asked for; it may not survive the pipe as it is
                answer = RuntimeError(f"{type(error).__name__}: {error}")
            pipe.send(answer)
