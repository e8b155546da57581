"""The View panel: mode, playback, which runs are A and B, layers."""

from collections.abc import Sequence
from functools import partial
from typing import ClassVar

import viser

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import PASSES, FitChoice, Shown, pass_of
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.gestures.actions import ACTIONS, Gestures, key_text
from tcfit_app.review.gestures.zooming import show_close_up
from tcfit_app.review.panels.elements.field import Dropdown, Field
from tcfit_app.review.panels.elements.html import (
    GROUP_LABELS,
    Board,
    Html,
    action,
    choice,
    choices,
    dot,
    heading,
    joined,
    options,
    row,
    switches,
    text,
)
from tcfit_app.review.scene.side_view import DIRECTION_TEXTS, Direction
from tcfit_app.review.tab.on_show import SLOTS, Slot
from tcfit_app.review.tab.state import CLOSE_UPS, MODES, Part

_CLOSE_UP = "The view follows it from frame to frame; press again for the whole picture"


class ViewPanel:
    """What is visible."""

    title: ClassVar[str] = "View"
    icon: ClassVar[viser.IconName] = viser.Icon.EYE

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab, self._action = gestures, gestures.tab, partial(action, gestures)
        tab, gui = gestures.tab, gestures.tab.client.gui
        self._top = Board(tab)
        first, last = tab.first_frame, tab.first_frame + max(1, tab.length - 1)
        frame = gui.add_number("Frame", first, min=first, max=last, step=1)
        self._speed = Board(tab)
        self._runs = RunsShown(gestures)
        self._layers = Board(tab)
        self._side = Board(tab)
        self._keypoints = Board(tab)
        self._frame = Field(tab, frame, self._jump, lambda: tab.state.frame + first)
        Board(tab).show(row(self._action("help", "All keys and gestures")))

    def _jump(self, number: int) -> None:
        self._tab.pause()
        self._tab.seek(int(number) - self._tab.first_frame)

    def draw(self) -> None:
        """Update from the tab's state."""
        self._frame.draw()
        self._draw_playing()
        self._runs.draw()
        self._draw_bodies()
        self._draw_side(self._tab.shown.held)
        self._draw_keypoints()

    def _draw_playing(self) -> None:
        tab, state, act = self._tab, self._tab.state, self._action
        modes = (act(mode, name, pressed=state.mode == mode) for mode, name in MODES.items())
        self._top.show(
            row(choice(*modes)),
            *([row(act("wipe", "Wipe", pressed=state.wipe))] if state.mode == "ab" else []),
            row(
                choice(
                    act("previous10", "−10"),
                    act("previous", "−1"),
                    act("play", "Pause" if state.playing else "Play", kind="main"),
                    act("next", "+1"),
                    act("next10", "+10"),
                )
            ),
        )
        what = "the selection" if state.frames is not None else "the clip"
        self._speed.show(options(tab, "speed"), row(act("loop", f"Loop {what}"), label=" "))

    def _draw_bodies(self) -> None:
        shown = switches(self._gestures, "bodies")
        pairs = [row(*shown[i : i + 2]) for i in range(0, len(shown), 2)]
        opacity = row(choice(self._action("fainter", "Less"), self._action("denser", "More")), label="Opacity")
        in_space = row(*switches(self._gestures, "space"))
        self._layers.show(heading("Bodies"), *pairs, in_space if self._tab.state.mode == "space" else opacity)

    def _draw_side(self, held: Shown | None) -> None:
        tab, state = self._tab, self._tab.state
        if state.mode == "space":
            return self._side.show()
        sides: dict[Direction, str] = {name: name.title() for name in DIRECTION_TEXTS}
        seen = choices(
            "view.side",
            sides,
            lambda name: tab.set(side=True, side_from=name),
            lambda name: state.side_from == name,
            obstacle=ACTIONS["side"].obstacle(self._gestures),
            hint=lambda name: DIRECTION_TEXTS[name].capitalize(),
        )
        known = held is None or tab.data.level(held) is not None
        self._side.show(
            heading("Side view", "" if known else "gravity not known"),
            row(*switches(self._gestures, "side"), choice(*seen)),
        )

    def _draw_keypoints(self) -> None:
        tab, state, act = self._tab, self._tab.state, self._action
        groups = choices(
            "view.group",
            GROUP_LABELS,
            lambda name: tab.set(groups=tab.state.groups ^ {name}),
            lambda name: name in state.groups,
        )
        parts = choices(
            "view.close_up",
            CLOSE_UPS,
            self._switch_close_up,
            lambda part: part == state.close_up,
            obstacle=ACTIONS["close_up"].obstacle(self._gestures),
            hint=lambda part: _CLOSE_UP,
        )
        self._keypoints.show(
            heading("Picture and keypoints"),
            row(
                act("fit_view", "Whole body" if state.mode == "space" else "Whole picture"),
                act("zoom", "Zoom to selected"),
            ),
            row(choice(*parts), label=f"Close-up {key_text('close_up')}"),
            row(*switches(self._gestures, "picture"), wrap=True),
            row(*groups, wrap=True),
        )

    def _switch_close_up(self, part: Part) -> None:
        show_close_up(self._tab, None if part == self._tab.state.close_up else part)


NEWEST = "Newest"
"""The newest run with a result."""
_LONGEST, _END = 28, 11
"""Characters of a run's name that are shown, and those of its end among them: longer ones do not fit the field."""
_HINTS = {"a": "Left of A | B, and what blinking shows", "b": "Right of A | B; corrections are made to it"}
_LEGEND = joined(dot("beside"), text("A"), Html("&emsp;"), dot("fit"), text("B"))


class RunsShown:
    """Which runs and phases are A and B: a part of the panel."""

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
        self._head.show(
            heading("Fits on show", _LEGEND),
            row(
                *switches(self._gestures, "fits"),
            ),
        )
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
