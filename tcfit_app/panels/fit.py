"""The panel Fit: settings, what to fit with them, and how far that is."""

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import viser

from tcfit_app.panels.fields import Field, Shown, on_press
from tcfit_app.panels.fit_progress import FitProgress
from tcfit_app.panels.fit_settings import FitInputs
from tcfit_app.view_state import FitSettings

if TYPE_CHECKING:
    from tcfit_app.fits import Shown as ShownFit
    from tcfit_app.page import Page


class FitPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Fit"
    icon: ClassVar[viser.IconName] = viser.Icon.RUN

    def __init__(self, page: "Page") -> None:
        self._page, gui = page, page.client.gui
        self._inputs = FitInputs(page)
        self._inputs.add_preset()
        self._inputs.add("temporal.weight", "temporal.mode", "temporal.window_size", "temporal.space")
        self._inputs.add_problems()
        self._add_buttons(gui)
        self._progress = FitProgress(page)
        with gui.add_folder("Shape, solver, prior"):
            self._inputs.add("shape_sample.size", "shape_sample.strategy", "shape_sample.seed", "solver", "pose_prior")
        with gui.add_folder("Body and camera", expand_by_default=False):
            self._inputs.add_body()
        with gui.add_folder("All settings", expand_by_default=False):
            self._inputs.add_source()

    def _add_buttons(self, gui: viser.GuiApi) -> None:
        page = self._page
        self._everything = Shown(gui.add_button("Fit everything", icon=viser.Icon.PLAYER_PLAY, color="blue"))
        self._frames = Shown(gui.add_button("Re-run selected frames", color="gray"))
        self._edited = Shown(gui.add_button("Re-run edited frames", color="gray"))
        hint = "So many frames before and after each edited or flagged one are fitted again with it."
        reach = gui.add_number("Around", page.state.settings.reach, step=1, hint=hint)
        self._reach = Field(page, reach, self._take_reach)
        self._shape = Shown(gui.add_button("Re-run shape", color="gray"))
        on_press(page, self._everything.handle, page.submitting.everything)
        on_press(page, self._frames.handle, page.submitting.frames)
        on_press(page, self._edited.handle, page.submitting.edited)
        on_press(page, self._shape.handle, page.submitting.shape)

    def _take_reach(self, value: float) -> None:
        self._page.set(settings=with_reach(self._page.state.settings, value))

    def draw(self) -> None:
        """See `Panel.draw`."""
        self._inputs.draw()
        self._progress.draw()
        self._draw_buttons()

    def _draw_buttons(self) -> None:
        page = self._page
        state, session = page.state, page.session
        known = (state.frames, state.b, state.settings, session.edits, session.marked, session.fits.changes)
        if not page.changes.of("fit buttons", known):
            return
        fit, ready = page.corrected_fit(), not state.settings.problems and not session.project.read_only
        self._everything.show(disabled=not ready)
        self._reach.show(state.settings.reach, wrong="reach" in dict(state.settings.problems))
        self._frames.show(label=self._frames_label(fit), disabled=not ready or fit is None or state.frames is None)
        windows = page.submitting.edited_windows(fit) if fit is not None else ()
        where = f": {_spans(windows, page.first_frame)}" if windows else " (none since the fit)"
        self._edited.show(label=f"Re-run around edits{where}", disabled=not ready or not windows)
        self._shape.show(label=_shape_label(fit), disabled=not ready or fit is None)

    def _frames_label(self, fit: "ShownFit | None") -> str:
        frames = self._page.state.frames
        if fit is None:
            return "Re-run frames (no fit yet)"
        which = "(Shift-drag selects)" if frames is None else _spans((frames,), self._page.first_frame)
        return f"Re-run frames {which}"


def _shape_label(fit: "ShownFit | None") -> str:
    return "Re-run shape (no fit yet)" if fit is None else "Re-run shape"


def _spans(windows: tuple[range, ...], first: int) -> str:
    """Ranges of frames, in one line of a button; `first` is the number that users see for frame 0."""
    said = ", ".join(f"{first + w[0]}–{first + w[-1]}" if len(w) > 1 else f"{first + w[0]}" for w in windows[:2])
    return said if len(windows) < 3 else f"{said} and {len(windows) - 2} more"


def with_reach(settings: FitSettings, value: float) -> FitSettings:
    """Settings with another number of frames around an edit, or with the reason why it cannot be that."""
    problems = {name: why for name, why in settings.problems if name != "reach"}
    if value != int(value) or not 0 <= value <= 1000:
        problems["reach"] = f"Frames around edits: {value:g}; expected a whole number, 0 to 1000."
        return replace(settings, problems=tuple(problems.items()))
    return replace(settings, reach=int(value), problems=tuple(problems.items()))
