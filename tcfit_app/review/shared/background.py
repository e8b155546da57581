"""What takes too long for the draw loop: made by one thread, asked for again and again until it is there."""

import logging
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import torch

KEPT = 64
"""Values that are remembered, those that were asked for last."""
Value = TypeVar("Value")
_log = logging.getLogger(__name__)


class Background:
    """Computes values by key. For one thread that asks.

    Args:
        wake: called when a value is there, from another thread.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._pool = ThreadPoolExecutor(1, "tcfit computes", initializer=torch.set_num_threads, initargs=(1,))
        self._futures: OrderedDict[Hashable, Future[Any]] = OrderedDict()

    def get(self, key: Hashable, compute: Callable[[], Value]) -> Value | None:
        """The value of a key, or None while it is computed; what fails stays None, and is in the log once."""
        future = self._futures.get(key)
        if future is None:
            future = self._futures[key] = self._pool.submit(compute)
            future.add_done_callback(self._done)
            self._forget()
        self._futures.move_to_end(key)
        if not future.done() or future.cancelled() or future.exception() is not None:
            return None
        return future.result()

    def problem(self, key: Hashable) -> str:
        """Why a key has no value and will not get one; empty if that is not so."""
        future = self._futures.get(key)
        if future is None or not future.done() or future.cancelled():
            return ""
        error = future.exception()
        return "" if error is None else str(error)

    def _done(self, future: Future[Any]) -> None:
        if not future.cancelled() and (error := future.exception()) is not None:
            _log.error("A computation failed", exc_info=error)
        self._wake()

    def _forget(self) -> None:
        while len(self._futures) > KEPT:
            _, oldest = self._futures.popitem(last=False)
            oldest.cancel()

    def close(self) -> None:
        """End; what is being computed is waited for."""
        self._pool.shutdown(cancel_futures=True)
