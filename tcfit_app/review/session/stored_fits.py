"""Fits for the drawing thread, which must not wait for the disk: those not in memory are read in another thread."""

from collections.abc import Hashable

from fitting_core.errors import InputError
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting.fits import FitChoice, Fits, Shown
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.session.tasks import Tasks


class StoredFits:
    """See `Fits`. All methods raise InputError for what cannot be read.

    Args:
        fits: Of the project.
        tasks: Reads them.
    """

    def __init__(self, fits: Fits, tasks: Tasks) -> None:
        self._fits, self._tasks = fits, tasks

    def here(self, run: Run) -> bool:
        """Whether a run's fit is in memory; if not, reading it has been started."""
        if self._fits.held(run):
            return True
        key: Hashable = ("stored fit", run.id, self._fits.version)
        if self._tasks.get(key, lambda: bool(self._fits.phases(run)), lane="disk"):
            self._tasks.drop(key)  # it may have to be read again
        if problem := self._tasks.problem(key):
            raise InputError(problem)
        return self._fits.held(run)

    def reading(self, run: Run) -> bool:
        """Whether a run's fit is still being read."""
        try:
            return not self.here(run)
        except InputError:
            return False

    def show(self, choice: FitChoice) -> Shown | None:
        """What a choice refers to now; None if there is nothing, or nothing yet."""
        run = self._fits.meant(choice)
        return self._fits.show(choice) if run is not None and self.here(run) else None

    def fit(self, run: Run) -> FitResult | None:
        """The result of a run; None while it is being read."""
        return self._fits.fit(run) if self.here(run) else None

    def phases(self, run: Run) -> tuple[int, ...]:
        """Which phases of a run can be shown; none while it is being read."""
        return self._fits.phases(run) if self.here(run) else ()
