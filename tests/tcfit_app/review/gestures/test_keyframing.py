"""Keyframes and drags as a user makes them: what is stored, which frames follow, and what goes along."""

from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest

from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX, LEFT_HAND
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project import project as project_module
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.kinds import MarkBad, MoveKey, MoveKeypoint, Nudge, PlaceKey, RemoveKey, SetDepth
from tcfit_app.review.browser.page_events import Drag, DragDepth
from tcfit_app.review.gestures.actions import ACTIONS
from tcfit_app.review.gestures.edit_words import describe
from tcfit_app.review.gestures.keyframing import filled, with_hands
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tcfit_app.review.shared.drawing_data import FrameBody
from tests.drivers.lone_page import LonePage

WRIST, ELBOW = INDEX["left_wrist"], INDEX["left_elbow"]


@pytest.fixture
def tested(fitted_page: LonePage) -> LonePage:
    fitted_page.only(CorrectPanel)
    return fitted_page


def corrected(tested: LonePage) -> Corrected:
    return tested.page.tab.session.project.corrected


def drag(tested: LonePage, frame: int, dx: float, *joints: int) -> None:
    tested.page.tab.seek(frame)
    for phase, by in (("start", 0.0), ("end", dx)):
        tested.page.receive(Drag(phase, joints, by, 0.0, frame))  # pyright: ignore[reportArgumentType]


def test_two_drags_take_the_frames_between_along_and_the_fit_follows_all(tested: LonePage):
    tab, session = tested.page.tab, tested.page.tab.session
    detected = session.project.detections.xy[:, WRIST]
    shown = tested.shown
    before = shown.params.body_pose.clone()
    drag(tested, 1, 20.0, WRIST)
    assert tested.last_edit == PlaceKey(
        frames=(1,), joints=(WRIST,), at=1, xy=((float(detected[1, 0] + 20), float(detected[1, 1])),)
    )
    drag(tested, 6, 40.0, WRIST)
    edit = tested.last_edit
    assert isinstance(edit, PlaceKey) and (edit.frames, edit.at) == ((2, 3, 4, 5, 6), 6)
    assert tab.message[0] == "Saved: left wrist moved, frame 6; frames 2–5 follow"
    np.testing.assert_allclose(corrected(tested).xy[:7, WRIST, 0] - detected[:7, 0], [0, 20, 24, 28, 32, 36, 40])
    tested.idle()
    after = session.fits.fit(session.edit_follower.of(shown.run.id)).last.params.body_pose
    moved = (after - before).abs().amax(1)
    assert all(moved[frame] > 1e-3 for frame in range(1, 7)), "also those between, which no drag was in"
    tested.press("action", "undo")
    np.testing.assert_allclose(corrected(tested).xy[:7, WRIST, 0] - detected[:7, 0], [0, 20, 0, 0, 0, 0, 0])
    tested.idle()


def test_keys_are_deleted_and_moved(tested: LonePage):
    tab, session = tested.page.tab, tested.page.tab.session
    session.edit_follower.after_edits = False
    detected = session.project.detections.xy[:, WRIST, 0]
    for frame in (1, 5):
        drag(tested, frame, 20.0, WRIST)
    tab.set(selection=(WRIST, ELBOW))
    delete = ACTIONS["delete_key"]
    assert not delete.obstacle(tested.page.gestures)
    tested.page.gestures.correcting.move_key(5, 3)
    assert tested.last_edit == MoveKey(frames=(2, 3, 4, 5), joints=(WRIST,), at=5, to=3)
    assert tab.message[0] == "Saved: left wrist keyframe moved to frame 3, frame 5; frames 2–4 follow"
    np.testing.assert_allclose((corrected(tested).xy[:, WRIST, 0] - detected)[:6], [0, 20, 20, 20, 0, 0])
    with pytest.raises(InputError, match="There is already a keyframe"):
        tested.page.gestures.correcting.move_key(3, 1)
    tab.seek(3)
    tested.press("action", "delete_key")
    assert tested.last_edit == RemoveKey(frames=(2, 3), joints=(WRIST,), at=3)
    np.testing.assert_allclose((corrected(tested).xy[:, WRIST, 0] - detected)[:6], [0, 20, 0, 0, 0, 0])
    with pytest.raises(InputError, match="has a keyframe in this frame"):
        tested.press("action", "delete_key")
    assert delete.obstacle(tested.page.gestures)


