"""The panel that says what is seen: mode, playing, runs, layers, timeline."""

from typing import ClassVar

import viser

from fitting_core.keypoints import GROUPS
from tcfit_app.review.browser.page_states import GROUP_COLORS
from tcfit_app.review.drawing.timeline import PLOTTED
from tcfit_app.review.gestures.gestures import Gestures
from tcfit_app.review.panels.elements.field import Dropdown, Field
from tcfit_app.review.panels.elements.html import Board, action, button, choice, dot, heading, joined, row, text
from tcfit_app.review.panels.runs.runs_shown import RunsShown
from tcfit_app.review.tab.buttons import one_of
from tcfit_app.review.tab.state import MODES, SPEEDS

_CURVES = {f"{title} ({unit})" if unit else title: name for name, (title, unit) in PLOTTED.items()}
"""Curves by what they are called in the dropdown."""
_SWITCHES = {"video", "bones", "detections"}
"""What can be switched here and has no key."""
_COLORS_BY = ("group", "confidence")
_SPEEDS = {f"{speed:g}": speed for speed in SPEEDS}
"""By the value of their button."""
_APART = 1.2
"""Metres: two bodies with their arms stretched do not touch."""


class ViewPanel:
    """What is seen."""

    title: ClassVar[str] = "View"
    icon: ClassVar[viser.IconName] = viser.Icon.EYE

    def __init__(self, gestures: Gestures) -> None:
        self._tab = tab = gestures.tab
        gui = tab.client.gui
        self._top = Board(tab)
        last = max(1, tab.length - 1) + tab.first_frame
        frame = gui.add_number("Frame", tab.first_frame, min=tab.first_frame, max=last, step=1)
        self._frame = Field(tab, frame, self._jump)
        self._speed = Board(tab)
        self._runs = RunsShown(tab)
        self._layers = Board(tab)
        opacity = gui.add_slider("Opacity", 0.1, 1.0, 0.05, tab.state.opacity)
        self._opacity = Field(tab, opacity, lambda value: tab.set(opacity=value))
        self._keypoints = Board(tab)
        minimum = gui.add_slider(
            "Min. conf.", 0.0, 1.0, 0.05, 0.0, hint="Keypoints of less confidence are left out, unless selected"
        )
        self._minimum = Field(tab, minimum, lambda value: tab.set(minimum=value))
        curve = gui.add_dropdown("Timeline", tuple(_CURVES))
        self._curve = Dropdown(tab, curve, lambda title: tab.set(curve=_CURVES[title]))
        Board(tab).show(row(action("help", "All keys and gestures")))
        self._listen()

    def _listen(self) -> None:
        tab = self._tab
        tab.buttons.on("view.switch", self._switch, one_of(_SWITCHES))
        tab.buttons.on("view.group", self._switch_group, one_of(GROUPS))
        tab.buttons.on("view.color", lambda by: tab.set(color_by=by), one_of(_COLORS_BY))
        tab.buttons.on("view.speed", tab.set_speed, _SPEEDS.__getitem__)
        tab.buttons.on("view.apart", lambda _: tab.set(apart=0.0 if tab.state.apart else _APART))

    def _jump(self, number: int) -> None:
        self._tab.pause()
        self._tab.seek(int(number) - self._tab.first_frame)

    def _switch(self, name: str) -> None:
        self._tab.set(**{name: not getattr(self._tab.state, name)})

    def _switch_group(self, name: str) -> None:
        self._tab.set(groups=self._tab.state.groups ^ {name})

    def draw(self) -> None:
        """Bring it to the tab's state."""
        tab, state = self._tab, self._tab.state
        self._draw_playing()
        self._runs.draw()
        self._opacity.show(state.opacity)
        self._minimum.show(state.minimum)
        self._curve.show(next(title for title, name in _CURVES.items() if name == state.curve))
        if tab.sent.differs("view panel", state.bodies, state.wireframe, state.difference, state.mode, state.apart):
            self._draw_bodies()
        if tab.sent.differs(
            "keypoint layers",
            *(state.video, state.keypoints, state.bones, state.detections, state.groups, state.color_by),
        ):
            self._draw_keypoints()

    def _draw_playing(self) -> None:
        tab, state = self._tab, self._tab.state
        self._frame.show(state.frame + tab.first_frame)
        if not tab.sent.differs("playing", state.mode, state.playing, state.speed, state.loop, state.frames):
            return
        modes = (action(mode, name, pressed=state.mode == mode) for mode, name in MODES.items())
        self._top.show(
            row(choice(*modes)),
            row(
                choice(
                    action("previous10", "−10"),
                    action("previous", "−1"),
                    action("play", "Pause" if state.playing else "Play", kind="main"),
                    action("next", "+1"),
                    action("next10", "+10"),
                )
            ),
        )
        speeds = (button(f"{name}×", "view.speed", name, pressed=state.speed == s) for name, s in _SPEEDS.items())
        what = "the selection" if state.frames is not None else "the clip"
        self._speed.show(
            row(choice(*speeds), label="Speed"),
            row(action("loop", f"Loop {what}", pressed=state.loop), label=" "),
        )

    def _draw_bodies(self) -> None:
        state = self._tab.state
        rows = [
            heading("Bodies"),
            row(
                action("bodies", "Bodies", pressed=state.bodies),
                action("wireframe", "Wire", pressed=state.wireframe),
                action("difference", "A to B distance", pressed=state.difference),
            ),
        ]
        if state.mode == "space":
            hint = "Draws A and B beside each other instead of where they are"
            rows.append(row(button("A and B side by side", "view.apart", pressed=bool(state.apart), hint=hint)))
        self._layers.show(*rows)

    def _draw_keypoints(self) -> None:
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
        colors = (button(name, "view.color", name, pressed=state.color_by == name) for name in _COLORS_BY)
        self._keypoints.show(
            heading("Picture and keypoints"),
            row(action("fit_view", "Whole picture"), action("zoom", "Zoom to selected")),
            row(
                button("Video", "view.switch", "video", pressed=state.video),
                action("bones", "Keypoints", pressed=state.keypoints),
                button("Bones", "view.switch", "bones", pressed=state.bones),
                button(
                    "Trace",
                    "view.switch",
                    "detections",
                    pressed=state.detections,
                    hint="Lines from corrected keypoints to where they were detected",
                ),
            ),
            row(*groups),
            row(choice(*colors), label="Colour by"),
        )
