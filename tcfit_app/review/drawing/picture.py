"""Draws one tab's frames: into viser's scene, and as states of the page."""

from collections.abc import Callable

import numpy as np

from fitting_core.keypoints import BODY, GROUPS, NAMES
from fitting_core.results.error_bars import JOINTS
from tcfit_app.fitting.fits import Shown
from tcfit_app.review.browser.page_states import (
    Bodies,
    FitBody,
    Layout,
    SidePlate,
    Triple,
    pixel_pairs,
    points_in_space,
    triple,
)
from tcfit_app.review.browser.page_states import Poster as PosterPlace
from tcfit_app.review.browser.page_states import Space as SpaceState
from tcfit_app.review.drawing.frame import Frame, Frames
from tcfit_app.review.drawing.overlays import draw_overlays, draw_view
from tcfit_app.review.scene.layers import BodyLayer
from tcfit_app.review.scene.poster import Poster, Posters, SidePoster, poster_layout
from tcfit_app.review.scene.room import Room
from tcfit_app.review.scene.side_view import DIRECTION_TEXTS, SideView
from tcfit_app.review.scene.space import Rings, Space
from tcfit_app.review.shared.drawing_data import FrameBody
from tcfit_app.review.tab.on_show import SLOT_COLORS, SLOTS, OnShow
from tcfit_app.review.tab.state import HELD_BY
from tcfit_app.review.tab.tab import Tab

_OTHERWISE_NAMED = {"nose": "head", "left_big_toe": "left_foot", "right_big_toe": "right_foot"}
_JOINTS = [
    JOINTS.index(joint) if (joint := _OTHERWISE_NAMED.get(name, name)) in JOINTS else None for name in NAMES[BODY]
]
"""For each BODY_25 keypoint, the joint whose error bars it uses."""


