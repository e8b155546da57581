"""Every kind of edit: what it makes of keypoints, worked out by hand, and which edits are refused."""

import zlib
from typing import Any, get_args

import msgspec
import numpy as np
import pytest
from hypothesis import given

from fitting_core.errors import InputError
from fitting_core.fit.evidence.sides import unswapped
from fitting_core.keypoints import BODY, FACE, FINGER_JOINTS, HANDS, INDEX, LEFT_HAND, NAMES, RIGHT_HAND, Keypoints
from tcfit_app.project.edits import edit_log
from tcfit_app.project.edits.edit_log import EditHistory, LogEntry, Redo, Undo, decode, encode
from tcfit_app.project.edits.kinds import (
    MIRRORED,
    SWAPPABLE,
    ClearDepth,
    CopyFrom,
    DetectAgain,
    Edit,
    Interpolate,
    Keep,
    Lock,
    MarkBad,
    MoveKey,
    MoveKeypoint,
    Nudge,
    Pin,
    PlaceKey,
    Release,
    RemoveKey,
    Reset,
    Restore,
    SetConfidence,
    SetDepth,
    ShapeHand,
    SwapSides,
    Unlock,
)
from tests.samples.project_samples import edits, same_keypoints, sample_keypoints

NOW: Any = None
"""No test here looks at times."""


@pytest.fixture
def detected() -> Keypoints:
    """Keypoints 0 to 9 were detected in all frames, 10 to 12 in none."""
    keypoints = sample_keypoints()
    confidence = keypoints.confidence.copy()
    confidence[:, :10], confidence[:, 10:13] = 0.4, 0
    return Keypoints(xy=keypoints.xy, confidence=confidence)


def after(detected: Keypoints, *made: Edit) -> EditHistory:
    entries = [LogEntry(id=n, time=NOW, author="", action=edit) for n, edit in enumerate(made, 1)]
    return EditHistory(detected, entries)


def untouched(history: EditHistory, detected: Keypoints, frames: list[int], joints: list[int]) -> bool:
    """Whether nothing but these frames and joints has changed."""
    elsewhere = np.ones(detected.confidence.shape, dtype=bool)
    elsewhere[np.ix_(frames, joints)] = False
    found, marks = history.keypoints, history.corrected
    same = (found.xy == detected.xy).all(-1) & (found.confidence == detected.confidence) & ~marks.bad & ~marks.edited
    return bool(same[elsewhere].all())


def test_move_puts_a_group_of_keypoints_where_it_says(detected: Keypoints):
    xy = (((1.0, 2.0), (3.0, 4.0)), ((5.0, 6.0), (7.0, 8.0)))
    history = after(detected, MoveKeypoint(frames=(4, 1), joints=(3, 11), xy=xy))
    found = history.keypoints
    assert found.xy[[4, 1]][:, [3, 11]].tolist() == [[list(p) for p in row] for row in xy]
    assert (found.confidence[np.ix_([4, 1], [3, 11])] == 1).all() and history.corrected.edited[4, 3]
    assert untouched(history, detected, [4, 1], [3, 11])
    unsure = MoveKeypoint(frames=(0,), joints=(3,), xy=(((1.0, 2.0),),), confidence=0.25)
    assert after(detected, unsure).keypoints.confidence[0, 3] == 0.25


def test_bad_keypoints_have_no_confidence_until_they_are_restored(detected: Keypoints):
    where: Any = {"frames": (1, 2), "joints": (3, 11)}
    bad = after(detected, MarkBad(**where))
    assert (bad.keypoints.confidence[1:3, [3, 11]] == 0).all() and np.array_equal(bad.keypoints.xy, detected.xy)
    assert bad.corrected.bad[1:3, [3, 11]].all() and untouched(bad, detected, [1, 2], [3, 11])
    assert same_keypoints(after(detected, MarkBad(**where), Restore(**where)).keypoints, detected)
    moved = MoveKeypoint(frames=(1,), joints=(3,), xy=(((9.0, 9.0),),))
    for edit, confidence in ((moved, 1.0), (SetConfidence(frames=(1,), joints=(3,), confidence=0.7), 0.7)):
        again = after(detected, MarkBad(**where), edit)
        assert again.keypoints.confidence[1, 3] == confidence and again.keypoints.confidence[2, 3] == 0
    nudged = after(detected, MarkBad(**where), Nudge(**where, by=(1.0, 1.0)), Restore(**where))
    assert same_keypoints(nudged.keypoints, detected)


