"""What a project keeps of the work on it: how long each reviewer has worked, and the worst place of its last fit."""

import time
from collections.abc import Iterable

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.review.page import Page
from tcfit_app.review.shared.drawing_data import DrawingData
from tcfit_app.review.tab.people import Someone

PAUSE = 60.0
"""Seconds between two actions above which the time does not count as work."""
EVERY = 20.0
"""Seconds between two times that something is written."""
_LEAST = 1.0
"""Seconds of work that are worth writing down."""
_PATIENCE = 5.0
"""Seconds for which the end waits for the worst place of a run of which none is kept."""


class Keeping:
    """For the drawing thread."""

    def __init__(self) -> None:
        self._acted: dict[tuple[Project, str], float] = {}
        """When each reviewer did something last."""
        self._worked: dict[tuple[Project, str], float] = {}
        """Seconds that are not written yet."""
        self._worst: dict[Project, Worst] = {}
        self._next = time.monotonic() + EVERY

    def acted(self, page: Page) -> None:
        """Record an action in a tab."""
        whose, now = (page.tab.session.project, page.tab.reviewer), time.monotonic()
        passed = now - self._acted.get(whose, now)
        self._acted[whose] = now
        if passed < PAUSE and not whose[0].read_only:
            self._worked[whose] = self._worked.get(whose, 0.0) + passed

    def keep(self, people: Iterable[Someone], *, last: bool = False) -> None:
        """Write it down if it is time to, or for the last time. Raises InputError if a project cannot be written."""
        if time.monotonic() < self._next and not last:
            return
        self._next = time.monotonic() + EVERY
        for (project, reviewer), seconds in list(self._worked.items()):
            if seconds >= _LEAST:
                del self._worked[project, reviewer]
                project.review.add_time(reviewer, seconds)
        for someone in people:
            self._keep_worst(someone.data, _PATIENCE if last else 0.0)

    def _keep_worst(self, data: DrawingData, patience: float) -> None:
        session, project = data.session, data.session.project
        run = session.fits.meant(FitChoice())
        if project.read_only or run is None or run.state != "finished" or run.kind == "imported":
            return
        kept = project.review.now.worst
        if kept is not None and kept.run == run.id and kept.off:
            patience = 0.0
        end = time.monotonic() + patience
        try:
            while (worst := _worst(data)) is None and time.monotonic() < end:
                time.sleep(0.05)
        except InputError:  # which the panels tell
            return
        if worst is not None and self._worst.get(project) != worst:
            project.review.set_worst(worst)
            self._worst[project] = worst


def _worst(data: DrawingData) -> Worst | None:
    """That of the newest run; None while it is computed. Raises InputError if its fit or its body cannot be read."""
    shown = data.session.stored.show(FitChoice())
    if shown is not None and (problem := data.problem("suspects", shown)):
        raise InputError(problem)
    return None if shown is None or data.session.edit_follower.lags else data.worst(shown)
