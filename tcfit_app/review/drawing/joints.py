"""The fits' keypoints in space, drawn by the page in the side view and in 3D."""

import numpy as np

from fitting_core.keypoints import BODY, GROUPS, NAMES
from fitting_core.results.error_bars import JOINTS
from tcfit_app.analysis.seen import unseen_keypoints
from tcfit_app.fitting.fits import Shown
from tcfit_app.review.browser.page_states import Bodies, FitBody, Triple, points_in_space
from tcfit_app.review.scene.layers import BodyLayer, css
from tcfit_app.review.scene.room import Room
from tcfit_app.review.tab.on_show import OnShow, Slot
from tcfit_app.review.tab.state import HELD_BY
from tcfit_app.review.tab.tab import Tab

_OTHERWISE_NAMED = {"nose": "head", "left_big_toe": "left_foot", "right_big_toe": "right_foot"}
_JOINTS = [
    JOINTS.index(joint) if (joint := _OTHERWISE_NAMED.get(name, name)) in JOINTS else None for name in NAMES[BODY]
]
"""For each BODY_25 keypoint, the joint whose error bars it uses."""


class JointsPart:
    """Sends the keypoints of one tab's fits; called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._data = tab, tab.data

    def tell(self, shown: OnShow, bodies: dict[Slot, BodyLayer], room: Room | None) -> None:
        """Send the keypoints of these bodies, even if hidden; not until the floor is known."""
        if room is None:
            return
        there: dict[Slot, Shown] = {side: fit for side in drawn(bodies) if (fit := shown.with_body(side)) is not None}
        versions = tuple((side, fit.version) for side, fit in there.items())
        edits = self._tab.session.project.keypoints_version
        state = self._tab.state
        key = shown.frame, shown.revision, room, versions, edits, state.close_up
        told = self._tab.once("bodies", key, lambda: self._state(shown, there, bodies, room) if there else None)
        self._tab.channel.send("bodies", told)

    def _state(self, shown: OnShow, there: dict[Slot, Shown], bodies: dict[Slot, BodyLayer], room: Room) -> Bodies:
        made, present = [], self._data.present(shown.frame)
        for side, fit in there.items():
            points = self._data.body_points(fit, shown.frame, shown.live_of(side))
            assert len(points) == BODY.stop
            bars = () if shown.live_of(side) is not None else error_bars_of(fit, shown.frame)
            made.append(
                FitBody(
                    color=css(bodies[side].color),
                    points=points_in_space(points),
                    pelvis=round(self._data.pelvis_depth(fit, shown.frame, shown.live_of(side)), 4),
                    error_bars=bars,
                    unseen=() if present is None else unseen_keypoints(present),
                    camera=(*fit.camera.focal, *fit.camera.center),
                    followed=self._followed(shown, side, fit),
                )
            )
        down = (float(value) for value in np.round(room.turn[1], 5))
        return Bodies(
            bodies=tuple(made),
            down=(next(down), next(down), next(down)),
            floor=round(room.floor - float(room.place[1]), 4),
        )

    def _followed(self, shown: OnShow, side: Slot, fit: Shown) -> Triple | None:
        """The middle of the part that the close-up follows; of its wrist or nose if the body has no points of it."""
        part = self._tab.state.close_up
        if part is None:
            return None
        points = self._data.keypoints(fit, shown.frame, shown.live_of(side))
        known = [group for group in (points[GROUPS[part]], points[[HELD_BY[part]]]) if np.isfinite(group).any()]
        return points_in_space(np.nanmean(known[0], 0)[None])[0] if known else None


def error_bars_of(fit: Shown, frame: int) -> tuple[tuple[float, float] | None, ...]:
    """For BODY_25 keypoints; empty if unknown."""
    known = None if fit.result is None else fit.result.error_bars
    if known is None or not np.isfinite(known.joints[frame]).all():
        return ()
    bars = [(round(float(along), 4), round(float(across), 4)) for along, across in known.joints[frame]]
    return tuple(None if joint is None else bars[joint] for joint in _JOINTS)


def drawn(bodies: dict[Slot, BodyLayer]) -> list[Slot]:
    """Sides with a body that can be drawn, the one being corrected last."""
    return sorted(side for side, body in bodies.items() if body.problem is None)
