"""The View panel: mode, playback, which runs are A and B, layers."""

from collections.abc import Sequence
from functools import partial
from typing import ClassVar

import viser

from fitting_core.errors import InputError
from fitting_core.keypoints import GROUPS
from tcfit_app.fitting.fits import SHORT_TITLES, FitChoice, Shown, phase_title
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.browser.page_states import GROUP_COLORS
from tcfit_app.review.gestures.actions import ACTIONS, Gestures, key_text
from tcfit_app.review.gestures.zooming import show_close_up
from tcfit_app.review.panels.elements.field import Dropdown, Field
from tcfit_app.review.panels.elements.html import Board, Html, action, button, choice, dot, heading, joined, row, text
from tcfit_app.review.scene.layers import RUN_COLORS, css
from tcfit_app.review.scene.poses import SPACE_FROM
from tcfit_app.review.scene.side_view import angle_of, direction_text
from tcfit_app.review.scene.windows import ARRANGEMENTS
from tcfit_app.review.tab.buttons import one_of
from tcfit_app.review.tab.on_show import SLOTS
from tcfit_app.review.tab.state import BESIDE, CLOSE_UPS, MODES, OPACITIES, SIDES_SEEN, SPEEDS, Part

_SWITCHES = {"video", "bones", "detections", "others", "error_bars"}
"""Toggles without a key."""
_COLORS_BY = ("group", "confidence")
_SPEEDS = {f"{speed:g}": speed for speed in SPEEDS}
"""By the button's value."""
_WIDER = {"−": 1 / 1.25, "+": 1.25}
"""By the button's value: the factor by which the side view becomes wider."""
_SPACE_FROM = (*SPACE_FROM, "camera")
_CLOSE_UP = "The view follows it from frame to frame; press again for the whole picture"


