"""Choosing which runs and phases are A and B."""

from collections.abc import Sequence
from functools import partial
from typing import Literal

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import TITLES, FitChoice
from tcfit_app.project.storage.runs import Run, newest
from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.panels.elements.html import Board, Html, action, button, choice, dot, heading, joined, row, text
from tcfit_app.review.scene.layers import RUN_COLORS, css
from tcfit_app.review.tab.tab import Tab

NEWEST = "Newest"
"""Stands for the newest run that has a result."""
_GONE = "Deleted run"
_LONGEST, _END = 28, 11
"""Characters of a run's name that are shown, and those of its end among them: more are wider than the field."""
_SIDES: tuple[Literal["a", "b"], ...] = ("a", "b")
_HINTS = {"a": "Left of A | B, and what blinking shows", "b": "Right of A | B; corrections are made to it"}
_LEGEND = joined(dot(css(RUN_COLORS[0])), text("A"), Html("&emsp;"), dot(css(RUN_COLORS[1])), text("B"))
_PHASES: dict[int | None, str] = {**TITLES, None: "last"}
_PHASE_CHOICES = {f"{side} {phase or ''}": (side, phase) for side in _SIDES for phase in _PHASES}
"""By the value of their button."""


class RunsShown:
    """A part of a panel."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._numbers: dict[str, int | None] = {}
        """Runs by what they are called in the dropdowns."""
        self._head = Board(tab)
        self._runs: dict[str, Dropdown] = {}
        self._phases: dict[str, Board] = {}
        for side in _SIDES:
            handle = tab.client.gui.add_dropdown(f"{side.upper()} shows", (NEWEST,), hint=_HINTS[side])
            self._runs[side] = Dropdown(tab, handle, partial(self._choose_run, side))
            self._phases[side] = Board(tab)
        tab.buttons.on("runs.phase", self._choose_phase, _PHASE_CHOICES.__getitem__)
        tab.buttons.on("runs.swap", lambda _: tab.set(a=tab.state.b, b=tab.state.a))

    def _choose_run(self, side: str, name: str) -> None:
        if name in self._numbers:
            now = self._choice(side)
            self._tab.set(**{side: FitChoice(run=self._numbers[name], phase=now.phase)})

    def _choose_phase(self, chosen: tuple[str, int | None]) -> None:
        side, phase = chosen
        now = self._choice(side)
        self._tab.set(**{side: FitChoice(run=now.run, phase=phase)})

    def _choice(self, side: str) -> FitChoice:
        return self._tab.state.a if side == "a" else self._tab.state.b

    def draw(self) -> None:
        """Bring it to the tab's state."""
        tab, state = self._tab, self._tab.state
        fits = tab.session.fits
        runs = fits.showable()
        there = {side: self._phases_of(self._run(side, runs)) for side in _SIDES}
        if not tab.sent.differs("runs shown", state.a, state.b, state.blinked, fits.changes, *there.values()):
            return
        self._head.show(
            heading("Fits on show", _LEGEND),
            row(
                action("blink", "Blink A in B's place", pressed=state.blinked),
                button("Swap A and B", "runs.swap", hint="What was A becomes B: corrections are then made to it"),
            ),
        )
        names = run_names(runs)
        self._numbers = {NEWEST: None, **{name: run.id for run, name in zip(runs, names, strict=True)}}
        for side in _SIDES:
            self._draw_side(side, runs, there[side])

    def _run(self, side: str, runs: list[Run]) -> Run | None:
        number = self._choice(side).run
        if number is None:
            return newest(runs) if runs else None
        return next((run for run in runs if run.id == number), None)

    def _phases_of(self, run: Run | None) -> tuple[int, ...]:
        try:
            return () if run is None else self._tab.session.stored.phases(run)
        except InputError:  # the status line says what is wrong with its file
            return ()

    def _draw_side(self, side: str, runs: list[Run], there: tuple[int, ...]) -> None:
        now = self._choice(side)
        names = {number: name for name, number in self._numbers.items()}
        options = [NEWEST, *(names[run.id] for run in reversed(runs))]
        if now.run not in names:
            options.append(_GONE)
        self._runs[side].offer(options, names.get(now.run, _GONE))
        self._phases[side].show(row(choice(*self._phase_buttons(side, now, there))))

    def _phase_buttons(self, side: str, now: FitChoice, there: tuple[int, ...]) -> list[Html]:
        return [
            button(
                name,
                "runs.phase",
                f"{side} {phase or ''}",
                pressed=now.phase == phase,
                disabled=phase is not None and phase not in there,
            )
            for phase, name in _PHASES.items()
        ]


def run_names(runs: Sequence[Run]) -> list[str]:
    """What runs are called in a list of options, where each name stands only once; long ones without their middle."""
    names = [_shortened(run.name) for run in runs]
    taken = {NEWEST, _GONE}
    alike = [names.count(name) > 1 or name in taken for name in names]
    return [f"{name} (#{run.id})" if also else name for run, name, also in zip(runs, names, alike, strict=True)]


def _shortened(name: str) -> str:
    """Names of a long list often begin alike, and end differently."""
    start = _LONGEST - _END - 1
    return name if len(name) <= _LONGEST else f"{name[:start]}…{name[-_END:]}"