def test_restored_keypoints_are_as_sure_as_before(detected: Keypoints):
    where: Any = {"frames": (1,), "joints": (3,)}
    history = after(detected, SetConfidence(**where, confidence=0.6), MarkBad(**where), Restore(**where))
    assert history.keypoints.confidence[1, 3] == 0.6


def test_a_confidence_brings_nothing_that_is_nowhere(detected: Keypoints):
    lost = Keypoints(xy=detected.xy, confidence=detected.confidence * (np.arange(137) != 5))
    where: Any = {"frames": (1, 2), "joints": (3, 5)}
    history = after(lost, MarkBad(**where), SetConfidence(confidence=0.5, **where))
    assert (history.keypoints.confidence[1:3, 3] == 0.5).all() and (history.keypoints.confidence[1:3, 5] == 0).all()
    assert history.corrected.edited[1, 3] and not history.corrected.edited[1, 5]


def test_nudge_moves_what_is_there(detected: Keypoints):
    history = after(detected, Nudge(frames=(0, 5), joints=(2, 12), by=(1.0, -2.0)))
    found = history.keypoints
    assert (
        np.allclose(found.xy[[0, 5], 2] - detected.xy[[0, 5], 2], [1, -2]) and (found.confidence[[0, 5], 2] == 1).all()
    )
    assert untouched(history, detected, [0, 5], [2])


def test_swap_exchanges_left_and_right_with_their_confidence(detected: Keypoints):
    left, right = INDEX["left_wrist"], INDEX["right_wrist"]
    once = after(detected, SwapSides(frames=(2,), joints=SWAPPABLE["arms"]))
    assert np.array_equal(once.keypoints.xy[2, left], detected.xy[2, right])
    assert once.keypoints.confidence[2, left] == detected.confidence[2, right]
    assert untouched(once, detected, [2], list(SWAPPABLE["arms"]))
    sides = np.zeros_like(once.corrected.edited)
    sides[2, list(SWAPPABLE["arms"])] = True
    assert np.array_equal(once.corrected.edited, sides)
    hands = after(detected, SwapSides(frames=(2,), joints=SWAPPABLE["hands"])).keypoints
    assert np.array_equal(hands.xy[2, LEFT_HAND], detected.xy[2, RIGHT_HAND])
    assert np.array_equal(hands.confidence[2, RIGHT_HAND], detected.confidence[2, LEFT_HAND])
    bad = after(detected, MarkBad(frames=(2,), joints=(left,)), SwapSides(frames=(2,), joints=SWAPPABLE["arms"]))
    assert bad.corrected.bad[2, right] and not bad.corrected.bad[2, left]


def test_the_other_side_of_a_keypoint():
    assert all(MIRRORED[MIRRORED[j]] == j for j in MIRRORED) and set(MIRRORED) == set(range(FACE.start))
    for joint, other in MIRRORED.items():
        swapped = {"left": "right", "right": "left"}.get(NAMES[joint].split("_")[0])
        assert NAMES[other] == (NAMES[joint] if swapped is None else f"{swapped}_{NAMES[joint].split('_', 1)[1]}")
        assert (joint in range(137)[BODY]) == (other in range(137)[BODY])
    assert {NAMES[j].partition("_")[2] for j in SWAPPABLE["arms"]} == {"elbow", "wrist"}, "shoulders are not mixed up"
    assert len(SWAPPABLE["body"]) == 22 and set(SWAPPABLE["hands"]) == set(range(137)[HANDS])


def test_copy_takes_over_what_another_frame_has(detected: Keypoints):
    bad = MarkBad(frames=(1,), joints=(4,))
    history = after(detected, bad, CopyFrom(frames=(2, 3), joints=(3, 4, 11), source=1))
    found = history.keypoints
    for frame in (2, 3):
        assert np.array_equal(found.xy[frame, [3, 4, 11]], detected.xy[1, [3, 4, 11]])
        assert found.confidence[frame, [3, 4, 11]].tolist() == [1, 0, 0]
        assert history.corrected.bad[frame, [3, 4, 11]].tolist() == [False, True, False]
    assert np.array_equal(found.xy[4:], detected.xy[4:])


