"""Swapped limbs are exchanged, and no others."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from evaluation.synthetic.acting.script import Failure
from evaluation.synthetic.simulated_detector import Detector, detect
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.truth import truth_of
from fitting_core import keypoints as kp
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.fit.evidence.sides import PAIRED, unswapped
from fitting_core.io.truth import Truth
from fitting_core.keypoints import Keypoints
from fitting_core.world_camera import in_camera
from tests.samples.standing import by_hand, standing

CAMERA = Camera(focal=(900.0, 900.0), center=(480.0, 360.0), size=(960, 720), source="given")
POSES = {
    "arms hanging": {"left_shoulder": (0, 0, -70), "right_shoulder": (0, 0, 70)},
    "T-pose": {},
    "arms forward": {"left_shoulder": (0, -80, 0), "right_shoulder": (0, 80, 0)},
    "stride": {
        "left_shoulder": (30, 0, -65), "right_shoulder": (-30, 0, 65),
        "left_hip": (-25, 0, 0), "right_hip": (25, 0, 0), "right_knee": (30, 0, 0),
    },
}  # fmt: skip
"""Degrees (axis-angle) by joint."""
ARMS = ("elbow", "wrist")
USUAL = Detector()
BAD = Detector(noise=2.4, confidence=0.8, guess=24.0, lost=0.5, bias=3.0)


def before_camera(body: BodyModel, pose: np.ndarray, orient: Rotation, height: float = 1.4) -> Truth:
    """Bodies in the world's axes, on the spot before a camera."""
    place = np.array([0.0, 0.95, 0.0]) - body.rest_joints[0]
    world = replace(
        BodyParams.neutral(len(pose)),
        body_pose=torch.as_tensor(pose),
        global_orient=torch.as_tensor(orient.as_rotvec()),
        camera_translation=torch.as_tensor(np.tile(place, (len(pose), 1))),
    )
    view = View(azimuth=0.0, height=height, distance=3.6, looking_at=(0.0, 0.95, 0.0))
    return truth_of(body, in_camera(world, body.rest_joints[0], view.pose()), CAMERA, 25.0)


def turning(body: BodyModel, pose: str, step: int, height: float) -> Truth:
    """A turn on the spot and some more, by so many degrees a frame."""
    joints = np.zeros((21, 3))
    for joint, degrees in POSES[pose].items():
        joints[JOINT[joint] - 1] = np.radians(degrees)
    yaw = Rotation.from_euler("y", np.arange(0.0, 440.0, step)[:, None], degrees=True)
    return before_camera(body, np.tile(joints.reshape(63), (len(yaw), 1)), yaw, height)


def detected(truth: Truth, happened: Sequence[Failure] = (), detector: Detector = USUAL) -> Keypoints:
    """As the simulated detector makes them, nothing hidden."""
    seen = np.tile(truth.exists, (len(truth.keypoints), 1))
    return detect(
        truth.keypoints, seen, truth.exists,
        frame_rate=truth.frame_rate, height=truth.camera.size[1], failures=happened,
        rng=np.random.default_rng(0), detector=detector,
    )  # fmt: skip


@pytest.mark.parametrize("step", [2, 12, 30])
@pytest.mark.parametrize("pose", POSES)
def test_people_who_turn_keep_their_sides(free_body: BodyModel, pose: str, step: int):
    for height in (0.3, 1.4, 3.2):
        truth = turning(free_body, pose, step, height)
        for detector in (USUAL, BAD):
            assert unswapped(detected(truth, detector=detector))[1] == {}, (height, detector)


@pytest.mark.parametrize("step", [1, 4, 12])
@pytest.mark.parametrize("pair", PAIRED)
def test_swaps_of_people_who_turn_are_found(free_body: BodyModel, pair: str, step: int):
    """At 20 degrees, where they look at the camera."""
    truth = turning(free_body, "stride", step, 1.4)
    first = round(380 / step)
    swap = Failure("swapped", first / 25, (first + 4) / 25, (pair,))
    corrected, swaps = unswapped(detected(truth, (swap,)))
    assert {name: frames.tolist() for name, frames in swaps.items()} == {pair: list(range(first, first + 4))}
    np.testing.assert_array_equal(corrected.xy, detected(truth).xy)


@pytest.mark.parametrize("part", ["shoulder", "hip"])
def test_limbs_stay_where_only_the_trunks_sides_are_swapped(free_body: BodyModel, part: str):
    right = detected(turning(free_body, "arms hanging", 1, 1.4))[slice(0, 30)]
    assert unswapped(swapped(right, (part,), list(range(10, 16))))[1] == {}