def test_without_keyframes_a_drag_is_for_its_frame(tested: LonePage):
    tested.page.tab.session.edit_follower.after_edits = False
    drag(tested, 1, 20.0, WRIST)
    tested.press("action", "keyframes")
    drag(tested, 5, 20.0, WRIST)
    edit = tested.last_edit
    assert isinstance(edit, MoveKeypoint) and edit.frames == (5,)
    assert corrected(tested).edited[:, WRIST].nonzero()[0].tolist() == [1, 5]
    # I fills what lies between, also from the frame that was corrected last.
    tested.page.tab.set(selection=(WRIST,))
    tested.press("action", "interpolate")
    assert corrected(tested).edited[:, WRIST].nonzero()[0].tolist() == [1, 2, 3, 4, 5]


def test_a_nudged_wrist_takes_its_hand_along(tested: LonePage):
    tab = tested.page.tab
    tab.session.edit_follower.after_edits = False
    points = tuple(range(LEFT_HAND.start, LEFT_HAND.stop))
    places = tuple((100.0 + joint, 200.0) for joint in points)
    tab.session.project.append(MoveKeypoint(frames=(2,), joints=points, xy=(places,)))
    tab.session.project.append(MarkBad(frames=(2,), joints=(LEFT_HAND.start + 3,)))
    tab.seek(2)
    tab.set(selection=(WRIST,))
    tested.press("action", "nudge_left")
    edit = tested.last_edit
    hand = tuple(j for j in range(LEFT_HAND.start, LEFT_HAND.stop) if j != LEFT_HAND.start + 3)
    assert isinstance(edit, PlaceKey) and edit.joints == (WRIST, *hand)
    assert tab.message[0] == "Saved: left wrist and its hand moved, frame 2"
    tab.set(hand_along=False, keyframes=False)
    tested.press("action", "nudge_left")
    assert tested.last_edit == Nudge(frames=(2,), joints=(WRIST,), by=(-1.0, 0.0))
    root = LEFT_HAND.start
    assert set(with_hands((root,), corrected(tested), 2)) == {WRIST, *hand}
    assert with_hands((ELBOW, root + 1), corrected(tested), 2) == (ELBOW, root + 1)


@pytest.mark.parametrize("keyframes", [True, False])
def test_a_series_of_nudges_is_undone_and_redone_as_one(
    tested: LonePage, keyframes: bool, monkeypatch: pytest.MonkeyPatch
):
    tab, now = tested.page.tab, [datetime.now(UTC)]
    monkeypatch.setattr(project_module, "datetime", SimpleNamespace(now=lambda zone: now[0]))
    tab.session.edit_follower.after_edits = False
    tab.seek(2)
    tab.set(selection=(WRIST,), keyframes=keyframes, hand_along=False)

    def press(action: str, *, after: float = 0.3) -> None:
        now[0] += timedelta(seconds=after)
        tested.press("action", action)

    def moved() -> tuple[float, ...]:
        return tuple((corrected(tested).xy[2, WRIST] - start).round(2).tolist())

    start = corrected(tested).xy[2, WRIST].copy()
    for action in ("nudge_left", "nudge_left", "nudge10_down"):
        press(action)
    press("nudge_right", after=1.5)
    press("nudge_right")
    drag(tested, 2, 5.5, WRIST)
    states = [moved()]
    for _ in range(3):
        press("undo")
        states.append(moved())
    assert states == [(5.5, 10.0), (0.0, 10.0), (-2.0, 10.0), (0.0, 0.0)]
    for state in reversed(states[:-1]):
        press("redo")
        assert moved() == state
    tab.set(selection=(ELBOW,))
    press("nudge_up")
    tab.set(selection=(WRIST,))
    press("nudge_up")
    press("undo")
    left = tab.session.project.undoable
    assert moved() == states[0] and left is not None
    assert isinstance(left.action, PlaceKey | Nudge) and left.action.joints == (ELBOW,), "another keypoint"