def test_interpolation_fills_a_straight_line(detected: Keypoints):
    ends = [MoveKeypoint(frames=(t,), joints=(3,), xy=((xy,),)) for t, xy in ((1, (10.0, 0.0)), (5, (50.0, 80.0)))]
    history = after(detected, *ends, Interpolate.between(1, 5, (3, 11)))
    found = history.keypoints
    assert np.allclose(found.xy[2:5, 3], [(20, 20), (30, 40), (40, 60)]) and (found.confidence[1:6, 3] == 1).all()
    assert untouched(history, detected, [1, 2, 3, 4, 5], [3])
    gap = after(detected, MarkBad(frames=(5,), joints=(3,)), Interpolate.between(1, 5, (3,)))
    assert np.array_equal(gap.keypoints.xy, detected.xy)


def test_reset_brings_the_detection_back(detected: Keypoints):
    moved = MoveKeypoint(frames=(0, 1), joints=(3,), xy=(((1.0, 1.0),), ((2.0, 2.0),)))
    both = after(detected, moved, MarkBad(frames=(0,), joints=(3,)), Reset(frames=(0, 1), joints=(3,)))
    assert same_keypoints(both.keypoints, detected) and not both.corrected.bad.any() and not both.corrected.edited.any()


LEFT, RIGHT = INDEX["left_wrist"], INDEX["right_wrist"]
FARTHER = SetDepth(frames=(4, 1), joints=(LEFT, 11), depth=((0.25, -0.5), (0.75, 1.0)))


def depths(detected: Keypoints, *made: Edit) -> np.ndarray:
    """What counts of the left wrist's depth in frames 1 to 4, after FARTHER and further edits."""
    return after(detected, FARTHER, *made).keypoints.told_depth[1:5, LEFT]


def test_a_depth_is_said_of_keypoints_wherever_they_are(detected: Keypoints):
    history = after(detected, FARTHER)
    found = history.keypoints.told_depth
    assert found[np.ix_([4, 1], [LEFT, 11])].tolist() == [[0.25, -0.5], [0.75, 1.0]] and np.isfinite(found).sum() == 4
    assert untouched(history, detected, [], []), "it moves and marks nothing in the image"
    assert after(detected).keypoints.depth is None


def test_depths_change_sides_with_their_keypoints(detected: Keypoints):
    found = after(detected, FARTHER, SwapSides(frames=(1,), joints=SWAPPABLE["arms"])).keypoints.told_depth
    assert found[1, RIGHT] == 0.75 and np.isnan(found[1, LEFT]) and found[4, LEFT] == 0.25


HERE: Any = {"frames": (1,), "joints": (LEFT,)}
BOTH: Any = {"frames": (1, 4), "joints": (LEFT,)}
LINE = Interpolate.between(1, 4, (LEFT, 11))
NOT = np.nan
DEPTHS: dict[str, tuple[tuple[Edit, ...], list[float]]] = {
    "moved": ((MoveKeypoint(**BOTH, xy=(((1.0, 1.0),), ((2.0, 2.0),))),), [0.75, NOT, NOT, 0.25]),
    "nudged": ((Nudge(**BOTH, by=(1.0, 0.0)),), [0.75, NOT, NOT, 0.25]),
    "of another confidence": ((SetConfidence(**BOTH, confidence=0.3),), [0.75, NOT, NOT, 0.25]),
    "bad": ((MarkBad(**HERE),), [NOT, NOT, NOT, 0.25]),
    "said of a bad one": ((MarkBad(**HERE), SetDepth(**HERE, depth=((0.5,),))), [NOT, NOT, NOT, 0.25]),
    "restored": ((MarkBad(**HERE), SetDepth(**HERE, depth=((0.5,),)), Restore(**HERE)), [0.5, NOT, NOT, 0.25]),
    "copied": ((CopyFrom(frames=(2, 4), joints=(LEFT,), source=1),), [0.75, 0.75, NOT, 0.75]),
    "copied from where none is": ((CopyFrom(frames=(4,), joints=(LEFT,), source=3),), [0.75, NOT, NOT, NOT]),
    "interpolated": ((LINE,), [0.75, 0.75 - 0.5 / 3, 0.25 + 0.5 / 3, 0.25]),
    "interpolated from a bad end": ((MarkBad(**HERE), LINE), [NOT, NOT, NOT, 0.25]),
    "interpolated from an end without": ((ClearDepth(**HERE), LINE), [NOT, NOT, NOT, 0.25]),
    "kept where an end has none": (
        (SetDepth(frames=(2,), joints=(LEFT,), depth=((-1.0,),)), ClearDepth(**HERE), LINE),
        [NOT, -1.0, NOT, 0.25],
    ),
}


