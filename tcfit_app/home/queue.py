"""Fits that wait for their turn, one after the other."""

import threading
from collections.abc import Callable, Collection, Iterable
from multiprocessing.connection import wait
from pathlib import Path

from tcfit_app.fitting import child_processes
from tcfit_app.home.messages import Work

WAITING = Work(step="Waiting")
_LOOK = 0.5
"""Seconds after which it is looked whether a fit is to be cancelled."""


class FitQueue:
    """Thread-safe.

    Args:
        place: Tells, when the turn of a key has come, the project's folder. Raises ValueError, with what the user is
            told, if it cannot be fitted now.
        changed: Is told of keys about which there is news, from a thread of its own.
        models: Folder of body models.
    """

    def __init__(
        self,
        place: Callable[[str], Path],
        changed: Callable[[Collection[str]], None],
        models: Path | None = None,
    ) -> None:
        self._place, self._changed, self._models = place, changed, models
        self._guard = threading.Condition()
        self._work: dict[str, Work] = {}
        """By key: those that wait, the one that runs, and those that have failed; in their order."""
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="tcfit fits in the background")
        self._thread.start()

    def on(self, key: str) -> Work | None:
        """What is done to a clip."""
        return self._work.get(key)

    @property
    def busy(self) -> bool:
        """Whether anything waits or runs."""
        return any(not work.ended for work in list(self._work.values()))

    def add(self, keys: Iterable[str]) -> None:
        """Fit them, after those that wait."""
        with self._guard:
            new = [key for key in keys if key not in self._work or self._work[key].ended]
            for key in new:
                self._work.pop(key, None)  # to the end
                self._work[key] = WAITING
            self._guard.notify()
        self._changed(new)

    def cancel(self, keys: Iterable[str]) -> None:
        """Fit them not; what is told of those that failed is taken away."""
        with self._guard:
            gone = [key for key in keys if self._work.pop(key, None) is not None]
        self._changed(gone)

    def close(self) -> None:
        """End the fit that runs, and begin no other."""
        with self._guard:
            self._closed = True
            self._work.clear()
            self._guard.notify()
        self._thread.join()

    def _run(self) -> None:
        while (key := self._next()) is not None:
            try:
                ended = self._fitted(key, self._place(key))
            except ValueError as error:
                ended = Work(step=str(error), ended=True)
            with self._guard:
                if key in self._work:
                    del self._work[key]
                    if ended is not None:
                        self._work[key] = ended
            self._changed([key])

    def _next(self) -> str | None:
        """The one whose turn it is; waits for it. None at the end."""
        with self._guard:
            while not self._closed:
                for key, work in self._work.items():
                    if not work.ended:
                        self._work[key] = Work(step="Starting")
                        return key
                self._guard.wait()
        return None

    def _fitted(self, key: str, folder: Path) -> Work | None:
        """Fit it; None if that went well, or was cancelled."""
        from tcfit_app.home.fitting import serve  # torch's two seconds are not for the list

        ours, theirs = child_processes.CONTEXT.Pipe()
        process = child_processes.CONTEXT.Process(target=serve, args=(theirs, folder, self._models), daemon=True)
        process.start()
        theirs.close()
        try:
            while True:
                if key not in self._work:
                    return None
                if not wait([ours], _LOOK):
                    continue
                news = ours.recv()
                if news is None or news.ended:
                    return news
                with self._guard:
                    if key in self._work:
                        self._work[key] = news
                self._changed([key])
        except (EOFError, OSError):
            process.join()
            return Work(step=f"Its process ended (exit code {process.exitcode}). Memory may have run out.", ended=True)
        finally:
            process.kill()
            process.join()
            ours.close()
