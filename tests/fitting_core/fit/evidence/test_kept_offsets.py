"""Offsets that a person keeps: what they make of the lifter's points and deviations, and of detections."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fitting_core.fit.evidence.kept_offsets import kept_places, with_kept
from fitting_core.keypoints import BODY, COUNT, INDEX, KeptOffset, Keypoints

WRIST = INDEX["right_wrist"]
FRAMES, UNSURE = 120, 0.1
WHOLE = tuple(range(FRAMES))
OFFSET = np.array([0.03, -0.02, 0.09])
"""In the trunk's axes: to its left, up, ahead."""
AT_REST = {"neck": (0.0, -0.5, 0.0), "mid_hip": (0.0, 0.0, 0.0), "left_hip": (0.1, 0.0, 0.0), "right_hip": (-0.1, 0, 0)}


def turning() -> tuple[Float[np.ndarray, "T 25 3"], Float[np.ndarray, "T 3 3"]]:
    """Points of somebody who turns once around and leans, and the trunk's axes: left, up and ahead."""
    rest = np.zeros((25, 3))
    rest[[INDEX[name] for name in AT_REST]] = list(AT_REST.values())
    rest[WRIST] = -0.3, 0.1, -0.4
    yaw = np.linspace(0, 2 * np.pi, FRAMES)
    turn = Rotation.from_euler("YX", np.stack([yaw, 0.3 * np.sin(yaw)], 1)).as_matrix()
    axes = turn @ np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])  # facing the camera with x right and y down
    return rest @ turn.swapaxes(1, 2), axes


def kept_at(*frames: int, noise: float = 0.0, keypoint: int = WRIST) -> KeptOffset:
    """True depths, of which the lifter's is off by OFFSET; every second is off by `noise`."""
    points, axes = turning()
    true = points[:, keypoint, 2] + axes[:, 2] @ OFFSET
    wrong = {frame: noise * (-1) ** i for i, frame in enumerate(frames)}
    return KeptOffset(keypoint=keypoint, frames=WHOLE, depths={frame: true[frame] + wrong[frame] for frame in frames})


def made(*kept: KeptOffset) -> tuple[Float[np.ndarray, "T 25 3"], Float[np.ndarray, "T 25 3"]]:
    """By how much points move, metres along the trunk's axes, and deviations along the camera's."""
    points, axes = turning()
    moved, deviations = with_kept(kept, points, np.full(points.shape[:2], UNSURE))
    return (moved - points) @ axes, deviations


def test_depths_from_all_sides_find_the_whole_offset():
    """Which turns with the body, and leaves of the deviation what changes from frame to frame."""
    moved, deviations = made(kept_at(*range(0, FRAMES, 4)))
    np.testing.assert_allclose(moved[:, WRIST] - OFFSET, 0.0, atol=0.2 * OFFSET[2])
    np.testing.assert_allclose(deviations[:, WRIST, 2], UNSURE * np.sqrt(1 / 3), rtol=0.1)


def test_only_the_keypoint_and_its_frames_change():
    moved, deviations = made(replace(kept_at(10, 50), frames=(10, 11, 50)))
    other = np.ones(moved.shape[:2], bool)
    other[[10, 11, 50], WRIST] = False
    assert not moved[other].any() and (deviations[other] == UNSURE).all()
    assert abs(moved[[10, 11, 50], WRIST]).max(1).all()


def test_one_view_tells_nothing_along_the_axes_across_it():
    """A frame from the front, for those from the side."""
    moved, deviations = made(kept_at(0))
    ahead, side = 0, FRAMES // 4
    share = moved[ahead, WRIST, 2] / OFFSET[2]
    assert 0.5 < share < 0.8, "one frame may be off itself"
    assert deviations[ahead, WRIST, 2] < 0.85 * UNSURE and deviations[side, WRIST, 2] > 0.99 * UNSURE
    along_z = (turning()[1][side] @ moved[side, WRIST])[2]
    assert abs(along_z) < 0.05 * OFFSET[2]


def test_more_frames_and_agreement_make_an_offset_surer():
    """Frames beside each other are one."""
    one, two, four, beside = (made(kept_at(*at))[1][0, WRIST, 2] for at in ((0,), (0, 119), (0, 17, 102, 119), (0, 1)))
    assert four < two < one and beside == pytest.approx(one, rel=0.02)
    apart = made(kept_at(0, 17, 102, 119, noise=0.15))[1][0, WRIST, 2]
    assert four < 0.95 * apart


def test_the_later_of_two_counts():
    nothing = replace(kept_at(0), frames=(3,), depths={0: turning()[0][0, WRIST, 2]})
    moved, _ = made(kept_at(0), nothing)
    assert abs(moved[3, WRIST]).max() < 1e-9 < abs(moved[4, WRIST]).max()


# --- places in the picture ---

SCALE = 400.0
"""Pixels for a metre."""
LASTING = np.array([0.02, -0.03, 0.015])


def moved_places(*frames: int, seen: np.ndarray | None = None, wrong: float = 0.0, by_hand: int = -1) -> np.ndarray:
    """Metres by which the wrist's detections move, if keyframes put it where it is; every second is off by `wrong`."""
    points, axes = turning()
    xy, confidence = np.zeros((FRAMES, COUNT, 2)), np.zeros((FRAMES, COUNT))
    xy[:, BODY], confidence[:, BODY] = 300 + SCALE * points[..., :2], 0.9
    if seen is not None:
        confidence[~seen] = 0
    off = SCALE * (axes @ LASTING)[:, :2]
    shifts = {frame: tuple((off[frame] + SCALE * wrong * (i % 2)).tolist()) for i, frame in enumerate(frames)}
    kept = KeptOffset(keypoint=WRIST, frames=WHOLE, depths={}, shifts=shifts)
    placed = np.zeros(confidence.shape, bool)
    placed[by_hand, WRIST] = by_hand >= 0
    moved = kept_places(Keypoints(xy=xy, confidence=confidence, by_hand=placed, kept=(kept,)), points)
    assert not np.delete(moved, WRIST, 1).any()
    return moved[:, WRIST] / SCALE


def test_places_from_all_sides_find_the_offset_that_turns_with_the_body():
    true = (turning()[1] @ LASTING)[:, :2]
    found = moved_places(*range(0, FRAMES, 4))
    np.testing.assert_allclose(found, true, atol=0.3 * float(np.linalg.norm(LASTING)))
    one = moved_places(0)
    assert 0.1 < np.linalg.norm(one[0]) / np.linalg.norm(true[0]) < 0.4, "one frame may be off itself"


def test_a_detection_that_is_far_off_tells_nothing_of_other_frames():
    np.testing.assert_array_equal(moved_places(0, 40, wrong=0.5), moved_places(0))
    assert not moved_places().any()


def test_placed_keypoints_stay_and_frames_without_detections_tell_nothing():
    assert not moved_places(0, 40, by_hand=40)[40].any() and moved_places(0, 40, by_hand=40)[41].any()
    seen = np.arange(FRAMES) != 40
    np.testing.assert_array_equal(moved_places(0, 40, seen=seen)[seen], moved_places(0)[seen])
