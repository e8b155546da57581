"""Fits from one browser tab with its settings: whole fits, re-runs of frames, around edits, and of the shape."""

import math
from collections.abc import Callable
from dataclasses import replace

from fitting_core.camera import SURE_FOCAL, Camera, FocalFrom
from fitting_core.config.settings import check
from fitting_core.errors import InputError
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.imports.given import NOTHING, KnownInputs
from tcfit_app.project.storage.run_record import Given, Run
from tcfit_app.review.session.tasks import Value
from tcfit_app.review.tab.state import FitSettings
from tcfit_app.review.tab.tab import OneTask, Tab

FOCAL_SOURCE = "set in the review"
"""Source of a focal length set there."""


class Fitting:
    """Starts fits for one tab, with its settings."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._reading = OneTask(tab)
        """Reads what the next fit is given."""

    def everything(self) -> None:
        """Fit all phases. Raises InputError if a setting is invalid, or the fit cannot be started."""
        self._begin(self._checked())

    def resume(self, run: Run) -> None:
        """Continue a fit that ended in phase 1. Raises InputError as `everything`."""
        tab, session = self._tab, self._tab.session
        tab.refuse_read_only()

        def begin(found: tuple[FitResult, KnownInputs]) -> None:
            session.resume(run, *found)
            tab.set(b=FitChoice(run=run.id))
            tab.say(f"{run.name}: continued")

        self._read(session.interrupted(run), begin)

    def _begin(self, settings: FitSettings) -> None:
        tab, session = self._tab, self._tab.session
        body, camera = (
            {"kind": settings.kind, "gender": settings.gender},
            camera_of(settings, session.project.footage.camera),
        )

        def begin(known: KnownInputs) -> None:
            before = tab.look().b
            session.fit_everything(settings.config, **body, camera=camera, known=known)
            start = known.given.start
            if start is not None and start.run is not None:
                tab.set(a=FitChoice(run=start.run), b=FitChoice())
            else:
                self._show_beside(before, FitChoice())  # the newest run with a result
            tab.say("Fit everything: started")

        if settings.given == Given():
            begin(NOTHING)
        else:
            self._check_paths(settings.given)
            self._read(session.reading(settings.given, **body, camera=camera), begin)

    def _check_paths(self, given: Given) -> None:
        """Raise InputError for a file that this page may not read: settings of a run may name any file."""
        for source in (given.start, given.shape):
            if source is not None and source.run is None:
                self._tab.files.path(source.path)

    def _read(self, read: Callable[[], Value], then: Callable[[Value], None]) -> None:
        """Read what a fit is given, off the drawing thread, and then start it."""
        self._reading.begin("Loading the fit's start and shape", lambda report: read(), then)
        self._tab.say("Loading the fit's start and shape …")

    def frames(self) -> None:
        """Refit the selected frames of B. Raises InputError as `everything`, and if none are selected."""
        before, frames = self.base(), self.selected_frames()
        run = self._tab.session.rerun_frames(before, self._checked().config, (frames,))
        self._show_beside(before, FitChoice(run=run.id))
        self._tab.say("Fit the selected frames: started")

    def selected_frames(self) -> range:
        """The frames selected in the timeline. Raises InputError without a selection."""
        frames = self._tab.state.frames
        if frames is None:
            raise InputError("Select frames first: Shift-drag in the timeline, or set both ends with [ and ].")
        return frames

    def shape(self) -> None:
        """Re-estimate B's shape, and refit with it. Raises InputError as `everything`."""
        before, settings, session = self.base(), self._checked(), self._tab.session

        def begin(known: KnownInputs) -> None:
            run = session.rerun_shape(before, settings.config, known=known)
            self._show_beside(before, FitChoice(run=run.id))
            self._tab.say("Fit the shape again: started")

        if settings.given.shape is None:
            begin(NOTHING)
        else:
            self._check_paths(settings.given)
            self._read(session.reading_shape(settings.given, before), begin)

    def _show_beside(self, before: Shown | None, b: FitChoice) -> None:
        """Show the new run as B and the previous B as A, so that the change is visible."""
        tab = self._tab
        compared = tab.state.a
        other = None if compared is None or compared.run is None else tab.session.fits.run(compared.run)
        # An imported run is what everything is compared with.
        if before is None or (other is not None and other.kind == "imported"):
            tab.set(b=b)
        else:
            tab.set(a=replace(tab.state.b, run=before.run.id), b=b)

    def base(self) -> Shown:
        """B, which is refitted. Raises InputError if there is no fit."""
        shown = self._tab.shown.b
        if shown is None:
            raise InputError("There is no fit yet to re-run: fit everything first.")
        return shown

    def _checked(self) -> FitSettings:
        self._tab.refuse_read_only()
        self.refuse_wrong_settings()
        settings = self._tab.state.settings
        check(settings.config, origin="Fit settings")
        return settings

    def refuse_wrong_settings(self) -> None:
        """Raises InputError naming the invalid setting."""
        if problems := self._tab.state.settings.problems:
            raise InputError(problems[0][1])


def camera_of(settings: FitSettings, camera: Camera) -> Camera:
    """The clip's camera with the chosen focal length; square pixels stay square. Raises InputError if it is invalid."""
    if settings.focal is None:
        return camera
    if not (math.isfinite(settings.focal) and settings.focal > 0):
        raise InputError(f"The focal length is {settings.focal:g}; expected pixels, above 0.")
    x, y = camera.focal
    focal = (settings.focal, settings.focal * y / x)
    # The vertical is that of the focal length with which it was estimated.
    same = abs(math.log(settings.focal / x)) < SURE_FOCAL
    return replace(
        camera,
        focal=focal,
        focal_from=FocalFrom.GIVEN,
        source=FOCAL_SOURCE,
        focal_deviation=None,
        vertical=camera.vertical if same else None,
    )