def in_depth(tested: LonePage, phase: str, metres: float, frame: int, joint: int = WRIST) -> None:
    tested.page.receive(DragDepth(phase, joint, metres, frame))  # pyright: ignore[reportArgumentType]


def test_a_keypoint_is_dragged_in_depth_and_the_body_follows(tested: LonePage):
    tab, session = tested.page.tab, tested.page.tab.session

    def depth(frame: int) -> float:
        points = tab.data.body_points(FrameBody(shown=tested.shown, frame=frame))
        return float(points[WRIST, 2] - points[INDEX["mid_hip"], 2])

    before, xy = depth(3), corrected(tested).xy.copy()
    in_depth(tested, "start", 0.0, 3)
    in_depth(tested, "move", -0.05, 3)
    tested.until(lambda: session.edit_follower.live is not None)
    in_depth(tested, "end", -0.08, 3)
    edit = tested.last_edit
    assert isinstance(edit, SetDepth) and (edit.frames, edit.joints) == ((3,), (WRIST,))
    assert np.array_equal(corrected(tested).xy, xy), "nothing moves in the picture"
    tested.idle()
    assert depth(3) - before == pytest.approx(-0.08, abs=0.03)
    in_depth(tested, "start", 0.0, 6)
    in_depth(tested, "end", 0.0, 6)
    between = tested.last_edit
    assert isinstance(between, SetDepth) and between.frames == (4, 5, 6)
    told = corrected(tested).depth[3:7, WRIST]
    np.testing.assert_allclose(told, np.linspace(told[0], told[-1], 4), atol=1e-4)
    tested.idle()


def test_drags_in_depth_that_come_to_nothing(tested: LonePage):
    project = tested.page.tab.session.project
    in_depth(tested, "start", 0.0, 3)
    in_depth(tested, "cancel", 0.0, 3)
    in_depth(tested, "end", 0.5, 3)
    in_depth(tested, "start", 0.0, 10_000)
    assert not project.log
    in_depth(tested, "start", 0.0, 3)
    tested.page.receive(Drag("end", (WRIST,), 5.0, 5.0, 3))
    assert not project.log, "the end of another drag"
    in_depth(tested, "end", 10.0, 3)
    assert corrected(tested).depth[3, WRIST] == 3.0, "the most that an edit takes"
    project.append(MarkBad(frames=(3,), joints=(WRIST,)))
    with pytest.raises(InputError, match="marked bad"):
        in_depth(tested, "start", 0.0, 3)


def test_depths_between_told_ones():
    told = np.full((80, 1), np.nan)
    told[[10, 70]] = 0.3
    frames, depths = filled(told, (13,), np.array([[0.0]]))
    assert frames == (11, 12, 13)
    np.testing.assert_allclose(depths[:, 0], [0.2, 0.1, 0.0])
    frames, depths = filled(told, (41, 68), np.array([[0.0], [0.1]]))
    assert frames == (41, 68, 69)
    np.testing.assert_allclose(depths[:, 0], [0.0, 0.1, 0.2])


def test_it_is_said_why_a_fit_does_not_follow(tested: LonePage):
    tab = tested.page.tab
    tab.set(b=FitChoice(phase=2))
    drag(tested, 1, 20.0, WRIST)
    told = tab.message[0]
    assert "left wrist moved, frame 1. The fit does not follow: only the final pass" in told and "one shape" in told
    assert not tab.session.edit_follower.busy


def test_keyframes_in_words():
    assert describe(RemoveKey(frames=(1, 2, 3), joints=(WRIST,), at=2), 1) == (
        "left wrist keyframe deleted, frame 3; frames 2, 4 follow"
    )