def test_a_whole_person_taken_the_wrong_way_round_stays(free_body: BodyModel):
    right = detected(turning(free_body, "arms hanging", 1, 1.4))[slice(0, 30)]
    parts = [name.removeprefix("left_") for name in kp.BODY_25 if name.startswith("left_")]
    assert unswapped(swapped(right, tuple(parts), list(range(10, 16))))[1] == {}


def swapped(keypoints: Keypoints, parts: tuple[str, ...], frames: list[int]) -> Keypoints:
    xy, confidence = keypoints.xy.copy(), keypoints.confidence.copy()
    left, right = ([kp.INDEX[f"{side}_{part}"] for part in parts] for side in ("left", "right"))
    for values in (xy, confidence):
        values[np.ix_(frames, left + right)] = values[np.ix_(frames, right + left)]
    return Keypoints(xy=xy, confidence=confidence)


@pytest.mark.parametrize("frames", [[7, 8, 9, 10], [0, 1, 2], [17, 18, 19], [5, 6, 12, 13]])
@pytest.mark.parametrize(
    ("name", "parts"), [("arms", ARMS), ("legs", ("knee", "ankle", "big_toe", "small_toe", "heel"))]
)
def test_swapped_limbs_are_swapped_back(name: str, parts: tuple[str, ...], frames: list[int]):
    true = standing()
    corrected, swaps = unswapped(swapped(true, parts, frames))
    assert list(swaps) == [name]
    assert swaps[name].tolist() == frames
    np.testing.assert_array_equal(corrected.xy, true.xy)
    np.testing.assert_array_equal(corrected.confidence, true.confidence)


def test_hands_go_with_their_arms():
    true = standing()
    true.confidence[:, kp.HANDS] = 0.7
    true.xy[:, kp.LEFT_HAND] += 50
    xy = true.xy.copy()
    xy[5:8, kp.LEFT_HAND], xy[5:8, kp.RIGHT_HAND] = true.xy[5:8, kp.RIGHT_HAND], true.xy[5:8, kp.LEFT_HAND]
    broken = swapped(Keypoints(xy=xy, confidence=true.confidence), ARMS, [5, 6, 7])
    corrected, _ = unswapped(broken)
    np.testing.assert_array_equal(corrected.xy, true.xy)


def test_arms_that_really_cross_stay_as_they_are():
    true = standing(40)
    across = np.linspace(0, 1, 40)[:, None]
    for part in ARMS:
        left, right = kp.INDEX[f"left_{part}"], kp.INDEX[f"right_{part}"]
        a, b = true.xy[:, left].copy(), true.xy[:, right].copy()
        true.xy[:, left], true.xy[:, right] = a + across * (b - a) + [0, 30], b + across * (a - b)
    assert unswapped(true)[1] == {}


@pytest.mark.parametrize("bad", [[8], [6, 7, 8, 9, 10]])
@pytest.mark.parametrize("part", ["elbow", "wrist"])
def test_a_keypoint_marked_bad_hides_no_swap(part: str, bad: list[int]):
    """One of the arms' keypoints missing in the middle of a swap: the others are still swapped back."""
    true, name = standing(), f"left_{part}"
    broken = swapped(true, ARMS, [6, 7, 8, 9, 10])
    broken.confidence[bad, kp.INDEX[name]] = 0
    corrected, swaps = unswapped(broken)
    assert swaps["arms"].tolist() == [6, 7, 8, 9, 10]
    np.testing.assert_array_equal(corrected.xy, true.xy)
    assert np.flatnonzero(corrected.confidence[:, kp.INDEX[f"right_{part}"]] == 0).tolist() == bad


def test_a_keypoint_that_a_person_nudged_goes_with_its_limb():
    """Dragged by some pixels in a swapped frame: the keypoint is where it is, and its side is the body's."""
    true = standing()
    broken = swapped(true, ARMS, [6, 7, 8])
    left, right = kp.INDEX["left_wrist"], kp.INDEX["right_wrist"]
    broken.xy[7, left] += 3
    corrected, swaps = unswapped(by_hand(broken, ("left_wrist",), [7]))
    assert swaps["arms"].tolist() == [6, 7, 8]
    np.testing.assert_array_equal(corrected.xy[7, right], true.xy[7, right] + 3)
    assert np.argwhere(corrected.placed).tolist() == [[7, right]]


def test_sides_that_a_person_swapped_stay():
    """A person insists on what looks like a swap."""
    insisted = by_hand(
        swapped(standing(), ARMS, [6, 7, 8]),
        ("left_elbow", "right_elbow", "left_wrist", "right_wrist"),
        [6, 7, 8],
    )
    assert unswapped(insisted)[1] == {}
    np.testing.assert_array_equal(unswapped(insisted)[0].xy, insisted.xy)
