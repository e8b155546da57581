"""Remembers what was sent, so that only what changed is sent again."""

from collections.abc import Hashable


class Changes:
    """One key for each thing that is drawn."""

    def __init__(self) -> None:
        self._keys: dict[str, Hashable] = {}

    def of(self, name: str, *key: Hashable) -> bool:
        """Whether a thing's key is another one than the last time; from now on it is this one."""
        if name in self._keys and self._keys[name] == key:
            return False
        self._keys[name] = key
        return True