class ViewPanel:
    """What is visible."""

    title: ClassVar[str] = "View"
    icon: ClassVar[viser.IconName] = viser.Icon.EYE

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab, self._action = gestures, gestures.tab, partial(action, gestures)
        tab, gui = gestures.tab, gestures.tab.client.gui
        self._top = Board(tab)
        last = max(1, tab.length - 1) + tab.first_frame
        frame = gui.add_number("Frame", tab.first_frame, min=tab.first_frame, max=last, step=1)
        self._frame = Field(tab, frame, self._jump)
        self._speed = Board(tab)
        self._runs = RunsShown(gestures)
        self._layers = Board(tab)
        slider = gui.add_slider("Opacity", *OPACITIES, 0.05, tab.state.opacity, hint="Of bodies; keys , and .")
        self._opacity_slider = slider
        self._opacity = Field(tab, slider, lambda value: tab.set(opacity=value))
        self._side = Board(tab)
        self._turn_slider = gui.add_slider(
            "Turn", -180, 180, 5, 90, hint="Degrees about the vertical: 0 is the camera's own view"
        )
        self._turn = Field(tab, self._turn_slider, lambda value: tab.set(side_from=float(value)))
        self._keypoints = Board(tab)
        minimum = gui.add_slider(
            "Hide below", 0.0, 1.0, 0.05, 0.0, hint="Keypoints of a lower confidence are hidden, unless selected"
        )
        self._minimum = Field(tab, minimum, lambda value: tab.set(minimum=value))
        Board(tab).show(row(self._action("help", "All keys and gestures")))
        self._listen()

    def _listen(self) -> None:
        tab = self._tab
        tab.buttons.on("view.switch", self._switch, one_of(_SWITCHES))
        tab.buttons.on("view.group", self._switch_group, one_of(GROUPS))
        tab.buttons.on("view.color", lambda by: tab.set(color_by=by), one_of(_COLORS_BY))
        tab.buttons.on("view.speed", tab.set_speed, _SPEEDS.__getitem__)
        tab.buttons.on("view.side", lambda name: tab.set(side=True, side_from=name), one_of(SIDES_SEEN))
        tab.buttons.on("view.widen", self._widen, _WIDER.__getitem__)
        tab.buttons.on("view.from", tab.scene.look_from, one_of(_SPACE_FROM))
        tab.buttons.on("view.close_up", self._switch_close_up, one_of(CLOSE_UPS))
        tab.buttons.on("view.clip", lambda _: tab.set(clipped=not tab.clipped))
        tab.buttons.on("view.arrange", lambda way: tab.set(arrangement=way), one_of(ARRANGEMENTS))
        tab.buttons.on("view.beside", lambda beside: tab.set(beside=beside), one_of(BESIDE))

    def _jump(self, number: int) -> None:
        self._tab.pause()
        self._tab.seek(int(number) - self._tab.first_frame)

    def _widen(self, factor: float) -> None:
        self._tab.set_side_width(factor * self._tab.side_width)

    def _switch(self, name: str) -> None:
        self._tab.set(**{name: not getattr(self._tab.state, name)})

    def _switch_close_up(self, part: Part) -> None:
        show_close_up(self._tab, None if part == self._tab.state.close_up else part)

    def _switch_group(self, name: str) -> None:
        self._tab.set(groups=self._tab.state.groups ^ {name})

    def draw(self) -> None:
        """Update from the tab's state."""
        tab, state = self._tab, self._tab.state
        self._draw_playing()
        self._runs.draw()
        self._opacity.show(state.opacity)
        self._minimum.show(state.minimum)
        self._draw_bodies()
        self._draw_side(tab.shown.held)
        if (angle := angle_of(state.side_from)) is not None:
            self._turn.show(angle)
        self._turn_slider.disabled = angle is None
        self._draw_keypoints(tab.shown.held)

    def _draw_playing(self) -> None:
        tab, state = self._tab, self._tab.state
        self._frame.show(state.frame + tab.first_frame)
        now = tab.arrangement if state.mode == "ab" else None
        hint = f"Arrangement of A and B ({key_text('arrangement')}: the next)"
        modes = (self._action(mode, name, pressed=state.mode == mode) for mode, name in MODES.items())
        ways = (button(name, "view.arrange", way, pressed=now == way, hint=hint) for way, name in ARRANGEMENTS.items())
        self._top.show(
            row(choice(*modes)),
            *([row(choice(*ways))] if now else []),
            row(
                choice(
                    self._action("previous10", "−10"),
                    self._action("previous", "−1"),
                    self._action("play", "Pause" if state.playing else "Play", kind="main"),
                    self._action("next", "+1"),
                    self._action("next10", "+10"),
                )
            ),
        )
        speeds = (button(f"{name}×", "view.speed", name, pressed=state.speed == s) for name, s in _SPEEDS.items())
        what = "the selection" if state.frames is not None else "the clip"
        self._speed.show(
            row(choice(*speeds), label="Speed"),
            row(self._action("loop", f"Loop {what}", pressed=state.loop), label=" "),
        )

    def _draw_bodies(self) -> None:
        state = self._tab.state
        rows = [
            heading("Bodies"),
            row(
                self._action("bodies", "Bodies", pressed=state.bodies),
                self._action("outline", "Outline", pressed=state.outline),
            ),
        ]
        if self._tab.someone.others:
            hint = "The newest fits of the clip's other people, dimmed"
            rows.append(row(button("Other people", "view.switch", "others", pressed=state.others, hint=hint)))
        why = ACTIONS["bodies"].obstacle(self._gestures)
        self._opacity_slider.disabled = bool(why)
        difference = self._action("difference", "A–B distance", pressed=state.difference)
        if state.mode != "space":
            hint = "Cut bodies off at the picture's edge"
            clip = button("Clip to the picture", "view.clip", pressed=self._tab.clipped, obstacle=why, hint=hint)
            rows += [row(clip, difference), row(self._action("peek", "Video only, while held"))]
        else:
            rows.append(row(difference))
            looks = (button(name.title(), "view.from", name) for name in _SPACE_FROM)
            rows.append(row(choice(*looks), label="Seen from"))
            ways = (button(name, "view.beside", way, pressed=state.beside == way) for way, name in BESIDE.items())
            rows.append(row(choice(*ways)))
        self._layers.show(*rows)

    def _draw_side(self, held: Shown | None) -> None:
        state = self._tab.state
        flat = state.mode != "space"
        why = ACTIONS["side"].obstacle(self._gestures)
        self._turn_slider.visible = flat and state.side and not why
        if not flat:
            self._side.show()
            return
        seen = (
            button(
                name.title(),
                "view.side",
                name,
                pressed=state.side_from == name,
                obstacle=why,
                hint=direction_text(name).capitalize(),
            )
            for name in SIDES_SEEN
        )
        wider = (
            button(
                sign,
                "view.widen",
                sign,
                obstacle=why,
                hint=f"{what} side view; its left border can be dragged",
            )
            for sign, what in zip(_WIDER, ("A narrower", "A wider"), strict=True)
        )
        known = held is None or self._tab.data.level(held) is not None
        self._side.show(
            heading("Side view", "" if known else "gravity not known"),
            row(self._action("side", "Show", pressed=state.side), choice(*seen), choice(*wider)),
        )

    def _draw_keypoints(self, held: Shown | None) -> None:
        state = self._tab.state
        groups = (
            button(
                joined(dot(GROUP_COLORS[name]), text(name.replace("_", " "))),
                "view.group",
                name,
                pressed=name in state.groups,
            )
            for name in GROUPS
        )
        flat, unseen = ACTIONS["close_up"].obstacle(self._gestures), ACTIONS["peek"].obstacle(self._gestures)
        whole = "Whole body" if state.mode == "space" else "Whole picture"
        colors = (button(name, "view.color", name, pressed=state.color_by == name) for name in _COLORS_BY)
        self._keypoints.show(
            heading("Picture and keypoints"),
            row(self._action("fit_view", whole), self._action("zoom", "Zoom to selected")),
            row(self._action("save_picture", "Save picture")),
            row(
                choice(
                    *(
                        button(
                            name,
                            "view.close_up",
                            part,
                            pressed=state.close_up == part,
                            obstacle=flat,
                            hint=_CLOSE_UP,
                        )
                        for part, name in CLOSE_UPS.items()
                    )
                ),
                label=f"Close-up {key_text('close_up')}",
            ),
            row(
                button("Video", "view.switch", "video", pressed=state.video, obstacle=unseen),
                self._action("bones", "Keypoints", pressed=state.keypoints),
                button("Bones", "view.switch", "bones", pressed=state.bones),
                button(
                    "Trace",
                    "view.switch",
                    "detections",
                    pressed=state.detections,
                    hint="Lines from corrected keypoints to their detected positions",
                ),
                self._action("trail", "Trail", pressed=state.trail),
                self._silhouette(),
                self._error_bars(held),
                wrap=True,
            ),
            row(*groups),
            row(choice(*colors), label="Colour by"),
        )

    def _error_bars(self, held: Shown | None) -> Html:
        known = held is not None and held.result is not None and held.result.error_bars is not None
        hint = "In the side view and in 3D: about two thirds of joints lie within, relative to the pelvis"
        unknown = "This fit has none: only phase 3 with the lifter does"
        pressed = known and self._tab.state.error_bars
        hint = hint if known else unknown
        return button("Error bars", "view.switch", "error_bars", pressed=pressed, disabled=not known, hint=hint)

    def _silhouette(self) -> Html:
        known = self._tab.session.project.footage.silhouettes is not None
        pressed = known and self._tab.state.silhouette
        return self._action("silhouette", "Silhouette", pressed=pressed, hint="The detected outline of the person")