@pytest.mark.parametrize(("made", "expected"), DEPTHS.values(), ids=DEPTHS)
def test_a_depth_follows_its_keypoint(detected: Keypoints, made: tuple[Edit, ...], expected: list[float]):
    np.testing.assert_allclose(depths(detected, *made), expected)


def test_depths_are_interpolated_of_undetected_keypoints_too(detected: Keypoints):
    assert np.allclose(after(detected, FARTHER, LINE).keypoints.told_depth[2, 11], 0.5)


def test_pinned_keypoints_are_in_one_place_and_count_again(detected: Keypoints):
    edit = Pin(frames=(1, 2), joints=(4, 7), xy=((1.0, 2.0), (3.0, 4.0)), depth=((0.1, 0.2), (0.3, 0.4)))
    history = after(detected, MarkBad(frames=(1,), joints=(4,)), edit)
    assert untouched(history, detected, [1, 2], [4, 7])
    for frame, depth in ((1, (0.1, 0.2)), (2, (0.3, 0.4))):
        np.testing.assert_array_equal(history.keypoints.xy[frame, [4, 7]], [(1, 2), (3, 4)])
        np.testing.assert_array_equal(history.keypoints.told_depth[frame, [4, 7]], depth)
        np.testing.assert_array_equal(history.keypoints.confidence[frame, [4, 7]], 1)


@pytest.mark.parametrize(
    "later",
    [
        MoveKeypoint(frames=(1,), joints=(4,), xy=(((9.0, 9.0),),)),
        Nudge(frames=(1,), joints=(4,), by=(1.0, 0.0)),
        SetDepth(frames=(1,), joints=(4,), depth=((0.5,),)),
        ClearDepth(frames=(1,), joints=(4,)),
        CopyFrom(frames=(1,), joints=(4,), source=0),
        Reset(frames=(1,), joints=(4,)),
        PlaceKey(frames=(1,), joints=(4,), at=1, xy=((9.0, 9.0),)),
    ],
    ids=lambda edit: type(edit).__name__,
)
def test_a_keypoint_is_pinned_until_something_else_is_said_of_its_place(detected: Keypoints, later: Edit):
    pin = Pin(frames=(1, 2), joints=(4, 7), xy=((1.0, 2.0), (3.0, 4.0)), depth=((0.1, 0.2), (0.3, 0.4)))
    assert np.argwhere(after(detected, pin).corrected.pinned).tolist() == [[1, 4], [1, 7], [2, 4], [2, 7]]
    assert np.argwhere(after(detected, pin, later).corrected.pinned).tolist() == [[1, 7], [2, 4], [2, 7]]


def test_joints_are_locked_until_they_are_unlocked_or_reset(detected: Keypoints):
    lock = Lock(frames=(0, 1, 2), joints=(4, 7), turn=((0.1, 0.2, 0.3), (1.0, 0.0, 0.0)))
    history = after(detected, lock)
    assert untouched(history, detected, [], []) and history.corrected.locked.sum() == 6
    assert history.keypoints.turn is not None
    np.testing.assert_allclose(history.keypoints.turn[2, [4, 7]], [(0.1, 0.2, 0.3), (1, 0, 0)], atol=1e-7)
    stays = SwapSides(frames=(0,), joints=SWAPPABLE["arms"]), Nudge(frames=(0,), joints=(4,), by=(1.0, 1.0))
    moved = after(detected, lock, *stays, MarkBad(frames=(0,), joints=(4,)))
    np.testing.assert_array_equal(moved.corrected.turn, history.corrected.turn)
    freed = after(detected, lock, Unlock(frames=(0, 1), joints=(4,)), Reset(frames=(2,), joints=(4, 7)))
    assert np.argwhere(freed.corrected.locked).tolist() == [[0, 7], [1, 7]]
    assert after(detected, lock, Unlock(frames=(0, 1, 2), joints=(4, 7))).keypoints.turn is None


