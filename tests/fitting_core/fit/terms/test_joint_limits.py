"""Joint limits: angles against rotations made by scipy, what people can and cannot do, derivatives, in float64."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fitting_core.body.handshapes import HANDSHAPES, finger_angles
from fitting_core.body.joint_ranges import JointRange, joint_ranges
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.fit.terms.limits import AngleTable, JointLimits

LIKE = torch.zeros(0, dtype=torch.float64)
NAMES = ("flexion", "side", "twist")


@pytest.fixture(scope="module")
def ranges(free_body: BodyModel) -> dict[str, JointRange]:
    return joint_ranges(free_body)


def excess(ranges: dict[str, JointRange], pose: dict[str, Rotation]) -> dict[tuple[str, str], float]:
    """Degrees beyond the range, where any are."""
    limits = JointLimits.of(1.0, {name: ranges[name] for name in pose}, fingers=True, like=LIKE)
    vectors = [rotation.as_rotvec() for rotation in pose.values()]
    beyond = limits.excess(torch.tensor(np.array(vectors))[None])
    named = limits.table.named(beyond)[0].rad2deg().numpy()
    found = {(name, angle): named[i, k] for i, name in enumerate(pose) for k, angle in enumerate(NAMES)}
    return {key: degrees for key, degrees in found.items() if abs(degrees) > 1e-6}


def turn(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Rotation:
    """By degrees, about an axis of the rest pose (x to the body's left, y up, z forward)."""
    return Rotation.from_rotvec(np.radians([x, y, z]))


BEYOND = [
    ("left_elbow", turn(y=20), ("flexion", -10)),  # 10 degrees of hyperextension are free
    ("right_elbow", turn(y=-20), ("flexion", -10)),
    ("left_elbow", turn(y=-160), ("flexion", 5)),
    ("left_elbow", turn(x=120), ("twist", 30)),
    ("right_elbow", turn(x=-95), ("twist", -5)),
    ("left_knee", turn(x=-30), ("flexion", -20)),
    ("left_knee", turn(x=200), ("flexion", 40)),  # beyond 180 degrees, not 160 the other way
    ("right_knee", turn(z=75), ("side", -65)),
    ("left_hip", turn(x=60), ("flexion", -25)),
    ("right_hip", turn(x=-150), ("flexion", 15)),
    ("left_hip", turn(y=100), ("twist", 15)),  # toes to the back
    ("head", turn(y=90), ("twist", 42)),
    ("spine2", turn(x=-52), ("flexion", -30)),
    ("left_wrist", turn(z=100), ("flexion", -10)),
    ("right_wrist", turn(z=100), ("flexion", 10)),
    ("left_ankle", turn(x=-75), ("flexion", 30)),
    ("right_ankle", turn(x=-75), ("flexion", 30)),
]


@pytest.mark.parametrize(("joint", "rotation", "expected"), BEYOND)
def test_excess_by_hand(ranges: dict[str, JointRange], joint: str, rotation: Rotation, expected: tuple[str, float]):
    assert excess(ranges, {joint: rotation}) == {(joint, expected[0]): pytest.approx(expected[1])}


def pointing(rest: tuple[str, str], along: list[float], beside: list[float]) -> Rotation:
    """The rotation after which two axes of the rest pose, such as ("x", "z"), point to these directions."""
    first, second = (np.eye(3)["xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1) for axis in rest)
    a = np.array(along) / np.linalg.norm(along)
    b = np.array(beside) - a * (a @ beside)
    b /= np.linalg.norm(b)
    return Rotation.from_matrix(
        np.stack([a, b, np.cross(a, b)], 1) @ np.stack([first, second, np.cross(first, second)], 1).T
    )


THIGH, ARM = ("-y", "z"), ("x", "z")
"""Where thigh and kneecap, and upper arm and the side to which the forearm bends, point at rest."""
POSSIBLE = {
    "sitting": ("left_hip", pointing(THIGH, [0, 0, 1], [0, 1, 0])),
    "squatting": ("left_hip", pointing(THIGH, [0.4, 0.5, 0.75], [0.3, 0.7, -0.6])),
    "cross-legged": ("left_hip", pointing(THIGH, [0.7, 0.1, 0.7], [0.75, 0.45, -0.5])),
    "legs crossed on a chair": ("left_hip", pointing(THIGH, [-0.35, 0.2, 0.9], [0, 0.97, -0.2])),
    "stride, from behind": ("left_hip", pointing(THIGH, [0, -0.87, -0.5], [0, -0.5, 0.87])),
    "arm at the side": ("left_shoulder", pointing(ARM, [0, -1, 0], [0, 0, 1])),
    "hand on the belly": ("left_shoulder", pointing(ARM, [0, -1, 0], [-1, 0, 0.2])),
    "hand on the back": ("left_shoulder", pointing(ARM, [0.1, -0.8, -0.6], [-0.9, 0.1, -0.4])),
    "reaching up": ("left_shoulder", pointing(ARM, [0.05, 1, 0], [-1, 0, 0])),
    "hand behind the head": ("left_shoulder", pointing(ARM, [0.5, 0.8, 0.1], [-0.6, 0.3, -0.7])),
    "pointing forward": ("left_shoulder", pointing(ARM, [0, 0, 1], [-1, 0, 0])),
    "goalkeeper": ("left_shoulder", pointing(ARM, [1, 0, 0], [0, 1, 0])),
    "hand on the other shoulder": ("left_shoulder", pointing(ARM, [-0.7, 0, 0.7], [-0.7, 0.2, -0.7])),
    "on the heels": ("left_knee", turn(x=155)),
    "leaning on the hand": ("left_wrist", turn(z=88)),
    "nodding": ("neck", turn(x=35)),
}
IMPOSSIBLE = {
    "thigh to the back": ("left_hip", pointing(THIGH, [0, -0.2, -1], [0, -1, 0.2])),
    "thigh to the back, seen as one to the front": ("left_hip", pointing(THIGH, [0, 0, -1], [0, 1, 0])),
    "thigh through the other one": ("left_hip", pointing(THIGH, [-1, -0.3, 0], [0, 0, 1])),
    "arm to the back": ("left_shoulder", pointing(ARM, [0.2, 0, -1], [1, 0, 0.2])),
    "arm up and to the back": ("left_shoulder", pointing(ARM, [0.3, 0.3, -0.9], [0, 1, 0])),
    "arm through the chest": ("left_shoulder", pointing(ARM, [-1, 0, -0.2], [0, 1, 0])),
    "elbow turned inside out": ("left_shoulder", pointing(ARM, [0, -1, 0], [0.3, 0, -1])),
    "owl": ("neck", turn(y=80)),
    "knee sideways": ("left_knee", turn(z=30)),
}


@pytest.mark.parametrize("name", POSSIBLE)
def test_what_people_do_is_free(ranges: dict[str, JointRange], name: str):
    joint, rotation = POSSIBLE[name]
    assert not excess(ranges, {joint: rotation})


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_what_nobody_can_do_costs(ranges: dict[str, JointRange], name: str):
    joint, rotation = IMPOSSIBLE[name]
    assert np.linalg.norm(list(excess(ranges, {joint: rotation}).values())) > 10


@pytest.mark.parametrize("shape", [*HANDSHAPES, "mean"])
def test_handshapes_are_free(ranges: dict[str, JointRange], free_body: BodyModel, shape: str):
    if shape == "mean":
        vectors = free_body.hand_mean.reshape(30, 3)
    else:
        vectors = np.concatenate([finger_angles(HANDSHAPES[shape], side) for side in ("left", "right")])
    names = [name for name in ranges if JOINT[name] >= JOINT["left_index1"]]
    assert len(names) == 30
    assert not excess(ranges, {n: Rotation.from_rotvec(vectors[JOINT[n] - JOINT["left_index1"]]) for n in names})


FINGERS = ["index", "middle", "ring", "pinky", "thumb"]


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("finger", FINGERS)
def test_fingers_bend_to_the_palm(ranges: dict[str, JointRange], free_body: BodyModel, side: str, finger: str):
    """Flexion brings the tip down to the palm (the thumb: across it), which faces the floor in the rest pose."""
    joints = free_body.joint_regressor @ free_body.template
    knuckle, end, far = (joints[JOINT[f"{side}_{name}"]] for name in (f"{finger}1", f"{finger}3", "pinky1"))
    bent = knuckle + ranges[f"{side}_{finger}1"].rotation(flexion=40).apply(end - knuckle)
    moved = bent - end
    towards = far - end if finger == "thumb" else np.array([0, -1, 0])
    assert moved @ towards > 0.5 * np.linalg.norm(moved) * np.linalg.norm(towards)


def test_every_joint_has_a_range_that_holds_its_rest(ranges: dict[str, JointRange]):
    assert set(ranges) == set(JOINT) - {"pelvis", "jaw", "left_eye", "right_eye"}
    for joint in ranges.values():
        np.testing.assert_allclose(np.array(joint.axes) @ np.array(joint.axes).T, np.eye(3), atol=1e-9)
        assert (joint.bounds[:, 0] < 0).all() and (joint.bounds[:, 1] > 0).all()


@settings(max_examples=40)
@given(st.data())
def test_angles_are_those_that_a_rotation_was_made_of(ranges: dict[str, JointRange], data: st.DataObject):
    """Within the ranges nothing costs; one angle beyond costs just that much and leaves the others alone."""
    name = data.draw(st.sampled_from(sorted(ranges)))
    joint = ranges[name]
    shares = np.array(data.draw(st.lists(st.floats(0, 1), min_size=3, max_size=3)))
    angles = joint.bounds[:, 0] + shares * (joint.bounds[:, 1] - joint.bounds[:, 0])
    rotation = joint.rotation(*angles)
    table = AngleTable.of({name: joint}, LIKE)
    found = table.named(table.angles(torch.tensor(rotation.as_rotvec())[None, None]))[0, 0].rad2deg()
    np.testing.assert_allclose(found, angles, atol=1e-6)
    assert not excess(ranges, {name: rotation})
    which, beyond = data.draw(st.integers(0, 2)), data.draw(st.floats(0.1, 15))
    angles[which] = joint.bounds[which, 1] + beyond
    assert excess(ranges, {name: joint.rotation(*angles)}) == {(name, NAMES[which]): pytest.approx(beyond, abs=1e-5)}


@settings(max_examples=40)
@given(st.lists(st.floats(-2, 2), min_size=3, max_size=3), st.sampled_from(["hip", "shoulder", "elbow", "thumb1"]))
def test_left_and_right_mirror_each_other(ranges: dict[str, JointRange], vector: list[float], part: str):
    left = excess(ranges, {f"left_{part}": Rotation.from_rotvec(vector)})
    right = excess(ranges, {f"right_{part}": Rotation.from_rotvec(np.array(vector) * (1, -1, -1))})
    assert len(left) == len(right)
    for (_, angle), degrees in left.items():
        # the free body's hands are symmetric to 0.1 mm
        assert right[f"right_{part}", angle] == pytest.approx(degrees, abs=0.5 if part == "thumb1" else 1e-6)


def test_slopes_are_finite_and_right_at_rest(ranges: dict[str, JointRange]):
    """Where a rotation is zero, and where it stands in the middle of a joint's range."""
    table = AngleTable.of(ranges, LIKE)
    middle = [joint.rotation(*joint.centre) for joint in ranges.values()]
    for pose in (
        torch.zeros(1, len(ranges), 3, dtype=torch.float64),
        torch.tensor(np.array([m.as_rotvec() for m in middle]))[None],
    ):
        forward = torch.func.jacfwd(lambda step, pose=pose: table.angles(pose + step))(
            torch.zeros(3, dtype=torch.float64)
        )
        steps = 1e-5 * torch.eye(3, dtype=torch.float64)
        by_differences = [(table.angles(pose + step) - table.angles(pose - step)) / 2e-5 for step in steps]
        torch.testing.assert_close(forward, torch.stack(by_differences, -1), rtol=1e-7, atol=1e-7)
