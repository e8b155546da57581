"""The panel that says what is seen: mode, playing, runs, layers, timeline."""

from typing import TYPE_CHECKING, ClassVar

import viser

from fitting_core.keypoints import GROUPS
from tcfit_app.review.browser.page_states import GROUP_COLORS
from tcfit_app.review.panels.elements.field import Dropdown, Field
from tcfit_app.review.panels.elements.html import Board, action, button, choice, dot, heading, joined, row, text
from tcfit_app.review.panels.runs.runs_shown import RunsShown
from tcfit_app.review.presses import one_of
from tcfit_app.review.timeline import PLOTTED
from tcfit_app.review.view_state import MODES, SPEEDS

if TYPE_CHECKING:
    from tcfit_app.review.page import Page

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

    def __init__(self, page: "Page") -> None:
        self._page = page
        gui = page.client.gui
        self._top = Board(page)
        last = max(1, page.length - 1) + page.first_frame
        frame = gui.add_number("Frame", page.first_frame, min=page.first_frame, max=last, step=1)
        self._frame = Field(page, frame, self._jump)
        self._speed = Board(page)
        self._runs = RunsShown(page)
        self._layers = Board(page)
        opacity = gui.add_slider("Opacity", 0.1, 1.0, 0.05, page.state.opacity)
        self._opacity = Field(page, opacity, lambda value: page.set(opacity=value))
        self._keypoints = Board(page)
        minimum = gui.add_slider(
            "Min. conf.", 0.0, 1.0, 0.05, 0.0, hint="Keypoints of less confidence are left out, unless selected"
        )
        self._minimum = Field(page, minimum, lambda value: page.set(minimum=value))
        curve = gui.add_dropdown("Timeline", tuple(_CURVES))
        self._curve = Dropdown(page, curve, lambda title: page.set(curve=_CURVES[title]))
        Board(page).show(row(action("help", "All keys and gestures")))
        self._listen()

    def _listen(self) -> None:
        page = self._page
        page.on_press("view.switch", self._switch, one_of(_SWITCHES))
        page.on_press("view.group", self._switch_group, one_of(GROUPS))
        page.on_press("view.color", lambda by: page.set(color_by=by), one_of(_COLORS_BY))
        page.on_press("view.speed", page.set_speed, _SPEEDS.__getitem__)
        page.on_press("view.apart", lambda _: page.set(apart=0.0 if page.state.apart else _APART))

    def _jump(self, number: int) -> None:
        self._page.pause()
        self._page.seek(number - self._page.first_frame)

    def _switch(self, name: str) -> None:
        self._page.set(**{name: not getattr(self._page.state, name)})

    def _switch_group(self, name: str) -> None:
        self._page.set(groups=self._page.state.groups ^ {name})

    def draw(self) -> None:
        """Bring it to the page's state."""
        page, state = self._page, self._page.state
        self._draw_playing()
        self._runs.draw()
        self._opacity.show(state.opacity)
        self._minimum.show(state.minimum)
        self._curve.show(next(title for title, name in _CURVES.items() if name == state.curve))
        if page.changes.of("view panel", state.bodies, state.wireframe, state.difference, state.mode, state.apart):
            self._draw_bodies()
        if page.changes.of(
            "keypoint layers",
            *(state.video, state.keypoints, state.bones, state.detections, state.groups, state.color_by),
        ):
            self._draw_keypoints()

    def _draw_playing(self) -> None:
        page, state = self._page, self._page.state
        self._frame.show(state.frame + page.first_frame)
        if not page.changes.of("playing", state.mode, state.playing, state.speed, state.loop, state.frames):
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
        state = self._page.state
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
        state = self._page.state
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
