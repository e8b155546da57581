"""Keyframes: what lies between two of them follows both, and goes back when they go."""

from typing import Any

import numpy as np
import pytest

from fitting_core.keypoints import COUNT, Keypoints
from tcfit_app.project.edits.edit_log import EditHistory, LogEntry, Undo
from tcfit_app.project.edits.keyframes import joined
from tcfit_app.project.edits.kinds import Edit, MarkBad, MoveKey, MoveKeypoint, Nudge, PlaceKey, RemoveKey, Reset

LENGTH = 60
ONE, OTHER = 4, 7
NOW: Any = None
"""No test here looks at times."""


@pytest.fixture
def history() -> EditHistory:
    """Of a keypoint that runs along x by 10 px a frame and waves in y."""
    frames = np.arange(LENGTH, dtype=float)
    xy = np.zeros((LENGTH, COUNT, 2))
    xy[:] = np.stack([100 + 10 * frames, 200 + 20 * np.sin(frames)], 1)[:, None]
    return EditHistory(Keypoints(xy=xy, confidence=np.full((LENGTH, COUNT), 0.5)))


def do(history: EditHistory, action: Edit | Undo) -> None:
    history.check(action)
    last = history.undoable
    history.add(LogEntry(id=1 if last is None else last.id + 1, time=NOW, author="", action=action))


def place(history: EditHistory, frame: int, *joints: int, by: tuple[float, float]) -> None:
    """A keyframe where the detection is, and so much beside it."""
    now = history.corrected
    xy = tuple((float(x + by[0]), float(y + by[1])) for x, y in (now.xy - now.shift)[frame, list(joints)])
    frames = tuple(joined(now, joints, range(frame, frame + 1)))
    do(history, PlaceKey(frames=frames, joints=joints, at=frame, xy=xy))


def shifts(history: EditHistory, joint: int = ONE) -> np.ndarray:
    """How far every frame is from its detection, along x."""
    return history.corrected.xy[:, joint, 0] - (100 + 10 * np.arange(LENGTH))


def test_what_lies_between_is_shifted_in_proportion_and_keeps_its_motion(history: EditHistory):
    detected = history.corrected.xy.copy()
    place(history, 10, ONE, by=(30.0, 0.0))
    np.testing.assert_allclose(shifts(history)[[9, 10, 11]], [0, 30, 0])
    place(history, 20, ONE, by=(50.0, 8.0))
    np.testing.assert_allclose(shifts(history)[9:22], [0, *np.linspace(30, 50, 11), 0], atol=1e-9)
    moved = history.corrected.xy[10:21, ONE, 1] - detected[10:21, ONE, 1]
    np.testing.assert_allclose(moved, np.linspace(0, 8, 11), atol=1e-9)
    assert history.corrected.key[:, ONE].nonzero()[0].tolist() == [10, 20]
    assert history.corrected.edited[:, ONE].nonzero()[0].tolist() == list(range(10, 21))
    np.testing.assert_array_equal(history.corrected.confidence[[9, 10, 15, 20], ONE], [0.5, 1, 0.5, 1])
    np.testing.assert_array_equal(np.delete(history.corrected.xy, ONE, 1), np.delete(detected, ONE, 1))


def test_a_third_keyframe_in_between_bends_the_way(history: EditHistory):
    for frame, by in ((10, 30.0), (20, 50.0), (14, 0.0)):
        place(history, frame, ONE, by=(by, 0.0))
    np.testing.assert_allclose(shifts(history)[[10, 12, 14, 17, 20]], [30, 15, 0, 25, 50], atol=1e-9)


def test_what_was_not_detected_or_is_bad_goes_on_the_line(history: EditHistory):
    keypoints = history.keypoints
    xy, confidence = keypoints.xy.copy(), keypoints.confidence.copy()
    xy[12:15, ONE], confidence[12:15, ONE] = 0, 0
    history = EditHistory(Keypoints(xy=xy, confidence=confidence))
    do(history, MarkBad(frames=(17,), joints=(ONE,)))
    place(history, 10, ONE, by=(30.0, 0.0))
    place(history, 20, ONE, by=(50.0, 0.0))
    np.testing.assert_allclose(shifts(history)[10:21], np.linspace(30, 50, 11), atol=1e-9)
    assert history.corrected.confidence[13, ONE] == 1 and not history.corrected.bad[:, ONE].any()
    place(history, 15, ONE, by=(0.0, 0.0))
    np.testing.assert_allclose(shifts(history)[[11, 13, 15, 17]], [24, 12, 0, 20], atol=1e-9)
    do(history, RemoveKey(frames=tuple(range(10, 20)), joints=(ONE,), at=10))
    assert history.corrected.confidence[13, ONE] == 0 and not history.corrected.xy[13, ONE].any()


