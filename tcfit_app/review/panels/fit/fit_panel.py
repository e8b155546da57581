"""The Fit panel: settings, what to fit with them, and progress."""

from collections.abc import Collection
from functools import partial
from typing import ClassVar

import numpy as np
import viser
from viser import uplot

from fitting_core.errors import InputError
from tcfit_app.fitting.fit_progress import time_left
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.job_progress import RunningJob
from tcfit_app.project.frame_words import numbers
from tcfit_app.project.storage.run_record import Given
from tcfit_app.review.drawing.status import duration
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
        self._inputs.add_margin()
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
            row(action(self._gestures, "rerun_edited", self._edited_label(fit))),
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

    def _edited_label(self, fit: Shown | None) -> str:
        if fit is None:
            return "Re-run around edits"
        try:
            windows = self._gestures.fitting.edited_windows()
        except InputError:
            return "Re-run around edits (none since the fit)"
        frames = [frame for window in windows for frame in window]
        return f"Re-run around edits: {numbers(frames, self._tab.first_frame, most=2)}"


Losses = list[tuple[float, dict[str, float]]]
"""As in `RunningJob.losses`."""
TERMS = 5
"""Curves besides the total: of the terms with the highest cost."""
POINTS = 240
"""Points per curve; longer ones are thinned."""
_COLORS = ("#868e96", "#228be6", "#e8590c", "#2f9e44", "#be4bdb", "#0c8599")
"""Distinguishable on light and on dark backgrounds."""
_LEAST = 0.1
"""The lowest cost drawn: the axis is logarithmic."""
_AXIS = "#868e96"
_GRID = uplot.Axis_Grid(stroke="rgba(128,128,128,0.22)")
_FINE_GRID = uplot.Axis_Grid(stroke="rgba(128,128,128,0.1)")
"""Grid lines per decade of the logarithmic axis."""
_LABELS = 54
"""Pixels for the labels of costs up to 1,000,000."""
_POINTS = uplot.Series_Points(show=False)


class RunningJobs:
    """The jobs of a session, in one tab."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        gui = tab.client.gui
        # Buttons apart from the text, which changes many times a second: a focused button keeps its focus.
        self._buttons, self._said = Board(tab), Board(tab)
        self._plot = _empty_plot(gui)

    def draw(self) -> None:
        """Send what changed."""
        session = self._tab.session
        jobs = list(session.jobs.values())
        running = next((job for job in jobs if job.started), None)
        self._buttons.show(*(self._cancelling(running or jobs[0], len(jobs)) if jobs else []))
        self._said.show(*(self._running(running, jobs) if jobs else _ended(session.ended, session.fits.unwritten)))
        fitted = running if running is not None and running.run is not None else session.ended
        losses = fitted.losses if fitted else []
        if len(losses) < 2:
            self._plot.visible = False
        else:
            self._tab.once("losses", (losses[0], losses[-1]), lambda: self._draw_plot(losses))

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

    def _draw_plot(self, losses: Losses) -> None:
        names = charted(losses)
        data = curves(losses, names)
        with self._tab.client.atomic():
            self._tab.once("loss names", names, lambda: setattr(self._plot, "series", _all_series(names)))
            self._plot.data = data
            self._plot.visible = True


def charted(losses: Losses) -> tuple[str, ...]:
    """Names of the curves: the total, and the terms with the highest final cost."""
    last = losses[-1][1]
    terms = sorted((name for name in last if name != "total"), key=lambda name: -last[name])
    return ("total", *sorted(terms[:TERMS]))


def curves(losses: Losses, names: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """Seconds, and 1 + TERMS rows of costs in the order of the names; NaN where unknown."""
    chosen = np.unique(np.linspace(0, len(losses) - 1, min(len(losses), POINTS)).round().astype(int))
    rows = [losses[i] for i in chosen]
    costs = np.array([[terms.get(name, np.nan) for _, terms in rows] for name in names])
    costs = np.where(np.isfinite(costs), np.maximum(costs, _LEAST), np.nan)
    unused = [np.full(len(rows), np.nan)] * (1 + TERMS - len(names))
    return np.array([seconds for seconds, _ in rows]), *costs, *unused


def _all_series(names: tuple[str, ...]) -> tuple[uplot.Series, ...]:
    """Always the same number: uPlot shows nothing after an update that changes the number of curves."""
    labels = [*names, *["–"] * (1 + TERMS - len(names))]
    return uplot.Series(label="s"), *map(_series, labels, _COLORS)


def _series(name: str, color: str) -> uplot.Series:
    return uplot.Series(label=name.replace("_", " "), stroke=color, width=2 if name == "total" else 1, points=_POINTS)


def _empty_plot(gui: viser.GuiApi) -> viser.GuiUplotHandle:
    none = np.array([0.0, 1.0])
    ticks = uplot.Axis_Ticks(stroke=_AXIS, width=1, size=3)
    font = "10px sans-serif"
    x_axis = uplot.Axis(stroke=_AXIS, grid=_GRID, ticks=ticks, size=30, font=font)
    y_axis = uplot.Axis(stroke=_AXIS, grid=_FINE_GRID, ticks=uplot.Axis_Ticks(show=False), size=_LABELS, font=font)
    return gui.add_uplot(
        (none, *[none] * (1 + TERMS)),
        _all_series(("total",)),
        title="Mean cost per frame, by term",
        scales={"x": uplot.Scale(time=False), "y": uplot.Scale(distr=3)},
        axes=(x_axis, y_axis),
        height=178,
        padding=(8, 20, 0, 0),
        visible=False,
    )


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
