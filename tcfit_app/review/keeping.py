"""What a project keeps of the work on it: how long each reviewer has worked, and the worst place of its last fit."""

import time
from collections.abc import Iterable

from tcfit_app.analysis.suspicion import worst_place
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.project.storage.run_record import newest
from tcfit_app.review.page import Page

PAUSE = 60.0
"""Seconds: between two actions that are farther apart nobody has worked."""
EVERY = 20.0
"""Seconds between two times that something is written."""
_LEAST = 1.0
"""Seconds of work that are worth writing down."""


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
        """Somebody does something in a tab."""
        whose, now = (page.tab.session.project, page.tab.browser.reviewer), time.monotonic()
        passed = now - self._acted.get(whose, now)
        self._acted[whose] = now
        if passed < PAUSE and not whose[0].read_only:
            self._worked[whose] = self._worked.get(whose, 0.0) + passed

    def keep(self, pages: Iterable[Page], *, last: bool = False) -> None:
        """Write it down if it is time to, or for the last time. Raises InputError if a project cannot be written."""
        if time.monotonic() < self._next and not last:
            return
        self._next = time.monotonic() + EVERY
        for (project, reviewer), seconds in list(self._worked.items()):
            if seconds >= _LEAST:
                del self._worked[project, reviewer]
                project.review.add_time(reviewer, seconds)
        for page in pages:
            self._keep_worst(page)

    def _keep_worst(self, page: Page) -> None:
        shown, project = page.tab.shown.b, page.tab.session.project
        if shown is None or project.read_only or newest(project.runs.all()).id != shown.run.id:
            return
        if shown.run.state != "finished" or (queue := page.tab.data.queue(shown)) is None:
            return
        worst = worst_place(shown.run.id, queue.left)
        if self._worst.get(project) != worst:
            project.review.set_worst(worst)
            self._worst[project] = worst
