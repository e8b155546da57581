"""Hands given a shape, a part of the Correct panel."""

from functools import partial

from fitting_core.body.handshapes import HANDSHAPES
from fitting_core.errors import InputError
from tcfit_app.review.gestures.actions import ACTIONS, Gestures, refusal
from tcfit_app.review.gestures.shaping import MOST_BLEND, keep_handshape, own_handshapes
from tcfit_app.review.panels.elements.field import Field
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import Board, Html, action, button, heading, paragraph, row

_FIRST = ("flat", "fist", "point")
"""Shapes that are always on show."""
_BLEND = "Frames before and after over which the hand blends into and out of the shape"
_NAME = "Name of a shape of your own: Save keeps the hand of the frame on show under it, for all projects"


class HandShapes:
    """The shapes to give the selected hand, and the user's own. Called repeatedly, it sends only changes."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._action = gestures, partial(action, gestures)
        self._tab, self._shaping = gestures.tab, gestures.shaping
        gui = self._tab.client.gui
        self._first = Board(self._tab)
        self._fold = Fold(self._tab, "shapes")
        with self._fold:
            self._shapes = Board(self._tab)
            slider = gui.add_slider("Blend", 0, MOST_BLEND, 1, self._shaping.blend, hint=_BLEND)
            self._blend = Field(self._tab, slider, partial(setattr, self._shaping, "blend"))
            self._name = gui.add_text("Own shape", "", hint=_NAME)
            self._own = Board(self._tab)

    @property
    def _typed(self) -> str:
        return self._name.value.strip()

    def draw(self, *, on: bool) -> None:
        """Bring it to the tab's state; `on`: a hand is selected that can be given a shape."""
        shaping, act = self._shaping, self._action

        def shape(name: str) -> Html:
            return act(f"shape_{name}", name.capitalize())

        self._first.show(*([heading("Hand shape"), row(*map(shape, _FIRST))] if on else []))
        if not self._fold.draw("More hand shapes", on=on):
            return
        why = ACTIONS["shape_last"].obstacle(self._gestures)
        try:
            own, problem = own_handshapes(), ""
        except InputError as error:
            own, problem = {}, str(error)
        theirs = [button(name, "shapes.own", name, do=partial(shaping.give_own, name), obstacle=why) for name in own]
        copied = shaping.copied
        self._shapes.show(
            row(*(shape(name) for name in HANDSHAPES if name not in _FIRST), wrap=True),
            *([row(*theirs, wrap=True)] if own else []),
            row(act("shape_other", "As the other hand"), act("copy_shape", "Copy shape")),
            *([] if copied is None else [row(act("shape_copied", f"Copied: {copied.name}"))]),
            row(act("shape_last", "Repeat last", disabled=shaping.last is None), act("free_hand", "Remove")),
        )
        self._blend.show(shaping.blend)
        unable = refusal(shaping.side) or ACTIONS["copy_shape"].obstacle(self._gestures)
        save = button("Save shape", "shapes.save", do=lambda: shaping.save(self._typed), obstacle=unable or problem)
        delete = button("Delete shape", "shapes.delete", do=lambda: keep_handshape(self._typed, None), disabled=not own)
        self._own.show(row(save, delete), *([paragraph(problem, "warn")] if problem else []))
