"""Keeps the worst place of each person's last fit in the project, where the list of clips reads it."""

import time
from collections.abc import Iterable

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.review.shared.drawing_data import DrawingData

EVERY = 20.0
"""Seconds between two times that it is looked for."""
_PATIENCE = 5.0
"""Seconds for which the end waits for the worst place of a run of which none is kept."""


class Keeping:
    """For the drawing thread."""

    def __init__(self) -> None:
        self._worst: dict[Project, Worst] = {}
        self._next = time.monotonic() + EVERY

    def keep(self, people: Iterable[DrawingData], *, last: bool = False) -> None:
        """Write it down if it is time to, or for the last time. Raises InputError if a project cannot be written."""
        if time.monotonic() < self._next and not last:
            return
        self._next = time.monotonic() + EVERY
        for data in people:
            self._keep_worst(data, _PATIENCE if last else 0.0)

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