NEWEST = "Newest"
"""The newest run with a result."""
_LONGEST, _END = 28, 11
"""Characters of a run's name that are shown, and those of its end among them: longer ones do not fit the field."""
_HINTS = {"a": "Left of A | B, and what blinking shows", "b": "Right of A | B; corrections are made to it"}
_SWAP = "What was A becomes B: corrections are then made to it"
_LEGEND = joined(dot(css(RUN_COLORS[0])), text("A"), Html("&emsp;"), dot(css(RUN_COLORS[1])), text("B"))
_PHASES: tuple[int | None, ...] = (*SHORT_TITLES, None)
"""Choices for a run's phase; None: its last."""
_PHASE_CHOICES = {f"{side} {phase or ''}": (side, phase) for side in SLOTS for phase in _PHASES}
"""By the button's value."""


class RunsShown:
    """Which runs and phases are A and B: a part of the panel."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab, self._action = gestures, gestures.tab, partial(action, gestures)
        tab = gestures.tab
        self._numbers: dict[str, int | None] = {}
        """Runs by their names in the dropdowns."""
        self._head = Board(tab)
        self._runs: dict[str, Dropdown] = {}
        self._phases: dict[str, Board] = {}
        for side in SLOTS:
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
        return self._tab.session.fits.standing(self._tab.state.a if side == "a" else self._tab.state.b)

    def draw(self) -> None:
        """Update from the tab's state."""
        tab, state = self._tab, self._tab.state
        fits = tab.session.fits
        showable, chosen = fits.showable(), {self._choice(side).run for side in SLOTS}
        runs = [run for run in fits.runs if run in showable or run.id in chosen]
        shown = {side: fits.meant(self._choice(side)) for side in SLOTS}
        there = {side: self._phases_of(shown[side]) for side in SLOTS}
        why = ACTIONS["blink"].obstacle(self._gestures)
        self._head.show(
            heading("Fits on show", _LEGEND),
            row(
                self._action("blink", "Blink A in B's place", pressed=state.blinked),
                button("Swap A and B", "runs.swap", obstacle=why, hint=_SWAP),
            ),
        )
        names = run_names(runs)
        self._numbers = {NEWEST: None, **{name: run.id for run, name in zip(runs, names, strict=True)}}
        for side in SLOTS:
            self._draw_side(side, runs, shown[side], there[side])

    def _phases_of(self, run: Run | None) -> tuple[int, ...]:
        try:
            return () if run is None else self._tab.session.stored.phases(run)
        except InputError:  # the status line says what is wrong with its file
            return ()

    def _draw_side(self, side: str, runs: list[Run], shown: Run | None, there: tuple[int, ...]) -> None:
        now = self._choice(side)
        names = {number: name for name, number in self._numbers.items()}
        options = [NEWEST, *(names[run.id] for run in reversed(runs))]
        self._runs[side].offer(options, names[now.run])
        self._runs[side].enable(bool(runs))
        phased = shown is None or shown.kind != "imported"  # a result of another program has no phases
        self._phases[side].show(*([row(choice(*self._phase_buttons(side, now, shown, there)))] if phased else []))

    def _phase_buttons(self, side: str, now: FitChoice, run: Run | None, there: tuple[int, ...]) -> list[Html]:
        return [
            button(
                "last" if phase is None else SHORT_TITLES[phase] if run is None else phase_title(run, phase),
                "runs.phase",
                f"{side} {phase or ''}",
                pressed=now.phase == phase,
                disabled=run is None or (phase is not None and phase not in there),
                hint="The last phase that is there" if phase is None else "",
            )
            for phase in _PHASES
        ]


def run_names(runs: Sequence[Run]) -> list[str]:
    """Names of runs for a list of options, each distinct; long ones lose their middle."""
    names = [_shortened(run.name) for run in runs]
    alike = [names.count(name) > 1 or name == NEWEST for name in names]
    return [f"{name} (#{run.id})" if also else name for run, name, also in zip(runs, names, alike, strict=True)]


def _shortened(name: str) -> str:
    """Keeps both ends: names in a long list often begin alike and end differently."""
    start = _LONGEST - _END - 1
    return name if len(name) <= _LONGEST else f"{name[:start]}…{name[-_END:]}"
