"""The panel Fit: settings, what to fit with them, and how far that is."""

from dataclasses import replace
from typing import ClassVar

import viser

from tcfit_app.fitting.fits import Shown
from tcfit_app.project.frame_words import numbers
from tcfit_app.review.gestures.gestures import Gestures
from tcfit_app.review.panels.elements.field import Field
from tcfit_app.review.panels.elements.html import Board, action, heading, row
from tcfit_app.review.panels.fit.fit_progress import FitProgress
from tcfit_app.review.panels.fit.fit_settings import FitInputs
from tcfit_app.review.tab.state import FitSettings


class FitPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Fit"
    icon: ClassVar[viser.IconName] = viser.Icon.RUN

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab, gui = gestures.tab, gestures.tab.client.gui
        self._inputs = FitInputs(tab)
        self._inputs.add_preset()
        self._inputs.add("temporal.weight", "temporal.mode", "temporal.window_size", "temporal.space")
        self._inputs.add_problems()
        self._everything = Board(tab)
        self._progress = FitProgress(tab)
        self._again = Board(tab)
        hint = "So many frames before and after each edited or flagged one are fitted again with it."
        reach = gui.add_number("Around", tab.state.settings.reach, step=1, hint=hint)
        self._reach = Field(tab, reach, self._take_reach)
        with gui.add_folder("Shape, solver, prior"):
            self._inputs.add("shape_sample.size", "shape_sample.strategy", "shape_sample.seed", "solver", "pose_prior")
        with gui.add_folder("Body and camera", expand_by_default=False):
            self._inputs.add_body()
        with gui.add_folder("All settings", expand_by_default=False):
            self._inputs.add_source()

    def _take_reach(self, value: float) -> None:
        self._tab.set(settings=with_reach(self._tab.state.settings, value))

    def draw(self) -> None:
        """See `Panel.draw`."""
        self._inputs.draw()
        self._progress.draw()
        self._draw_buttons()

    def _draw_buttons(self) -> None:
        tab = self._tab
        state, session = tab.state, tab.session
        self._reach.show(state.settings.reach, wrong="reach" in dict(state.settings.problems))
        known = (state.frames, state.b, state.settings, session.edits, session.marked, session.fits.changes)
        if not tab.sent.differs("fit buttons", known):
            return
        fit, ready = tab.shown.b, not state.settings.problems and not session.project.read_only
        self._everything.show(row(action("fit", "Fit everything", disabled=not ready, kind="main")))
        windows = self._gestures.fitting.edited_windows(fit) if fit is not None else ()
        frames = state.frames if fit is not None else None
        self._again.show(
            heading("Fit B again", "" if fit is not None else "there is no fit yet"),
            row(action("rerun", self._frames_label(fit), disabled=not ready or frames is None)),
            row(action("rerun_shape", "Re-run shape", disabled=not ready or fit is None)),
            row(action("rerun_edited", self._edited_label(windows), disabled=not ready or not windows)),
        )

    def _frames_label(self, fit: Shown | None) -> str:
        frames = self._tab.state.frames
        if fit is None:
            return "Re-run frames"
        if frames is None:
            return "Re-run frames (Shift-drag selects)"
        return f"Re-run frames {numbers(frames, self._tab.first_frame)}"

    def _edited_label(self, windows: tuple[range, ...]) -> str:
        if not windows:
            return "Re-run around edits (none since the fit)"
        frames = [frame for window in windows for frame in window]
        return f"Re-run around edits: {numbers(frames, self._tab.first_frame, most=2)}"


def with_reach(settings: FitSettings, value: float) -> FitSettings:
    """Settings with another number of frames around an edit, or with the reason why it cannot be that."""
    problems = {name: why for name, why in settings.problems if name != "reach"}
    if value != int(value) or not 0 <= value <= 1000:
        problems["reach"] = f"Frames around edits: {value:g}; expected a whole number, 0 to 1000."
        return replace(settings, problems=tuple(problems.items()))
    return replace(settings, reach=int(value), problems=tuple(problems.items()))