def test_a_kept_offset_stays_until_it_is_released(detected: Keypoints):
    shift = ((None, (2.0, -1.0)), (None, None))
    keep = Keep(frames=(0, 1, 2, 3), joints=(4, 7), at=(1, 3), depth=((0.1, None), (0.3, 0.4)), shift=shift)
    later = Keep(frames=(4, 5), joints=(4,), at=(5,), depth=((0.9,),))
    history = after(detected, keep, later, Reset(frames=(1,), joints=(4,)), ClearDepth(frames=(3,), joints=(4, 7)))
    assert untouched(history, detected, [], []) and history.keypoints.depth is None
    elbow, wrist, other = history.keypoints.kept
    assert (elbow.keypoint, elbow.frames, elbow.depths) == (4, (0, 1, 2, 3), {1: 0.1, 3: 0.3})
    assert (wrist.keypoint, wrist.depths, wrist.shifts) == (7, {3: 0.4}, {1: (2.0, -1.0)})
    assert other.depths == {5: 0.9} and not other.shifts and not elbow.shifts
    assert history.keypoints[2:6].kept == () and unswapped(history.keypoints)[0].kept == history.kept
    left = after(detected, keep, later, Release(frames=(0, 1), joints=(4,)))
    assert left.keypoints.kept == (wrist, other)
    for number, action, kept in ((4, Undo(edit=3), (elbow, wrist, other)), (5, Redo(edit=3), (wrist, other))):
        left.add(LogEntry(id=number, time=NOW, author="", action=action))
        assert left.keypoints.kept == kept


FIST = ((0.0, 0.0, -1.0),) * 15
FLAT = ((0.0, 0.0, 0.0),) * 15
LEFT_FINGERS = FINGER_JOINTS["left"]


def shaped(detected: Keypoints, *edits: Edit) -> np.ndarray:
    """How far a left hand is closed in each frame, NaN where it has no shape."""
    turn = after(detected, *edits).corrected.turn
    assert np.array_equal(turn[:, LEFT_FINGERS], turn[:, LEFT_FINGERS[:1]].repeat(15, 1), equal_nan=True)
    return -turn[:, LEFT_FINGERS[0], 2]


def test_a_hand_goes_over_into_its_shape_and_out_of_it(detected: Keypoints):
    where: Any = {"joints": LEFT_FINGERS, "name": "fist"}
    edit = ShapeHand(frames=(1, 2, 3, 4), **where, shape=FIST, blend=(2, 1), before=FLAT, after=FLAT)
    assert edit.whole == (3,)
    history = after(detected, edit)
    assert untouched(history, detected, [], []) and history.corrected.touched.sum() == 4 * 15
    np.testing.assert_allclose(shaped(detected, edit), [np.nan, 7 / 27, 20 / 27, 1, 0.5, np.nan], atol=1e-6)
    free = ShapeHand(frames=(2, 3), joints=LEFT_FINGERS, name="", shape=None)
    assert np.isnan(shaped(detected, edit, free)).tolist() == [True, False, True, True, False, True]
    other = ShapeHand(frames=(3, 4), **where, shape=FLAT, blend=(1, 0), before=FLAT)
    already = ShapeHand(frames=(2,), **where, shape=FIST)
    np.testing.assert_allclose(shaped(detected, already, other)[2:5], [1, 0.5, 0], atol=1e-6)


def test_a_shape_stays_when_single_fingers_are_corrected(detected: Keypoints):
    edit = ShapeHand(frames=(1, 2), joints=LEFT_FINGERS, name="fist", shape=FIST)
    finger = LEFT_FINGERS[3]
    stay = Reset(frames=(1,), joints=(finger, 4)), SwapSides(frames=(2,), joints=SWAPPABLE["hands"])
    moved = MoveKeypoint(frames=(1,), joints=(finger,), xy=(((9.0, 9.0),),))
    assert (shaped(detected, edit, moved, *stay)[1:3] == 1).all()
    assert after(detected, edit, moved, *stay).corrected.xy[1, finger].tolist() == detected.xy[1, finger].tolist()
    for gone in (Reset(frames=(1,), joints=HAND), DetectAgain.found((1,), "left_hand", hand_at(7))):
        assert np.isnan(shaped(detected, edit, gone)).tolist() == [True, True, False, True, True, True]


