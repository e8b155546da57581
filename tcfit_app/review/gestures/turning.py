"""Turning a joint in 3D by the rings around it, in one tab: it is locked as it was turned."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.body.points.positions import joints_in_space
from fitting_core.keypoints import LOCKABLE
from tcfit_app.fitting.fits import Shown
from tcfit_app.project.edits.space_edits import Lock
from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.scene.space import Quaternion, Rings, TurnPhase
from tcfit_app.review.tab.on_show import OnShow
from tcfit_app.review.tab.tab import Tab

_STILL = 1e-3
"""Radians: rings that were turned by less were only clicked."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Joint:
    """The joint with rings."""

    joint: int
    """The keypoint that stands for it (see LOCKABLE)."""
    fit: Shown
    body: BodyModel
    params: BodyParams
    """Of the frame on show, as drawn."""


@dataclass(kw_only=True, eq=False)
class _Held:
    """A joint whose rings the user holds."""

    held: _Joint
    frame: int
    frames: tuple[int, ...]
    """In which it will be locked."""
    parent: Rotation
    """How its parent is turned in camera space."""
    before: Rotation
    """How it was turned against its parent."""
    turn: Rotation
    """How it is now."""


class Turning:
    """The rings of one tab. There are some in 3D while one joint is selected that can be locked."""

    def __init__(self, tab: Tab, correcting: Correcting) -> None:
        self._tab, self._correcting = tab, correcting
        self._held: _Held | None = None
        self._previews = False
        """The body is drawn as it was turned, in place of the fit."""

    def rings(self, on_show: OnShow) -> Rings | None:
        """Their positions, if any."""
        found = self._joint(on_show)
        if found is None:
            return None
        body, params, joint = found.body, found.params, JOINT[LOCKABLE[found.joint]]
        x, y, z = joints_in_space(body, params)[0, joint].tolist()
        i, j, k, w = _turned(body, params, joint).as_quat().tolist()
        return Rings(position=(x, y, z), wxyz=(w, i, j, k))

    def _joint(self, on_show: OnShow) -> _Joint | None:
        tab, there = self._tab, on_show.body("b")
        chosen, project = tab.state.selection, tab.session.project
        wanted = tab.state.mode == "space" and tab.state.bodies and not tab.state.playing and len(chosen) == 1
        if not wanted or chosen[0] not in LOCKABLE or there is None or project.read_only or not project.has_detections:
            return None
        # In 3D keypoints are those of the fit: no sides are exchanged, as they are where detections are selected.
        fit = there.shown
        return _Joint(joint=chosen[0], fit=fit, body=tab.session.bodies.of(fit.run.body), params=there.params)

    def take(self, phase: TurnPhase, wxyz: Quaternion) -> None:
        """The user takes hold of the rings, turns them, or lets go. Raises InputError if the joint cannot be locked."""
        if phase == "start":
            self._begin()
        held = self._held
        if held is None:
            return
        w, x, y, z = wxyz
        if phase != "start":
            held.turn = held.parent.inv() * Rotation.from_quat((x, y, z, w))
        moved = (held.before.inv() * held.turn).magnitude() > _STILL
        if phase == "update" and moved:
            self._preview(held)
        elif phase == "end":
            self._held = None
            if moved:
                a, b, c = np.round(held.turn.as_rotvec(), 5).tolist()
                self._correcting.make(Lock(frames=held.frames, joints=(held.held.joint,), turn=((a, b, c),)))

    def _begin(self) -> None:
        tab, self._held = self._tab, None
        self._correcting.refuse_while_dragging()
        on_show = tab.look()
        found = self._joint(on_show)
        if found is None:
            return
        tab.pause()
        joint = JOINT[LOCKABLE[found.joint]]
        parent = _turned(found.body, found.params, int(found.body.parents[joint]))
        turn = parent.inv() * _turned(found.body, found.params, joint)
        self._held = _Held(
            held=found,
            frame=on_show.frame,
            frames=tab.frames_to_change,
            parent=parent,
            before=turn,
            turn=turn,
        )

    def _preview(self, held: _Held) -> None:
        joint, pose = held.held, held.held.params.body_pose.clone()
        place = 3 * (JOINT[LOCKABLE[joint.joint]] - JOINT["left_hip"])
        pose[0, place : place + 3] = pose.new_tensor(held.turn.as_rotvec())
        params = replace(joint.params, body_pose=pose)
        self._tab.session.edit_follower.preview(self._number, joint.fit.run, held.frame, params)
        self._previews = True

    @property
    def _number(self) -> int:
        return self._tab.client.client_id

    def settle(self) -> None:
        """Show the fit again once it has followed what was turned."""
        session = self._tab.session
        if self._previews and self._held is None and not session.edit_follower.busy and not session.jobs:
            self.abandon()

    def abandon(self) -> None:
        """Show the fit again; rings that are held do nothing any more."""
        self._held = None
        if self._previews:
            self._tab.session.edit_follower.end_preview(self._number)
        self._previews = False


def _turned(body: BodyModel, params: BodyParams, joint: int) -> Rotation:
    """How a joint of one frame is turned in camera space."""
    pose, turned = full_pose(body, params)[0].double().numpy(), Rotation.identity()
    while joint >= 0:
        turned = Rotation.from_rotvec(pose[joint]) * turned
        joint = int(body.parents[joint])
    return turned
