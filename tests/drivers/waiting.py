"""Waiting for what another thread or process does."""

import time
from collections.abc import Callable
from typing import Any


def until(condition: Callable[[], Any], what: str = "", *, seconds: float = 120.0) -> Any:
    """Wait for something to be so; what it is."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, f"waited too long for {what or condition}"
        time.sleep(0.01)
    return found
