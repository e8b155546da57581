"""A run next to its parent."""

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.tab.tab import Tab


def parent_of(tab: Tab, run: Run) -> Run | None:
    """The run that this one started from, if it can be shown."""
    return next((one for one in tab.session.fits.showable() if one.id == run.parent), None)


def show_beside_parent(tab: Tab, run: Run) -> None:
    """Show it in A | B, with its parent as A. Raises InputError if it has none."""
    parent = parent_of(tab, run)
    if parent is None:
        raise InputError(
            f"{run.name} has no parent to show: it did not start from another run, or that run was deleted."
        )
    tab.set(mode="ab", a=FitChoice(run=parent.id), b=FitChoice(run=run.id))
