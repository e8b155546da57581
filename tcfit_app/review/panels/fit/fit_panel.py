"""The Fit panel: settings, what to fit with them, and progress."""

from collections.abc import Collection
from functools import partial
from typing import ClassVar

import viser

from tcfit_app.fitting.fit_progress import duration, time_left
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.reports import RunningJob
from tcfit_app.project.frame_words import numbers
from tcfit_app.project.storage.run_record import Given
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    action,
    button,
    heading,
    paragraph,
    progress_bar,
    row,
    words,
)
from tcfit_app.review.panels.fit.fit_settings import FitInputs
from tcfit_app.review.tab.state import FitSettings
from tcfit_app.review.tab.tab import Tab


class FitPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Fit"
    icon: ClassVar[viser.IconName] = viser.Icon.RUN

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab, gui = gestures.tab, gestures.tab.client.gui
        self._inputs = FitInputs(tab)
        self._inputs.add_preset()
        self._inputs.add("temporal.weight", "temporal.mode", "temporal.window_size")
        self._everything = Board(tab)
        self._again = Board(tab)
        self._progress = RunningJobs(tab)  # below all buttons, so that they do not move when a fit begins
        with gui.add_folder("Start, person", expand_by_default=False):
            self._inputs.add_height()
            self._inputs.add_given()
        with gui.add_folder("Shape, prior"):
            self._inputs.add("shape_sample.size", "shape_sample.strategy", "pose_prior", "silhouettes")
        begins = not tab.session.fits.runs and not tab.session.project.footage.camera.calibrated
        with gui.add_folder("How it was filmed", expand_by_default=begins):
            self._inputs.add_camera()
        with gui.add_folder("Body", expand_by_default=False):
            self._inputs.add_body()
        with gui.add_folder("All settings", expand_by_default=False):
            self._inputs.add_source()

    def draw(self) -> None:
        """See `Panel.draw`."""
        self._inputs.draw()
        self._progress.draw()
        self._draw_buttons()

    def _draw_buttons(self) -> None:
        tab, state = self._tab, self._tab.state
        fit = tab.shown.b
        told = paragraph(self._told(state.settings), "dim") if state.settings.given != Given() else Html()
        self._everything.show(row(action(self._gestures, "fit", kind="main")), told)
        self._again.show(
            heading("Refit B", "" if fit is not None else "there is no fit yet"),
            row(action(self._gestures, "rerun", self._frames_label(fit))),
            row(action(self._gestures, "rerun_shape", self._shape_label(state.settings))),
        )

    def _told(self, now: FitSettings) -> str:
        """What the next whole fit is given besides the clip."""
        runs, parts = self._tab.session.fits, []
        if now.given.start is not None:
            held = now.config.start_deviation
            near = "" if held is None else f", held within about {100 * held:g} cm of it"
            parts.append(f"starts from {runs.named(now.given.start)}{near}")
        if now.given.shape is not None:
            parts.append(f"uses the shape of {runs.named(now.given.shape)}")
        return f"The next fit {' and '.join(parts)}."

    def _shape_label(self, now: FitSettings) -> str:
        shape = now.given.shape
        return "Re-run shape" if shape is None else f"Re-run shape as {self._tab.session.fits.named(shape)}"

    def _frames_label(self, fit: Shown | None) -> str:
        frames = self._tab.state.frames
        if fit is None:
            return "Re-run frames"
        if frames is None:
            return "Re-run frames (Shift-drag selects)"
        return f"Re-run frames {numbers(frames, self._tab.first_frame)}"


class RunningJobs:
    """The jobs of a session, in one tab."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        # Buttons apart from the text, which changes many times a second: a focused button keeps its focus.
        self._buttons, self._said = Board(tab), Board(tab)

    def draw(self) -> None:
        """Send what changed."""
        session = self._tab.session
        jobs = list(session.jobs.values())
        running = next((job for job in jobs if job.started), None)
        self._buttons.show(*(self._cancelling(running or jobs[0], len(jobs)) if jobs else []))
        self._said.show(*(self._running(running, jobs) if jobs else _ended(session.ended, session.fits.unwritten)))

    def _cancelling(self, job: RunningJob, count: int) -> list[Html]:
        """Buttons that cancel the running or next job, and all jobs."""
        session, number = self._tab.session, job.number
        cancel = partial(session.worker.cancel, number)
        buttons = [button("Cancel", "fit.cancel", str(number), do=cancel, kind="danger")]
        if count > 1:
            buttons.append(button(f"Cancel all {count}", "fit.cancel", "all", do=session.cancel, kind="danger"))
        return [heading("Running"), row(*buttons)]

    def _running(self, job: RunningJob | None, jobs: list[RunningJob]) -> list[Html]:
        waiting = [paragraph(f"waiting: {self._name(other)}", "dim") for other in jobs if other is not job]
        return [*(_progress(job) if job else []), *waiting]

    def _name(self, job: RunningJob) -> str:
        run = self._tab.session.fits.run(job.run) if job.run is not None else None
        return f"{run.name}, {job.title}" if run else job.title


def _progress(job: RunningJob) -> list[Html]:
    progress = job.progress
    if progress is None:
        return [paragraph(words(job.title, "strong")), paragraph("starting", "dim"), progress_bar(0.0)]
    left = time_left(progress.remaining)
    return [
        paragraph(words(job.title, "strong")),
        paragraph(progress.phrase),
        paragraph(f"{duration(progress.elapsed)}{left and f', {left}'}", "dim"),
        progress_bar(progress.fraction),
    ]


def _ended(job: RunningJob | None, unwritten: Collection[int]) -> list[Html]:
    """How the last job ended, until the next one begins."""
    if job is None:
        return []
    took = f" after {duration(job.progress.elapsed)}" if job.progress else ""
    if job.outcome == "failed":
        how = "not saved yet" if job.run in unwritten else "failed"
        return [paragraph(words(f"{job.title}: {how}{took}", "strong")), paragraph(job.reason, "bad")]
    word, kind = ("cancelled", "dim") if job.outcome == "cancelled" else ("done", "good")
    return [paragraph(f"{job.title}: {word}{took}", kind)]
