"""A joint turned in 3D by its rings: where they are, what is stored, and that the fit follows."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
import viser
from scipy.spatial.transform import Rotation

from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX
from tcfit_app.project.edits.kinds import Lock
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tcfit_app.review.scene.space import Quaternion, Rings, TurnPhase
from tests.drivers.lone_page import LonePage

ELBOW, WRIST = INDEX["left_elbow"], INDEX["left_wrist"]
FRAME = 3


@pytest.fixture
def tested(fitted_page: LonePage) -> LonePage:
    """In 3D, with an elbow selected."""
    fitted_page.only(CorrectPanel)
    fitted_page.page.tab.set(mode="space", frame=FRAME, selection=(ELBOW,))
    return fitted_page


def rings(tested: LonePage) -> Rings | None:
    return tested.page.gestures.turning.rings(tested.page.tab.look())


def there(tested: LonePage) -> Rings:
    found = rings(tested)
    assert found is not None
    return found


def quaternion(turn: Rotation) -> Quaternion:
    x, y, z, w = turn.as_quat().tolist()
    return w, x, y, z


def rotation(found: Rings) -> Rotation:
    w, x, y, z = found.wxyz
    return Rotation.from_quat((x, y, z, w))


def elbow(tested: LonePage) -> np.ndarray:
    """Axis-angle in the fit on show."""
    return tested.shown.params.body_pose[FRAME].view(-1, 3)[JOINT["left_elbow"] - JOINT["left_hip"]].numpy()


def test_they_are_at_the_joint_and_turned_with_it(tested: LonePage, tiny_body: BodyModel):
    found, params = there(tested), tested.shown.params[[FRAME]]
    joints = joints_in_space(tiny_body, params)[0]
    np.testing.assert_allclose(found.position, joints[JOINT["left_elbow"]], atol=1e-6)
    # The forearm lies as the elbow's turn takes it from the rest pose.
    resting = replace(params, body_pose=torch.zeros_like(params.body_pose), global_orient=torch.zeros(1, 3))
    rest = joints_in_space(tiny_body, resting)[0]
    at, end = JOINT["left_elbow"], JOINT["left_wrist"]
    np.testing.assert_allclose(rotation(found).apply(rest[end] - rest[at]), joints[end] - joints[at], atol=1e-5)


def test_there_are_none_where_nothing_can_be_turned(tested: LonePage):
    tab = tested.page.tab
    others: list[dict[str, Any]] = [
        {"mode": "edit"},
        {"selection": ()},
        {"selection": (ELBOW, WRIST)},
        {"playing": True},
        {"bodies": False},
    ]
    for state in others:
        usual = {name: getattr(tab.state, name) for name in state}
        tab.set(**state)
        assert rings(tested) is None, state
        tab.set(**usual)
    tab.set(selection=(INDEX["left_ear"],))
    assert rings(tested) is None, "it is no joint that can be locked"


def test_what_is_turned_is_locked_and_the_fit_follows(tested: LonePage):
    tab, turning = tested.page.tab, tested.page.gestures.turning
    before, found = elbow(tested).copy(), there(tested)
    by = Rotation.from_euler("y", 25, degrees=True)
    after = quaternion(rotation(found) * by)
    turning.take("start", found.wxyz)
    turning.take("update", after)
    live = tab.look().live_b
    assert live is not None and list(live.frames) == [FRAME], "it is seen at once"
    turned = (Rotation.from_rotvec(before) * by).as_rotvec()
    place = 3 * (JOINT["left_elbow"] - JOINT["left_hip"])
    np.testing.assert_allclose(live.params.body_pose[0, place : place + 3], turned, atol=1e-5)
    np.testing.assert_allclose(np.abs(np.dot(there(tested).wxyz, after)), 1, atol=1e-6)
    assert not tab.session.project.log, "nothing is stored before it is let go"
    turning.take("end", after)
    edit = tab.session.project.log[-1].action
    assert isinstance(edit, Lock) and edit.frames == (FRAME,) and edit.joints == (ELBOW,)
    np.testing.assert_allclose(edit.turn[0], turned, atol=1e-4)
    turning.settle()
    assert tab.look().live_b is not None, "until the fit has followed"
    tested.idle()
    turning.settle()
    assert tab.look().live_b is None
    off = Rotation.from_rotvec(elbow(tested)).inv() * Rotation.from_rotvec(turned)
    assert np.degrees(off.magnitude()) < 3
    tested.press("action", "undo")
    tested.idle()
    tab.look()
    np.testing.assert_allclose(elbow(tested), before, atol=1e-6)


def test_rings_that_are_only_clicked_change_nothing(tested: LonePage):
    turning, found = tested.page.gestures.turning, there(tested)
    phases: tuple[TurnPhase, ...] = ("start", "update", "end")
    for phase in phases:
        turning.take(phase, found.wxyz)
    assert not tested.page.tab.session.project.log and tested.page.tab.look().live_b is None


def test_selected_frames_are_locked_together_and_others_refused(tested: LonePage):
    tab, turning, found = tested.page.tab, tested.page.gestures.turning, there(tested)
    tab.session.edit_follower.after_edits = False
    after = quaternion(rotation(found) * Rotation.from_euler("x", 20, degrees=True))
    tab.set(frames=range(5, 7))
    with pytest.raises(InputError, match="frame"):
        turning.take("start", found.wxyz)
    turning.take("update", after)
    turning.take("end", after)
    assert not tab.session.project.log
    tab.set(frames=range(2, 5))
    turning.take("start", found.wxyz)
    turning.take("update", after)
    turning.take("end", after)
    edit = tab.session.project.log[-1].action
    assert isinstance(edit, Lock) and edit.frames == (2, 3, 4)
    turning.settle()
    assert tab.look().live_b is None, "the fit does not follow"


def test_the_node_shows_the_rings_and_tells_how_they_are_turned(tested: LonePage):
    node, told = tested.page.tab.scene.rings, []
    found = there(tested)
    node.draw(found)
    handle = node._node
    assert handle is not None and handle.visible
    node.turned = lambda *turned: told.append(turned)
    event = viser.TransformControlsEvent(client=tested.page.tab.client, client_id=0, target=handle, phase="update")
    with pytest.raises(StopIteration):
        node._updated(event).send(None)
    ((phase, wxyz),) = told
    assert phase == "update" and wxyz == pytest.approx(found.wxyz)
    node.draw(replace(found, position=(9.0, 9.0, 9.0)))
    assert handle.position == pytest.approx(found.position), "the pointer holds them"
    node.draw(None)
    assert not handle.visible
