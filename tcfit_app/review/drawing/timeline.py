"""The timeline of one tab: curves of the runs on show, marks, the running fit, selected frames and the cursor."""

import numpy as np

from fitting_core.fit.provenance import Provenance
from tcfit_app.analysis.curves import BETWEEN, CURVES, Curve, peaks
from tcfit_app.fitting.job_progress import RunningJob
from tcfit_app.review.browser import page_states as states
from tcfit_app.review.browser.page_states import FitSpan, curve_values, spans
from tcfit_app.review.scene.layers import RUN_COLORS, css
from tcfit_app.review.tab.on_show import SIDES
from tcfit_app.review.tab.tab import Tab

PLOTTED: dict[str, tuple[str, str]] = {
    **{name: (kind.title, kind.unit) for name, kind in CURVES.items()},
    BETWEEN: ("Distance between A and B", "mm"),
}
"""Title and unit of everything that the timeline can plot, by the curve's name."""
_BETWEEN_COLOR = "#c9a3ff"


class Timeline:
    """Draws one tab's timeline; asked again and again, it sends what changed."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._last: dict[str, Curve] = {}
        """The curves on show, by "a" and "b": they stay until newer ones are there."""

    def draw(self) -> None:
        """Send what changed."""
        tab, state = self._tab, self._tab.state
        if tab.sent.differs("cursor", state.frame, state.playing):
            tab.channel.send("cursor", states.Cursor(frame=state.frame, playing=state.playing))
        if tab.sent.differs("range", state.frames):
            frames = state.frames
            chosen = None if frames is None else states.ChosenRange(first=frames[0], last=frames[-1])
            tab.channel.send("range", chosen)
        self._draw_curves()
        self._draw_marks()
        self._draw_provenance()
        self._draw_fit()

    def _draw_curves(self) -> None:
        tab, state = self._tab, self._tab.state
        lines = self._between() if state.curve == BETWEEN else self._of_each()
        clip = tab.session.project.clip
        if tab.sent.differs("timeline", state.curve, *((title, id(found)) for title, _, found in lines)):
            title, unit = PLOTTED[state.curve]
            timeline = states.Timeline(
                length=tab.length,
                frame_rate=clip.frame_rate,
                first_frame=clip.first_frame,
                title=title,
                unit=unit,
                curves=tuple(
                    states.Curve(label=label, color=color, values=curve_values(c.values)) for label, color, c in lines
                ),
            )
            tab.channel.send("timeline", timeline)

    def _of_each(self) -> list[tuple[str, str, Curve]]:
        """Label, colour and curve of the runs on show."""
        tab = self._tab
        lines = []
        for side, color in zip(SIDES, RUN_COLORS, strict=True):
            shown = tab.shown.fit(side)
            made = None if shown is None else tab.desk.curve(tab.state.curve, shown)
            found = self._latest(side, made)
            if shown is not None and found is not None:
                lines.append((shown.title, css(color), found))
        return lines

    def _between(self) -> list[tuple[str, str, Curve]]:
        tab = self._tab
        a, b = tab.shown.a, tab.shown.b
        if a is None or b is None:
            return []
        found = self._latest("b", tab.desk.between(a, b))
        return [] if found is None else [(f"{a.title} to {b.title}", _BETWEEN_COLOR, found)]

    def _latest(self, name: str, found: Curve | None) -> Curve | None:
        """A curve, or the last one of its kind until a newer one is there."""
        if found is not None:
            self._last[name] = found
        last = self._last.get(name)
        return last if last is not None and last.name == self._tab.state.curve else None

    def _draw_marks(self) -> None:
        tab, apart = self._tab, self._apart()
        if not tab.sent.differs("marks", tab.session.edits, tab.session.marked, apart):
            return
        corrected, marks = tab.session.project.corrected, tab.session.project.marks.all()
        by_state = {state: [f for f, mark in marks.items() if mark.state == state] for state in ("flag", "checked")}
        found = states.Marks(
            edited=spans(np.flatnonzero(corrected.edited.any(1))),
            bad=spans(np.flatnonzero(corrected.bad.any(1))),
            flagged=spans(by_state["flag"]),
            checked=spans(by_state["checked"]),
            apart=spans(sorted(apart)),
        )
        tab.channel.send("marks", found)

    def _apart(self) -> tuple[int, ...]:
        """The frames where two finished fits differ most, once that is known."""
        tab = self._tab
        a, b = tab.shown.a, tab.shown.b
        if a is None or b is None or a.result is None or b.result is None or a == b:
            return ()
        found = tab.desk.distances(a, b)
        return () if found is None else tuple(peaks(found.values))

    def _draw_provenance(self) -> None:
        tab = self._tab
        fits = (tab.shown.a, tab.shown.b)
        shown = {(fit.run.id, fit.phase): fit for fit in fits if fit is not None}.values()
        if tab.sent.differs("provenance", *((fit.run.id, fit.phase, fit.revision, fit.title) for fit in shown)):
            told = [(f.title, f.result.provenance) for f in shown if f.result is not None]
            found = tuple(origins(title, provenance) for title, provenance in told if provenance is not None)
            tab.channel.send("provenance", states.Provenance(fits=found) if found else None)

    def _draw_fit(self) -> None:
        tab = self._tab
        if tab.sent.differs("fit", tab.session.changes):
            jobs = tab.session.jobs.values()
            found = tuple(span for job in jobs if job.started for span in fit_spans(job, self._frames_of(job)))
            tab.channel.send("fit", states.Fit(spans=found) if found else None)

    def _frames_of(self, job: RunningJob) -> range:
        run = self._tab.session.fits.run(job.run) if job.run is not None else None
        return run.frames if run is not None and run.frames else range(self._tab.length)


def origins(label: str, provenance: Provenance) -> states.Origins:
    """Where the frames of a fit came from."""
    texts, which = provenance.sentences()
    return states.Origins(label=label, texts=texts, which=tuple(which.tolist()))


def fit_spans(job: RunningJob, frames: range) -> list[FitSpan]:
    """How far a job is with each of its frames."""
    if job.phase in (None, 1):
        return [FitSpan(first=frames[0], last=frames[-1], state="fitting")]
    if job.phase == 2:
        return [FitSpan(first=frames[0], last=frames[-1], state="phase1")]
    done = [FitSpan(first=w.start, last=w.stop - 1, state="done") for w in job.windows]
    start = max((w.stop for w in job.windows), default=frames.start)
    return [*done, FitSpan(first=start, last=frames[-1], state="phase2")] if start < frames.stop else done
