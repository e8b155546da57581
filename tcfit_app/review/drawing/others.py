"""The clip's other people in one tab: their newest fits, dimmed, and their names, which lead to them."""

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.review.browser.page_states import OtherPeople, OtherPerson, pixel_pairs
from tcfit_app.review.scene.layers import MOST_OTHERS, NEAREST, OTHER_COLOR, OTHER_OPACITY, BodyLayer
from tcfit_app.review.tab.on_show import OnShow, live_window
from tcfit_app.review.tab.people import Someone
from tcfit_app.review.tab.tab import Tab


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """A person's body in a frame."""

    someone: Someone
    fit: Shown
    layer: BodyLayer


class OthersPart:
    """Draws them; called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._known: dict[int, tuple[Hashable, _Seen]] = {}
        """By number."""
        self._drawn: list[_Seen] = []

    def layers(self) -> tuple[BodyLayer, ...]:
        """Their bodies in the frame on show; also sends the page their positions."""
        tab = self._tab
        if not tab.someone.others:
            return ()
        seen: list[_Seen] = []
        if tab.state.others and tab.state.bodies and not tab.data.warming:
            found = (self._seen(someone) for someone in tab.someone.others[:MOST_OTHERS])
            seen = [one for one in found if one is not None and one.layer.problem is None]
        self._drawn = seen
        self._tell(seen)
        return tuple(one.layer for one in seen)

    def extents(self, shown: OnShow) -> tuple[Float[np.ndarray, "2 3"], ...]:
        """Extents over the clip of those drawn, in the space of the fit on show, as far as known."""
        if shown.held is None:
            return ()
        rooms = [one.someone.data.room(one.fit, shown.held, self._tab.data) for one in self._drawn]
        return tuple(room.extent for room in rooms if room is not None)

    def _seen(self, someone: Someone) -> _Seen | None:
        """A person's newest fit; None without one, or without its body model."""
        tab, state = self._tab, self._tab.state
        frame = someone.frame_of(state.frame + tab.first_frame)
        try:
            fit = None if frame is None else someone.session.stored.show(FitChoice())
            if frame is None or fit is None or not fit.has(frame):
                return None
            drawn = someone.data.body(fit, frame, live_window(someone.session, fit, frame))
            faces = someone.data.meshes(fit).faces
        except InputError:  # reported when their page is opened
            return None
        key = drawn.version, fit.camera, state.opacity, state.outline
        known = self._known.get(someone.number)
        if known is None or known[0] != key:
            layer = BodyLayer(
                vertices=drawn.vertices,
                faces=faces,
                color=OTHER_COLOR,
                camera=fit.camera,
                opacity=min(state.opacity, OTHER_OPACITY),
                outline=state.outline,
            )
            known = self._known[someone.number] = key, _Seen(someone=someone, fit=fit, layer=layer)
        return known[1]

    def _tell(self, seen: list[_Seen]) -> None:
        """Send where the names are: above the heads, in the 2D modes."""
        tab, flat = self._tab, self._tab.state.mode != "space"
        people = tab.once("other people", (tuple(seen), flat), lambda: tuple(_named(one, flat=flat) for one in seen))
        tab.channel.send("other_people", OtherPeople(people=people))


def _named(one: _Seen, *, flat: bool) -> OtherPerson:
    someone = one.someone
    at = _above(one.layer) if flat else None
    return OtherPerson(number=someone.number, name=someone.name, hint=f"Show and correct {someone.name}", at=at)


def _above(layer: BodyLayer) -> tuple[float, float] | None:
    camera = layer.camera
    assert camera is not None
    vertices = layer.vertices[layer.vertices[:, 2] > NEAREST]
    if not len(vertices):
        return None
    pixels = vertices[:, :2] / vertices[:, 2:] * np.array(camera.focal) + np.array(camera.center)
    return pixel_pairs(pixels[[pixels[:, 1].argmin()]])[0]
