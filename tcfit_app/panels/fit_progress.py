"""What is being fitted: how far, what waits, how the cost falls, and how it ended."""

from typing import TYPE_CHECKING

import numpy as np
import viser
from viser import uplot

import tcfit_app.panels.markup as markup
from tcfit_app.panels.fields import Shown, on_press
from tcfit_app.session import RunningJob
from tcfit_app.status import PHASES, duration

if TYPE_CHECKING:
    from tcfit_app.page import Page

Losses = list[tuple[float, dict[str, float]]]
"""As `RunningJob.losses` has them."""
TERMS = 5
"""Curves beside the total: of the terms that cost most."""
POINTS = 240
"""Of a curve; longer ones are thinned."""
_COLORS = ("#f1f3f5", "#4dabf7", "#ffa94d", "#69db7c", "#da77f2", "#ffd43b")
_LEAST = 0.1
"""Costs below are drawn here: the axis is logarithmic."""
_AXIS = "#909296"
_GRID = uplot.Axis_Grid(stroke="rgba(255,255,255,0.08)")
_FINE_GRID = uplot.Axis_Grid(stroke="rgba(255,255,255,0.035)")
"""Of the logarithmic axis, which has nine lines for each power of ten."""
_POINTS = uplot.Series_Points(show=False)


class FitProgress:
    """The jobs of a session, in one page."""

    def __init__(self, page: "Page") -> None:
        self._page = page
        gui = page.client.gui
        self._said = Shown(gui.add_html("", visible=False))
        self._bar = Shown(gui.add_progress_bar(0.0, visible=False))
        self._plot = Shown(_empty_plot(gui))
        self._cancel = Shown(gui.add_button("Cancel", visible=False, color="red", icon=viser.Icon.PLAYER_STOP))
        self._cancel_all = Shown(gui.add_button("Cancel all", visible=False, color="red", icon=viser.Icon.PLAYER_STOP))
        on_press(page, self._cancel.handle, self._cancel_first)
        on_press(page, self._cancel_all.handle, lambda: page.session.cancel())

    def _cancel_first(self) -> None:
        session = self._page.session
        if job := next(iter(session.jobs.values()), None):
            session.worker.cancel(job.number)

    def draw(self) -> None:
        """Send what changed."""
        session = self._page.session
        if not self._page.changes.of("fit progress", session.changes, session.fits.changes):
            return
        jobs = list(session.jobs.values())
        running = next((job for job in jobs if job.started), None)
        said = self._running(running, jobs) if jobs else _ended(session.ended)
        self._said.show(content=markup.panel(said), visible=bool(said))
        progress = running.progress if running else None
        self._bar.show(value=round(100 * progress.share, 1) if progress else 0.0, visible=bool(jobs))
        self._cancel.show(visible=bool(jobs))
        self._cancel_all.show(visible=len(jobs) > 1, label=f"Cancel all {len(jobs)}")
        fitted = running if running is not None and running.run is not None else session.ended
        self._draw_plot(fitted.losses if fitted else [])

    def _running(self, job: RunningJob | None, jobs: list[RunningJob]) -> str:
        lines = [_progress_text(job)] if job else []
        for waiting in jobs:
            if waiting is not job:
                lines.append(markup.muted(f"waiting: {self._name(waiting)}"))
        return "<br>".join(lines)

    def _name(self, job: RunningJob) -> str:
        run = self._page.session.fits.run(job.run) if job.run is not None else None
        return f"{run.name}, {job.title}" if run else job.title

    def _draw_plot(self, losses: Losses) -> None:
        if not self._page.changes.of("losses", len(losses), id(losses)):
            return
        if len(losses) < 2:
            self._plot.show(visible=False)
            return
        names = charted(losses)
        data = curves(losses, names)
        plot = self._plot.handle
        with self._page.client.atomic():
            if self._page.changes.of("loss names", names):
                plot.series = _all_series(names)
            plot.data = data
            self._plot.show(visible=True)


def charted(losses: Losses) -> tuple[str, ...]:
    """Names of the curves: the total, and the terms that cost most at the end."""
    last = losses[-1][1]
    terms = sorted((name for name in last if name != "total"), key=lambda name: -last[name])
    return ("total", *sorted(terms[:TERMS]))


def curves(losses: Losses, names: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """Seconds, and 1 + TERMS rows of costs, in the order of the names; what is not known is NaN."""
    chosen = np.unique(np.linspace(0, len(losses) - 1, min(len(losses), POINTS)).round().astype(int))
    rows = [losses[i] for i in chosen]
    costs = np.array([[terms.get(name, np.nan) for _, terms in rows] for name in names])
    costs = np.where(np.isfinite(costs), np.maximum(costs, _LEAST), np.nan)
    unused = [np.full(len(rows), np.nan)] * (1 + TERMS - len(names))
    return np.array([seconds for seconds, _ in rows]), *costs, *unused


def _all_series(names: tuple[str, ...]) -> tuple[uplot.Series, ...]:
    """Always as many: uPlot shows nothing between two updates of which one has more curves than the other."""
    labels = [*names, *["–"] * (1 + TERMS - len(names))]
    return uplot.Series(label="s"), *map(_series, labels, _COLORS)


def _series(name: str, color: str) -> uplot.Series:
    return uplot.Series(label=name.replace("_", " "), stroke=color, width=2 if name == "total" else 1, points=_POINTS)


def _empty_plot(gui: viser.GuiApi) -> viser.GuiUplotHandle:
    none = np.array([0.0, 1.0])
    ticks = uplot.Axis_Ticks(stroke=_AXIS, width=1, size=3)
    font = "10px sans-serif"
    x_axis = uplot.Axis(stroke=_AXIS, grid=_GRID, ticks=ticks, size=30, font=font)
    y_axis = uplot.Axis(stroke=_AXIS, grid=_FINE_GRID, ticks=uplot.Axis_Ticks(show=False), size=44, font=font)
    return gui.add_uplot(
        (none, *[none] * (1 + TERMS)),
        _all_series(("total",)),
        title="Mean cost of a frame, by term",
        scales={"x": uplot.Scale(time=False), "y": uplot.Scale(distr=3)},
        axes=(x_axis, y_axis),
        height=170,
        visible=False,
    )


def _progress_text(job: RunningJob) -> str:
    progress = job.progress
    if progress is None:
        return f"{markup.bold(job.title)}<br>{markup.muted('begins')}"
    part = job.phases.index(progress.phase) + 1 if progress.phase in job.phases else 1
    where = f"phase {part} of {len(job.phases)}: {PHASES[progress.phase]}, {progress.label}"
    left = "" if progress.remaining is None else f", about {duration(progress.remaining)} left"
    time = markup.muted(f"{duration(progress.elapsed)}{left}")
    return f"{markup.bold(job.title)}<br>{markup.text(where)}<br>{time}"


def _ended(job: RunningJob | None) -> str:
    """How the last job ended, until the next one begins."""
    if job is None:
        return ""
    took = f" after {duration(job.progress.elapsed)}" if job.progress else ""
    if job.outcome == "failed":
        return f"{markup.bold(f'{job.title} failed{took}')}{markup.problem(job.reason)}"
    word, color = ("cancelled", markup.MUTED) if job.outcome == "cancelled" else ("done", markup.GOOD)
    return markup.colored(markup.text(f"{job.title}: {word}{took}"), color)