def test_depths_are_reset_and_cleared(detected: Keypoints):
    where: Any = {"frames": (1,), "joints": (LEFT,)}
    moved = MoveKeypoint(**where, xy=(((1.0, 1.0),),))
    for edit in (Reset(**where), ClearDepth(**where)):
        history = after(detected, FARTHER, moved, edit)
        assert np.isnan(history.keypoints.told_depth[1, LEFT]) and history.keypoints.told_depth[4, LEFT] == 0.25
        assert history.corrected.edited[1, LEFT] == isinstance(edit, ClearDepth)


def hand_at(*places: float, confidence: float = 0.5) -> np.ndarray:
    """Points of a person whose left hand alone was found, all of it in one place; none of it where that is 0."""
    points = np.zeros((len(places), 137, 3))
    for row, place in zip(points, places, strict=True):
        row[LEFT_HAND] = (place, place + 1, confidence if place else 0)
    return points


HAND = tuple(range(137)[LEFT_HAND])


def test_what_is_detected_again_counts_as_detected(detected: Keypoints):
    by_hand = MoveKeypoint(frames=(1,), joints=(30,), xy=(((9.0, 9.0),),))
    told: list[Edit] = [
        by_hand,
        MarkBad(frames=(1,), joints=(31,)),
        DetectAgain.found((1, 4), "left_hand", hand_at(7, 8)),
    ]
    history = after(detected, *told)
    found = history.corrected
    for frame, place in ((1, 7), (4, 8)):
        assert (found.xy[frame, LEFT_HAND] == (place, place + 1)).all() and (
            found.confidence[frame, LEFT_HAND] == 0.5
        ).all()
    assert not (found.edited | found.bad | found.key).any() and not history.keypoints.placed.any()
    assert untouched(history, detected, [1, 4], list(HAND))
    later = after(detected, *told, by_hand, Reset(frames=(1,), joints=HAND))
    assert later.corrected.xy[1, 30].tolist() == [7, 8], "reset goes back to what was detected last"
    assert after(detected, *told, by_hand).corrected.xy[1, 30].tolist() == [9, 9], "later corrections stay on top"


def test_what_is_not_found_again_stays_with_its_corrections(detected: Keypoints):
    where: Any = {"frames": (1,), "joints": (30,)}
    moved, again = MoveKeypoint(**where, xy=(((9.0, 9.0),),)), DetectAgain.found((1, 2), "left_hand", hand_at(0, 8))
    history = after(detected, moved, again)
    assert history.corrected.edited[1, 30] and history.corrected.xy[1, 30].tolist() == [9, 9]
    back = after(detected, moved, again, Reset(**where)).corrected
    assert np.array_equal(back.xy[1, 30], detected.xy[1, 30]) and not back.edited[1, 30]


def test_hands_stay_where_only_the_body_is_found_again(detected: Keypoints):
    points = np.zeros((1, 137, 3))
    points[0, :5] = (3, 4, 0.5)
    found = after(detected, DetectAgain.found((2,), "person", points)).corrected
    assert (found.confidence[2, :5] == 0.5).all() and (found.confidence[2, 5:25] == 0).all()
    assert np.array_equal(found.xy[2, 25:], detected.xy[2, 25:])


def test_undo_brings_the_earlier_detection_back(detected: Keypoints):
    history = after(detected, DetectAgain.found((1,), "left_hand", hand_at(7)))
    given = history.detected
    history.add(LogEntry(id=2, time=NOW, author="", action=DetectAgain.found((1,), "left_hand", hand_at(9))))
    assert given.xy[1, 30].tolist() == [9, 10], "it shows what is detected now"
    for number, place in ((2, [7, 8]), (1, detected.xy[1, 30].tolist())):
        history.add(LogEntry(id=9 - number, time=NOW, author="", action=edit_log.Undo(edit=number)))
        assert history.detected.xy[1, 30].tolist() == history.corrected.xy[1, 30].tolist() == place


