"""The side view of one tab: the picture's bodies, and the page's overlay."""

import numpy as np

from fitting_core.camera import Camera
from tcfit_app.review.browser.page_states import SidePlate as SideState
from tcfit_app.review.browser.page_states import pixel_pairs, triple
from tcfit_app.review.drawing.joints import drawn
from tcfit_app.review.scene.layers import BodyLayer
from tcfit_app.review.scene.poster import SidePoster
from tcfit_app.review.scene.room import Room
from tcfit_app.review.scene.side_view import SideView, side_view
from tcfit_app.review.tab.on_show import OnShow, Slot
from tcfit_app.review.tab.tab import Tab

_UNKNOWN = Room(turn=np.eye(3), floor=1.0, boxes=np.array([[(-1.0, -1.0, 2.0), (1.0, 1.0, 4.0)]]))
"""While it is empty."""


class SidePart:
    """Draws one tab's side view; called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab

    def wanted(self, shown: OnShow) -> bool:
        """Whether there is a side view: it is switched on, and there is a fit to show."""
        state = self._tab.state
        return state.side and state.mode != "space" and shown.held is not None

    def poster(
        self, shown: OnShow, bodies: dict[Slot, BodyLayer], others: tuple[BodyLayer, ...], room: Room | None
    ) -> SidePoster:
        """The plate with the pictures' bodies; empty until their extent over the clip is known."""
        assert shown.held is not None
        there = () if room is None else tuple(bodies[side] for side in drawn(bodies))
        view = self._view(room or _UNKNOWN, shown.held.camera, shown.frame)
        return SidePoster(view=view, bodies=there, others=others if there else ())

    def tell(self, shown: OnShow, view: SideView, bodies: dict[Slot, BodyLayer]) -> None:
        """Send how the plate maps these bodies."""
        there: list[Slot] = [side for side in drawn(bodies) if shown.with_body(side) is not None]
        fit = shown.with_body(there[-1]) if there else None
        layers = [bodies[side] for side in there]
        key = shown.frame, shown.revision, view, tuple(there)
        state = self._tab.once("side", key, lambda: fit and self._state(view, fit.camera, layers))
        self._tab.channel.send("side", state)

    def _state(self, view: SideView, camera: Camera, bodies: list[BodyLayer]) -> SideState:
        height = self._tab.session.project.footage.camera.size[1]
        shifts = view.shifts([body.vertices for body in bodies])
        origins = pixel_pairs(np.stack([view.pixels(np.zeros(3), shift, height) for shift in shifts]))
        metre, plate, sight = view.scale * height, view.plate(height), view.sight(camera, height)
        return SideState(
            plate=(triple(plate[0]), triple(plate[1])),
            shifts=origins,
            metre=metre,
            zero=origins[-1][0],
            floor=None if view.floor is None else float((view.floor - view.middle[1]) * metre + height / 2),
            sight=(triple(sight[0]), triple(sight[1])),
        )

    def _view(self, room: Room, camera: Camera, frame: int) -> SideView:
        tab, direction, width = self._tab, self._tab.state.side_from, self._tab.side_width
        key = room, camera, direction, width
        seen = tab.once("side view", key, lambda: side_view(room, camera, direction, width))
        return tab.once("side view of the frame", (seen, frame), lambda: seen.before(camera, frame))