def test_without_any_detection_it_is_a_straight_line():
    history = EditHistory(Keypoints(xy=np.zeros((9, COUNT, 2)), confidence=np.zeros((9, COUNT))))
    for frame, xy in ((2, (10.0, 0.0)), (6, (50.0, 8.0))):
        frames = tuple(joined(history.corrected, (ONE,), range(frame, frame + 1)))
        do(history, PlaceKey(frames=frames, joints=(ONE,), at=frame, xy=(xy,)))
    np.testing.assert_allclose(history.corrected.xy[2:7, ONE], np.linspace((10, 0), (50, 8), 5))
    assert history.corrected.present[:, ONE].nonzero()[0].tolist() == [2, 3, 4, 5, 6]


def test_keyframes_that_go_take_what_followed_along(history: EditHistory):
    before = history.keypoints
    for frame, by in ((10, 30.0), (14, 0.0), (20, 50.0)):
        place(history, frame, ONE, by=(by, 0.0))
    do(history, RemoveKey(frames=tuple(range(11, 20)), joints=(ONE,), at=14))
    np.testing.assert_allclose(shifts(history)[10:21], np.linspace(30, 50, 11), atol=1e-9)
    do(history, RemoveKey(frames=tuple(joined(history.corrected, (ONE,), range(20, 21))), joints=(ONE,), at=20))
    np.testing.assert_allclose(shifts(history)[[9, 10, 11, 20]], [0, 30, 0, 0], atol=1e-9)
    do(history, RemoveKey(frames=(10,), joints=(ONE,), at=10))
    np.testing.assert_array_equal(history.keypoints.xy, before.xy)
    np.testing.assert_array_equal(history.keypoints.confidence, before.confidence)
    assert not history.corrected.edited.any() and not history.corrected.shift.any()


def test_a_moved_keyframe_takes_its_shift_along(history: EditHistory):
    for frame, by in ((10, 30.0), (20, 50.0)):
        place(history, frame, ONE, by=(by, 0.0))
    frames = tuple(joined(history.corrected, (ONE,), range(20, 27)))
    do(history, MoveKey(frames=frames, joints=(ONE,), at=20, to=26))
    np.testing.assert_allclose(shifts(history)[10:28], [*np.linspace(30, 50, 17), 0], atol=1e-9)
    assert history.corrected.key[:, ONE].nonzero()[0].tolist() == [10, 26]


def test_keypoints_follow_keyframes_of_their_own(history: EditHistory):
    place(history, 10, ONE, by=(30.0, 0.0))
    place(history, 16, OTHER, by=(0.0, 0.0))
    place(history, 20, ONE, OTHER, by=(50.0, 0.0))
    np.testing.assert_allclose(shifts(history)[[10, 15, 20]], [30, 40, 50], atol=1e-9)
    np.testing.assert_allclose(shifts(history, OTHER)[[15, 16, 18, 20]], [0, 0, 25, 50], atol=1e-9)


def test_other_corrections_in_between_are_what_is_shifted(history: EditHistory):
    do(history, Nudge(frames=(15,), joints=(ONE,), by=(7.0, 0.0)))
    place(history, 10, ONE, by=(30.0, 0.0))
    place(history, 20, ONE, by=(30.0, 0.0))
    np.testing.assert_allclose(shifts(history)[[14, 15, 16]], [30, 37, 30], atol=1e-9)
    do(history, Reset(frames=(16,), joints=(ONE,)))
    assert shifts(history)[16] == 0 and not history.corrected.edited[16, ONE]
    do(history, MoveKeypoint(frames=(10,), joints=(ONE,), xy=(((1.0, 2.0),),)))
    assert not history.corrected.key[10, ONE] and shifts(history)[11] == pytest.approx(30)


def test_frames_far_apart_are_not_joined(history: EditHistory):
    place(history, 5, ONE, by=(30.0, 0.0))
    assert joined(history.corrected, (ONE,), range(35, 36)) == range(6, 36)
    assert joined(history.corrected, (ONE,), range(36, 37)) == range(36, 37)
    assert joined(history.corrected, (OTHER,), range(20, 21)) == range(20, 21)
    place(history, 36, ONE, by=(30.0, 0.0))
    assert shifts(history)[20] == 0
    # What follows two keyframes already does so whatever comes in between, or goes.
    place(history, 20, ONE, by=(0.0, 0.0))
    assert joined(history.corrected, (ONE,), range(20, 21)) == range(6, 36)


def test_undo_brings_all_of_it_back(history: EditHistory):
    place(history, 10, ONE, by=(30.0, 0.0))
    before = history.corrected.records.copy()
    place(history, 20, ONE, by=(50.0, 0.0))
    last = history.undoable
    assert last is not None
    do(history, Undo(edit=last.id))
    for name in before.dtype.names or ():
        np.testing.assert_array_equal(history.corrected.records[name], before[name])