ONE: Any = {"frames": (0,), "joints": (0,)}
SHAPED = ShapeHand(frames=(1, 2, 3), joints=LEFT_FINGERS, name="fist", shape=FIST)
AGAIN = DetectAgain.found((0,), "left_hand", hand_at(7))
REFUSED = {
    "no frame": (MarkBad(frames=(), joints=(0,)), "names no frame"),
    "no keypoint": (MarkBad(frames=(0,), joints=()), "names no keypoint"),
    "frames behind the end": (MarkBad(frames=(3, 6, 7, 8), joints=(0,)), "no frame 6-8; the clip has frames 0 to 5"),
    "negative frame": (Reset(frames=(-1,), joints=(0,)), "no frame -1"),
    "keypoint": (Reset(frames=(0,), joints=(137,)), "no keypoint 137"),
    "frame twice": (Reset(frames=(1, 1), joints=(0,)), "a frame twice"),
    "too few positions": (
        MoveKeypoint(frames=(0, 1), joints=(0,), xy=(((1.0, 1.0),),)),
        "not have one position for each",
    ),
    "source": (CopyFrom(**ONE, source=6), "copies from a frame that the clip does not have"),
    "nothing between": (Interpolate.between(2, 3, (0,)), "names no frame"),
    "outside of the ends": (Interpolate(frames=(1, 4), joints=(0,), first=0, last=3), "are not between"),
    "end outside the clip": (Interpolate.between(3, 6, (0,)), "are not between its two"),
    "one side": (SwapSides(frames=(0,), joints=(INDEX["left_wrist"],)), "left_wrist is named without"),
    "too few depths": (
        SetDepth(frames=(0, 1), joints=(0,), depth=((0.1,),)),
        "one depth for each of 1 keypoints in 2 frames",
    ),
    "depth of a finger": (SetDepth(frames=(0,), joints=(30,), depth=((0.0,),)), "left_index1 is not a body keypoint"),
    "no depth to clear": (ClearDepth(frames=(0,), joints=(100,)), "is not a body keypoint"),
    "gap around a key": (RemoveKey(frames=(0, 2), joints=(0,), at=0), "frames are not consecutive"),
    "key elsewhere": (RemoveKey(frames=(1, 2), joints=(0,), at=3), "keyframe is not among its frames"),
    "key goes elsewhere": (MoveKey(frames=(1, 2), joints=(0,), at=1, to=3), "new keyframe is not among its frames"),
    "too few positions of a key": (PlaceKey(**ONE, at=0, xy=()), "not have one position for each of 1 keypoints"),
    "too few turns": (Lock(frames=(0,), joints=(4, 7), turn=((0.0, 0.0, 0.0),)), "one rotation for each of 2"),
    "a hand locked": (Lock(frames=(0,), joints=(30,), turn=((0.0, 0.0, 0.0),)), "cannot be locked"),
    "too few pinned": (Pin(**ONE, xy=(), depth=((0.0,),)), "not have one position for each of 1 keypoints"),
    "nothing kept": (Keep(**ONE, at=(0,), depth=((None,),)), "no depth and no place of nose is stated"),
    "too few shifts kept": (Keep(**ONE, at=(0,), depth=((0.1,),), shift=((),)), "one shift for each of 1 keypoints"),
    "kept from nowhere": (Keep(**ONE, at=(), depth=()), "names no frame"),
    "kept from behind the end": (Keep(**ONE, at=(6,), depth=((0.1,),)), "no frame 6"),
    "too few kept": (Keep(**ONE, at=(0,), depth=((),)), "one depth for each of 1 keypoints in 1 frames"),
    "a hand kept": (Keep(frames=(0,), joints=(30,), at=(0,), depth=((0.1,),)), "is not a body keypoint"),
    "another part": (msgspec.structs.replace(AGAIN, part="face"), "keypoints are not those of the face"),
    "some of a part": (msgspec.structs.replace(AGAIN, joints=HAND[1:]), "keypoints are not those of the left hand"),
    "packed nothing": (msgspec.structs.replace(AGAIN, packed=b"nothing"), "cannot be unpacked"),
    "packed too much": (
        msgspec.structs.replace(AGAIN, packed=zlib.compress(bytes(10**7))),
        "does not have one position",
    ),
    "found nowhere": (DetectAgain.found((0,), "left_hand", hand_at(np.nan)), "a position is not a number"),
    "found too surely": (DetectAgain.found((0,), "left_hand", hand_at(7, confidence=1.5)), "a confidence is not"),
    "found unsurely": (DetectAgain.found((0,), "left_hand", hand_at(7, confidence=np.nan)), "a confidence is not"),
    "shape of an arm": (msgspec.structs.replace(SHAPED, joints=(4, 7)), "not the finger joints of one hand"),
    "shape with a gap": (msgspec.structs.replace(SHAPED, frames=(1, 2, 4)), "frames are not consecutive"),
    "only blends": (msgspec.structs.replace(SHAPED, blend=(1, 2), before=FIST, after=FIST), "as many frames lead"),
    "blend from nothing": (msgspec.structs.replace(SHAPED, blend=(1, 0)), "nothing says what the hand is"),
    "blend before the clip": (
        msgspec.structs.replace(SHAPED, frames=(0, 1), blend=(1, 0), before=FIST),
        "nothing says what the hand is",
    ),
    "face": (SwapSides(frames=(0,), joints=(100,)), "belongs to the face"),
}


