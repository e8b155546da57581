"""A least-recently-used cache limited in bytes."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Value = TypeVar("Value")


class ByteCache(Generic[Value]):
    """Values by key. Thread-safe.

    Args:
        limit: Total bytes of all values. A single larger value is not stored.
        size: Returns the bytes of a value.
    """

    def __init__(self, limit: int, size: Callable[[Value], int]) -> None:
        self._limit, self._size = limit, size
        self._values: OrderedDict[Hashable, Value] = OrderedDict()
        self._used = 0
        self._guard = threading.Lock()

    @property
    def used(self) -> int:
        """Bytes of all values."""
        return self._used

    @property
    def limit(self) -> int:
        """Maximum bytes of all values."""
        return self._limit

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: Hashable) -> bool:
        """Whether it is stored; does not count as a use."""
        with self._guard:
            return key in self._values

    def get(self, key: Hashable) -> Value | None:
        """The value, which becomes the most recently used; None if it is not stored."""
        with self._guard:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def put(self, key: Hashable, value: Value) -> None:
        """Store or replace a value, evicting others until all fit."""
        size = self._size(value)
        with self._guard:
            self._take(key)
            if size > self._limit:
                return
            self._values[key] = value
            self._used += size
            while self._used > self._limit:
                self._take(next(iter(self._values)))

    def _take(self, key: Hashable) -> None:
        if key in self._values:
            self._used -= self._size(self._values.pop(key))
