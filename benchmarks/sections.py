"""A stopwatch that hangs itself around functions of the fitter and sums up the time spent in each, without nesting."""

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch


@dataclass(frozen=True)
class Section:
    """Functions whose time is summed under one name."""

    name: str
    functions: tuple[tuple[Any, str], ...]
    """Owner (a class or module) and attribute; a function that is imported by name is patched where it is used."""


@dataclass
class Spent:
    """What a section took, without the sections that it called."""

    seconds: float = 0.0
    calls: int = 0


class Stopwatch:
    """Times sections of code that may call each other; time always counts for the innermost."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.spent: dict[str, Spent] = {}
        self._clock = clock
        self._open: list[str] = []
        self._since = 0.0

    def _switch(self) -> None:
        """Books the time since the last switch to the innermost open section."""
        now = self._clock()
        if self._open:
            self.spent[self._open[-1]].seconds += now - self._since
        self._since = now

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Counts what runs inside."""
        self._switch()
        self._open.append(name)
        self.spent.setdefault(name, Spent()).calls += 1
        try:
            yield
        finally:
            self._switch()
            self._open.pop()

    def around(self, function: Callable, name: str) -> Callable:
        """The function, timed."""

        @functools.wraps(function)
        def timed(*args: Any, **kwargs: Any) -> Any:
            with self.section(name):
                return function(*args, **kwargs)

        return timed

    @contextmanager
    def attached(self, sections: Sequence[Section]) -> Iterator[None]:
        """Times the sections' functions as long as the context lasts; a name that is gone raises AttributeError."""
        with ExitStack() as stack:
            for section in sections:
                for owner, attribute in section.functions:
                    timed = self.around(getattr(owner, attribute), section.name)
                    stack.enter_context(patch.object(owner, attribute, timed))
            yield
