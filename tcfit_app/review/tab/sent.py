"""Remembers what was sent to a tab, so that only what changed is sent again."""

from collections.abc import Hashable, Iterator
from contextlib import contextmanager


class Sent:
    """One key for each thing that is drawn."""

    def __init__(self) -> None:
        self._keys: dict[str, Hashable] = {}

    def differs(self, name: str, *key: Hashable) -> bool:
        """Whether a thing's key is another one than the last time; from now on it is this one."""
        if name in self._keys and self._keys[name] == key:
            return False
        self._keys[name] = key
        return True

    @contextmanager
    def all_or_nothing(self) -> Iterator[None]:
        """Keys that `differs` remembers inside are forgotten again if an exception ends it: nothing was sent then."""
        before = dict(self._keys)
        try:
            yield
        except BaseException:
            self._keys = before
            raise
