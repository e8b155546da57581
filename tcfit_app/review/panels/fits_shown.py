"""Which runs and phases are A and B: a part of the panel Compare."""

from collections.abc import Sequence
from functools import partial

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import PASSES, FitChoice, pass_of
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    choice,
    choices,
    dot,
    heading,
    joined,
    row,
    text,
)
from tcfit_app.review.tab.on_show import SLOTS, Slot

NEWEST = "Newest"
"""The newest run with a result."""
_LONGEST, _END = 28, 11
"""Characters of a run's name that are shown, and those of its end among them: longer ones do not fit the field."""
_HINTS = {"a": "Left of A | B, and what blinking shows", "b": "Right of A | B; corrections are made to it"}
_LEGEND = joined(dot("beside"), text("A"), Html("&emsp;"), dot("fit"), text("B"))


class FitsShown:
    """The choices of one tab."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab = gestures.tab
        self._numbers: dict[str, int | None] = {NEWEST: None}
        """Runs by their names in the dropdowns, the newest first."""
        self._head = Board(tab)
        self._runs: dict[Slot, Dropdown] = {}
        self._phases: dict[Slot, Board] = {}
        for side in SLOTS:
            handle = tab.client.gui.add_dropdown(f"{side.upper()} shows", (NEWEST,), hint=_HINTS[side])
            self._runs[side] = Dropdown(
                tab,
                handle,
                partial(self._choose_run, side),
                partial(self._name, side),
                options=lambda: tuple(self._numbers),
                off=lambda: len(self._numbers) == 1,
            )
            self._phases[side] = Board(tab)

    def _choose_run(self, side: Slot, name: str) -> None:
        if name in self._numbers:
            self._tab.set(**{side: FitChoice(run=self._numbers[name], phase=self._choice(side).phase)})

    def _name(self, side: Slot) -> str:
        run = self._choice(side).run
        return next(name for name, number in self._numbers.items() if number == run)

    def _choice(self, side: Slot) -> FitChoice:
        tab, b = self._tab, self._tab.shown.b
        choice = tab.state.b if side == "b" else tab.state.a or tab.session.fits.before(b and b.run)
        return tab.session.fits.standing(choice)

    def draw(self) -> None:
        """Update from the tab's state."""
        fits = self._tab.session.fits
        showable, chosen = fits.showable(), {self._choice(side).run for side in SLOTS}
        runs = [run for run in fits.runs if run in showable or run.id in chosen]
        self._head.show(heading("Fits on show", _LEGEND, first=True))
        named = [*zip(run_names(runs), runs, strict=True)]
        self._numbers = {NEWEST: None, **{name: run.id for name, run in reversed(named)}}
        for side in SLOTS:
            self._runs[side].draw()
            self._draw_phases(side)

    def _phases_of(self, run: Run | None) -> tuple[int, ...]:
        try:
            return () if run is None else self._tab.session.stored.phases(run)
        except InputError:  # the status line says what is wrong with its file
            return ()

    def _draw_phases(self, side: Slot) -> None:
        now = self._choice(side)
        run = self._tab.session.fits.meant(now)
        there = self._phases_of(run)
        titles = {p: PASSES[p] if run is None else pass_of(run, p) for p in PASSES}
        buttons = choices(
            f"runs.phase_{side}",
            {**titles, None: "last"},
            lambda phase: self._tab.set(**{side: FitChoice(run=now.run, phase=phase)}),
            lambda phase: now.phase == phase,
            disabled=lambda phase: run is None or (phase is not None and phase not in there),
            hint=lambda phase: "The last available phase" if phase is None else "",
        )
        phased = run is None or run.kind != "imported"  # a result of another program has no phases
        self._phases[side].show(*([row(choice(*buttons))] if phased else []))


def run_names(runs: Sequence[Run]) -> list[str]:
    """Names of runs for a list of options, each distinct; long ones lose their middle."""
    names = [_shortened(run.name) for run in runs]
    alike = [names.count(name) > 1 or name == NEWEST for name in names]
    return [f"{name} (#{run.id})" if also else name for run, name, also in zip(runs, names, alike, strict=True)]


def _shortened(name: str) -> str:
    """Keeps both ends: names in a long list often begin alike and end differently."""
    start = _LONGEST - _END - 1
    return name if len(name) <= _LONGEST else f"{name[:start]}…{name[-_END:]}"
