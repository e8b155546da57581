"""The hand space: its angles against the body's own kinematics, how it is learnt, and what twelve components reach."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from build_assets.free_body.hand.hand_skeleton import HandSkeleton, axis_angle_of
from build_assets.free_body.hand.hand_space import (
    hand_of,
    left_hand_basis,
    postures,
    read_hand_space,
)
from build_assets.free_body.hand.recordings import joint_angles, read_recording
from fitting_core import keypoints as kp
from fitting_core.body.files.reading import load_body
from fitting_core.body.geometry import unit
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.errors import InputError
from fitting_core.keypoints import FINGERS
from fitting_core.shipped import FREE_FOLDER

pytestmark = pytest.mark.thorough

_OURS = [("thumb", "index", "middle", "ring", "pinky").index(finger) for finger in FINGERS]


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return load_body(FREE_FOLDER / "SMPLX_NEUTRAL.npz")


@pytest.fixture(scope="module")
def hand(body: BodyModel) -> HandSkeleton:
    return hand_of(body)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def posed(hand: HandSkeleton, angles: np.ndarray) -> np.ndarray:
    return hand.pose(torch.as_tensor(angles).view(-1, 5, 3, 3)).numpy()


def drawn(count: int) -> np.ndarray:
    return postures(count, np.random.default_rng(3))


def test_a_posed_skeleton_is_the_posed_body(body: BodyModel, hand: HandSkeleton) -> None:
    angles = drawn(6)
    axis_angle = torch.as_tensor(axis_angle_of(angles, hand.axes) - body.hand_mean[0])
    params = BodyParams.neutral(6, hand_components=45)
    keypoints, _ = keypoints_in_space(body, BodyParams(**{**vars(params), "left_hand_pose": axis_angle}))
    fingers = (keypoints[:, kp.LEFT_HAND][:, 1:] - keypoints[:, kp.LEFT_HAND.start, None]).reshape(6, 5, 4, 3)
    apart = np.linalg.norm(fingers[:, _OURS] - posed(hand, angles), axis=-1)
    assert apart[:, :, :3].max() < 1e-9
    assert apart[:, :, 3].max() < 4e-3, "tips are skin: correctives and blending move them a little"


def test_positive_angles_flex_and_spread(hand: HandSkeleton) -> None:
    def moved(axis: int) -> np.ndarray:
        angles = np.zeros((5, 3, 3))
        angles[:, 0, axis] = 0.3
        return posed(hand, angles)[0][:, 3] - hand.points[:, 3]

    assert (moved(0)[:4, 1] < -0.01).all(), "flexing takes fingertips down, to where the palm faces"
    assert moved(0)[FINGERS.index("thumb"), 2] < -0.01, "and the thumb's across the palm"
    assert (moved(1)[:4, 2] < -0.01).all(), "spreading takes fingers away from the thumb"


def test_joint_angles_are_found_from_directions(hand: HandSkeleton) -> None:
    angles = drawn(15)
    bones = unit(np.diff(posed(hand, angles), axis=2))
    found = joint_angles(bones, hand)
    assert len(found) == 15
    again = unit(np.diff(posed(hand, found), axis=2))
    assert np.degrees(np.arccos(np.clip((again * bones).sum(-1), -1, 1))).max() < 3
    flexion = (slice(None), slice(0, 4), slice(None), 0)
    off = found.reshape(-1, 5, 3, 3)[flexion] - angles.reshape(-1, 5, 3, 3)[flexion]
    assert np.degrees(np.abs(off)).max() < 5


def _write_recording(path: Path, hand: HandSkeleton, turn: Rotation, *, right: bool) -> None:
    """The rest pose seen by a sensor, as the left or the right hand; the second of two frames is not confident."""
    mirror = np.array([1, 1, -1.0 if right else 1.0])
    points = turn.apply((1000 * hand.points * mirror).reshape(-1, 3)).reshape(5, 4, 3)
    palm = turn.apply([[0.0, 0, 0], [0, -1, 0], [1, 0, 0]])
    order = np.argsort(_OURS)  # from ours to the sensor's
    np.savez(
        path,
        joints_mm=np.tile(points[order], (2, 1, 1, 1)),
        palm_pos_normal_dir=np.tile(palm, (2, 1, 1)),
        is_right=np.full(2, right),
        confidence=np.array([0.9, 0.1]),
    )


@pytest.mark.parametrize("right", [False, True])
def test_recordings_become_left_hands(tmp_path: Path, hand: HandSkeleton, right: bool) -> None:
    _write_recording(tmp_path / "one.npz", hand, Rotation.from_rotvec([0.4, -1.0, 0.7]), right=right)
    recording = read_recording(tmp_path / "one.npz")
    assert recording.directions.shape == (1, 5, 3, 3)
    assert np.allclose(recording.directions[0], unit(np.diff(hand.points, axis=1)), atol=1e-6)


def test_broken_recordings_are_named(tmp_path: Path) -> None:
    path = tmp_path / "broken.npz"
    np.savez(path, joints_mm=np.zeros((2, 5, 4, 3)))
    for _ in range(2):
        with pytest.raises(InputError, match=r"broken\.npz.* is no hand recording"):
            read_recording(path)
        path.write_bytes(b"nonsense")


def test_the_shipped_space_is_complete_and_in_the_bodies(body: BodyModel) -> None:
    space = read_hand_space()
    assert np.allclose(space.components @ space.components.T, np.eye(45), atol=1e-5)
    basis = left_hand_basis(body.joint_regressor @ body.template, space)
    for side, own in enumerate((basis, basis.mirrored())):
        assert np.allclose(body.hand_components[side], own.components, atol=1e-4)
        assert np.allclose(body.hand_mean[side], own.mean, atol=1e-4)