class Picture:
    """Draws one tab's picture; called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab, rings: Callable[[OnShow], Rings | None]) -> None:
        """For a tab; `rings` returns those that turn a joint in 3D, if any."""
        self._tab = tab
        self._frames = Frames(tab, rings)
        self._frame: Frame | None = None
        """The one drawn last."""

    @property
    def problem(self) -> str:
        """What cannot be shown, and why; empty if all can."""
        return "" if self._frame is None else self._frame.problem

    def draw(self, *, whole: bool = True) -> bool:
        """Send what changed; False if the frame is not decoded yet, and nothing was sent.

        Args:
            whole: Something else than the body that follows a drag may have changed.
        """
        tab, last = self._tab, self._frame
        moved = None if whole or last is None else self._frames.moved(last, tab.shown)
        frame = moved or self._frames.of(tab.shown)
        if frame is None:
            return False
        self._frame = frame
        with tab.client.atomic():
            if moved is not None:
                tab.scene.move(self._snapshot(frame))
            else:
                draw_view(tab, frame)
                self._draw_scene(frame)
                draw_overlays(tab, frame)
            self._send_bodies(frame)
        tab.once("flushed", frame.shown.version, tab.client.flush)  # viser would wait 16 ms for more
        return True

    def _draw_scene(self, frame: Frame) -> None:
        """Show all of a frame, where the page has room for it."""
        tab, snapshot = self._tab, self._snapshot(frame)
        tab.scene.cameras.follow(tab.size if tab.size[0] else None)
        tab.scene.show(snapshot)
        if isinstance(snapshot, Posters):
            beside = () if frame.side is None else ((self._label_beside(frame), None),)
            window = tab.scene.cameras.window
            layout = poster_layout(snapshot, (*frame.labels, *beside), window, clipped=tab.state.clipped)
        else:
            places = tuple(PosterPlace(width=0.0, label=label, color=color) for label, color in frame.labels)
            layout = Layout(mode="space", posters=places)
            x, y, z = (triple(row) for row in snapshot.turn)
            tab.channel.send("space", SpaceState(turn=(x, y, z), place=triple(snapshot.place)))
        tab.channel.send("layout", layout)

    def _label_beside(self, frame: Frame) -> str:
        if frame.beside is None:
            return DIRECTION_TEXTS[self._tab.direction]
        name = frame.beside.view.view.clip.name
        return name if frame.beside.frame is not None else f"{name}: not filmed at this moment"

    def _snapshot(self, frame: Frame) -> Posters | Space:
        """A frame as viser's scene has it."""
        others = tuple(one.layer for one in frame.others)
        if frame.state.mode == "space":
            return self._space(frame, others)
        side, beside = None, frame.beside
        if frame.side is not None:  # empty until the extent over the clip is known
            bodies = tuple(frame.visible[side] for side in sorted(frame.visible))
            shows = frame.room is not None if beside is None else beside.frame is not None
            image = None if beside is None else beside.image
            side = SidePoster(view=frame.side, image=image, bodies=bodies if shows else ())
        posters = tuple(
            Poster(image=frame.image, bodies=made, others=others) if place else Poster(image=frame.image, plain=True)
            for place, made in zip(frame.shown.places, frame.places, strict=True)
        )
        return Posters(camera=frame.shown.camera, posters=posters, side=side, arrangement=frame.arrangement)

    def _space(self, frame: Frame, others: tuple[BodyLayer, ...]) -> Space:
        shown, room, data = frame.shown, frame.room, self._tab.data
        (bodies,) = frame.places
        fits = [shown.fit(side) for side in shown.places[0] if side in frame.visible]
        rooms = [fit and data.room(fit, shown.held or fit) for fit in fits]
        return Space(
            camera=shown.camera,
            bodies=bodies,
            others=others,
            extents=tuple(None if own is None else own.extent for own in rooms),
            image=frame.image,
            turn=np.eye(3) if room is None else room.turn,
            place=np.zeros(3) if room is None else room.place,
            ground=None if room is None else room.floor,
            ghost=frame.state.ghost and len(bodies) == len(SLOTS),
            dark=frame.state.dark,
            rings=frame.rings if "b" in frame.visible else None,
        )

    # --- bodies as states of the page ---

    def _send_bodies(self, frame: Frame) -> None:
        """Send the keypoints of the bodies in space, and how the side view maps them; not until the floor is known."""
        tab, room, view = self._tab, frame.room, frame.side
        if room is not None:
            tab.channel.send("bodies", tab.once("bodies", frame.key, lambda: self._bodies(frame, room)))
        if isinstance(view, SideView):
            tab.channel.send("side", tab.once("side", frame.key, lambda: self._side(frame, view)))

    def _bodies(self, frame: Frame, room: Room) -> Bodies | None:
        made = []
        for side, body in frame.fitted.items():
            made.append(
                FitBody(
                    color=SLOT_COLORS[side],
                    points=points_in_space(self._tab.data.body_points(body)),
                    pelvis=round(self._tab.data.pelvis_depth(body), 4),
                    error_bars=() if body.live is not None else error_bars_of(body.shown, body.frame),
                    unseen=frame.unseen,
                    camera=(*body.shown.camera.focal, *body.shown.camera.center),
                    followed=self._followed(body),
                )
            )
        down = triple(np.round(room.turn[1], 5))
        floor = round(room.floor - float(room.place[1]), 4)
        return Bodies(bodies=tuple(made), down=down, floor=floor) if made else None

    def _followed(self, body: FrameBody) -> Triple | None:
        """The middle of the part that the close-up follows; of its wrist or nose if the body has no points of it."""
        if (part := self._tab.state.close_up) is None:
            return None
        points = self._tab.data.keypoints(body)
        known = [group for group in (points[GROUPS[part]], points[[HELD_BY[part]]]) if np.isfinite(group).any()]
        return points_in_space(np.nanmean(known[0], 0)[None])[0] if known else None

    def _side(self, frame: Frame, view: SideView) -> SidePlate | None:
        """How the plate maps the bodies."""
        fitted = list(frame.fitted.values())
        if frame.room is None or not fitted:
            return None
        height, camera = frame.shown.camera.size[1], fitted[-1].shown.camera
        shifts = view.shifts([frame.bodies[side].vertices for side in frame.fitted])
        origins = pixel_pairs(np.stack([view.pixels(np.zeros(3), shift, height) for shift in shifts]))
        metre, plate, sight = view.scale * height, view.plate(height), view.sight(camera, height)
        return SidePlate(
            plate=(triple(plate[0]), triple(plate[1])),
            shifts=origins,
            metre=metre,
            zero=origins[-1][0],
            floor=None if view.floor is None else float((view.floor - view.middle[1]) * metre + height / 2),
            sight=(triple(sight[0]), triple(sight[1])),
        )


def error_bars_of(fit: Shown, frame: int) -> tuple[tuple[float, float] | None, ...]:
    """For BODY_25 keypoints; empty if unknown."""
    known = None if fit.result is None else fit.result.error_bars
    if known is None or not np.isfinite(known.joints[frame]).all():
        return ()
    bars = [(round(float(along), 4), round(float(across), 4)) for along, across in known.joints[frame]]
    return tuple(None if joint is None else bars[joint] for joint in _JOINTS)