@pytest.mark.parametrize(("edit", "message"), REFUSED.values(), ids=REFUSED)
def test_senseless_edits_are_refused(edit: Edit, message: str, detected: Keypoints):
    history = after(detected)
    with pytest.raises(InputError, match=message):
        history.check(edit)


OUT_OF_RANGE = {
    "no number": MoveKeypoint(**ONE, xy=(((float("nan"), 1.0),),)),
    "far away": MoveKeypoint(**ONE, xy=(((1e9, 1.0),),)),
    "too sure": SetConfidence(**ONE, confidence=1.5),
    "infinite nudge": Nudge(**ONE, by=(float("inf"), 0.0)),
    "depth that is no number": SetDepth(**ONE, depth=((float("nan"),),)),
    "too deep": SetDepth(**ONE, depth=((3.01,),)),
    "key far away": PlaceKey(**ONE, at=0, xy=((1e9, 1.0),)),
    "turned too far": Lock(frames=(0,), joints=(4,), turn=((8.0, 0.0, 0.0),)),
    "pinned too deep": Pin(**ONE, xy=((0.0, 0.0),), depth=((9.0,),)),
    "kept too deep": Keep(**ONE, at=(0,), depth=((-3.01,),)),
    "half a shape": msgspec.structs.replace(SHAPED, shape=FIST[1:]),
    "endless shape": msgspec.structs.replace(SHAPED, shape=((9.0, 0.0, 0.0),) * 15),
}


@pytest.mark.parametrize("edit", OUT_OF_RANGE.values(), ids=OUT_OF_RANGE)
def test_numbers_out_of_range_do_not_get_into_the_log(edit: Edit):
    with pytest.raises(InputError, match="cannot be read"):
        decode(encode(edit))


@given(edits())
def test_an_edit_reads_back_from_its_text(edit: Edit):
    assert decode(encode(edit)) == edit


def test_every_kind_is_drawn_in_these_tests():
    assert set(get_args(edit_log.LogAction)) == {
        *get_args(Edit),
        edit_log.MarkFrames,
        edit_log.WriteNote,
        edit_log.WriteNotes,
        edit_log.Undo,
        edit_log.Redo,
    }


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        '{"kind": "explode", "frames": [0], "joints": [0]}',
        '{"frames": [0], "joints": [0]}',
        '{"kind": "mark_bad", "frames": [0]}',
        '{"kind": "mark_bad", "frames": [0], "joints": [0], "force": true}',
        '{"kind": "mark_bad", "frames": [0.5], "joints": [0]}',
        '{"kind": "mark_bad", "frames": "0", "joints": [0]}',
        '{"kind": "undo", "edit": null}',
        '{"kind": "detect_again", "frames": [0], "joints": [0], "part": "tail", "packed": ""}',
    ],
)
def test_other_texts_are_no_edits(text: str):
    with pytest.raises(InputError, match="cannot be read"):
        decode(text)
