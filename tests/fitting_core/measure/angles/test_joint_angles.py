"""Joint angles of motions whose angles are known, what their signs mean, and where they are not determined."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body.geometry import MIRROR, MIRROR_ROTATION
from fitting_core.body.model import JOINT, JOINTS, BodyModel, other_side
from fitting_core.body.params import BodyParams
from fitting_core.ground.level import Level, upright
from fitting_core.measure.angles.cardan import held
from fitting_core.measure.angles.joint_angles import ANGLES, joint_angles
from fitting_core.motion import Motion
from tests.fitting_core.io.motion.motions import CAMERA, swinging
from tests.fitting_core.measure.angles.anatomy import mirrored, posed, turned

TOLERANCE = 1e-6
"""Degrees. Angles and the axes built here are computed in double precision, and off by 1e-12 at most."""
KNOWN = {
    # joint: sequence, turns about its axes, and what the angles then are
    "lumbar": ("ZXY", (-35, 12, 20), {"extension": -35, "bending": 12, "rotation": 20}),
    "neck": ("ZXY", (18, -10, -40), {"extension": 18, "bending": -10, "rotation": -40}),
    "hip": ("ZXY", (70, -25, 15), {"flexion": 70, "adduction": -25, "rotation": 15}),
    "knee": ("ZXY", (-30, 4, -9), {"flexion": 30, "adduction": 4, "rotation": -9}),
    "ankle": ("ZXY", (-22, 14, 6), {"dorsiflexion": -22, "inversion": 14, "rotation": 6}),
    "toes": ("ZXY", (33, 0, 0), {"extension": 33}),
    "shoulder": ("YXY", (60, -80, -35), {"plane": 60, "elevation": 80, "axial": -35}),
    "elbow": ("ZXY", (95, -8, 110), {"flexion": 95, "carrying": 8, "pronation": 110}),
    "wrist": ("ZXY", (-40, 17, 5), {"flexion": -40, "deviation": 17, "rotation": 5}),
}
SIDED = [joint for joint in KNOWN if joint not in ("lumbar", "neck")]


@pytest.mark.parametrize("betas", [(0.0,) * 10, (2.0, -1.5, 1.0, *(0.5,) * 7)])
def test_angles_by_which_a_body_was_posed_come_back(free_body: BodyModel, betas: tuple[float, ...]):
    turns = {}
    for joint, (sequence, about, _) in KNOWN.items():
        if joint in SIDED:
            turns |= {
                f"right_{joint}": [turned(sequence, *about)],
                f"left_{joint}": [mirrored(turned(sequence, *about))],
            }
        else:
            turns[joint] = [turned(sequence, *about)]
    root = [turned("YXZ", 40, -7, -15)]
    angles = joint_angles(posed(free_body, turns, root=root, betas=betas))
    expected = {"pelvis_rotation": 40, "pelvis_obliquity": 7, "pelvis_tilt": 15}
    for joint, (_, _, named) in KNOWN.items():
        for side in ("left_", "right_") if joint in SIDED else ("",):
            expected |= {f"{side}{joint}_{name}": value for name, value in named.items()}
    off = {name: float(angles[name][0]) - value for name, value in expected.items()}
    assert max(map(abs, off.values())) < TOLERANCE, off
    assert set(ANGLES) - set(expected) == {
        *(f"thorax_{name}" for name in ("rotation", "obliquity", "tilt")),
        *(f"{side}_shoulder_{name}" for side in ("left", "right") for name in ("flexion", "abduction")),
    }


def test_who_stands_anatomically_has_zeros(free_body: BodyModel):
    angles = joint_angles(posed(free_body, {}, root=[Rotation.identity()]))
    assert {name for name, values in angles.items() if np.isnan(values).any()} == {
        f"{side}_shoulder_{name}" for side in ("left", "right") for name in ("plane", "axial")
    }, "the hanging arm has no plane of elevation"
    assert all(np.nan_to_num(abs(values)).max() < TOLERANCE for values in angles.values())


SIGNS = [
    # a turn of one angle alone; a point of the body; where it goes, in front, up, outward; the angle that grows
    ("hip", ("Z", 30), "knee", (1, 1, 0), "hip_flexion"),
    ("hip", ("X", -30), "knee", (0, 1, 1), "hip_adduction"),
    ("hip", ("Y", 30), "foot", (0, 0, -1), "hip_rotation"),
    ("knee", ("Z", -30), "ankle", (-1, 1, 0), "knee_flexion"),
    ("knee", ("X", 30), "ankle", (0, 1, -1), "knee_adduction"),
    ("knee", ("Y", 30), "foot", (0, 0, -1), "knee_rotation"),
    ("ankle", ("Z", 30), "foot", (0, 1, 0), "ankle_dorsiflexion"),
    ("ankle", ("Y", 30), "foot", (0, 0, -1), "ankle_rotation"),
    ("wrist", ("Y", 90), "thumb2", (1, 0, -1), "wrist_rotation"),
    ("shoulder", ("X", -30), "elbow", (0, 1, 1), "shoulder_elevation"),
    ("shoulder", ("X", -30), "elbow", (0, 1, 1), "shoulder_abduction"),
    ("shoulder", ("Z", 30), "elbow", (1, 1, 0), "shoulder_flexion"),
    ("elbow", ("Z", 30), "wrist", (1, 1, 0), "elbow_flexion"),
    ("elbow", ("X", -30), "wrist", (0, 1, 1), "elbow_carrying"),
    ("elbow", ("Y", 90), "thumb2", (1, 0, -1), "elbow_pronation"),
    ("wrist", ("Z", 30), "middle1", (1, 1, 0), "wrist_flexion"),
    ("wrist", ("X", 30), "middle1", (0, 1, -1), "wrist_deviation"),
]


@pytest.mark.parametrize("side", ["left", "right"])
def test_signs_are_what_the_body_does(free_body: BodyModel, side: str):
    """A frame at rest, and one for each turn."""
    turns = {f"{side}_{joint}": [Rotation.identity()] * (len(SIGNS) + 1) for joint, *_ in SIGNS}
    for k, (joint, turn, *_) in enumerate(SIGNS, 1):
        turns[f"{side}_{joint}"][k] = turned(*turn) if side == "right" else mirrored(turned(*turn))
    motion = posed(free_body, turns)
    places, angles = motion.joints(), joint_angles(motion)
    for k, (_, (_, degrees), moved, direction, name) in enumerate(SIGNS, 1):
        way = (places[k] - places[0])[JOINT[f"{side}_{moved}"]] * ([1, 1, 1] if side == "left" else [-1, 1, 1])
        for went, expected in zip(way[::-1], direction, strict=True):
            assert not expected or went * expected > 0.001, f"{name}: went {went:.4f}"
        grown = angles[f"{side}_{name}"][[0, k]] @ (-1, 1)
        assert grown == pytest.approx(abs(degrees) * (-1 if name == "hip_adduction" else 1), abs=TOLERANCE), name


def test_a_mirrored_motion_has_the_other_side_s_angles(free_body: BodyModel):
    motion = swinging(free_body, 8).in_axes("y-up")
    swapped = [JOINT[other_side(name)] for name in JOINTS]
    pose = motion.pose.numpy()[:, swapped] * MIRROR_ROTATION
    params = replace(
        motion.params,
        global_orient=torch.as_tensor(pose[:, 0]),
        body_pose=torch.as_tensor(pose[:, 1:22].reshape(len(pose), -1)),
    )
    angles, others = joint_angles(motion), joint_angles(replace(motion, params=params))
    rest = motion.rest_joints[0].numpy()
    assert np.allclose(rest[swapped] * MIRROR, rest, atol=2e-3), "the free body is nearly symmetric"
    other = {"bending", "obliquity", "rotation"}
    for name, values in angles.items():
        middle = not name.startswith(("left", "right"))
        expected = -others[name] if middle and name.split("_")[1] in other else others[other_side(name)]
        assert np.allclose((values - expected + 180) % 360, 180, atol=TOLERANCE, equal_nan=True), name


def test_angles_run_on_over_many_turns(free_body: BodyModel):
    turning = np.arange(0, 1100, 20.0)
    motion = posed(free_body, {}, root=[turned("Y", angle) for angle in turning])
    assert np.allclose(joint_angles(motion)["pelvis_rotation"], turning, atol=TOLERANCE)


def test_the_world_is_upright_where_gravity_is_known(free_body: BodyModel):
    """A camera that looks down by 25 degrees, and a person who stands upright before it."""
    pitch = Rotation.from_rotvec(np.radians([25.0, 0, 0]))  # camera space: x right, y down, z away
    stands = pitch.as_matrix() @ np.diag([1.0, -1.0, -1.0])
    motion = posed(free_body, {}, root=[Rotation.identity()], axes="camera")
    params = replace(motion.params, global_orient=torch.as_tensor(Rotation.from_matrix(stands).as_rotvec()[None]))
    level = Level(turn=upright(stands[:, 1]), height=None, text="")
    known = joint_angles(replace(motion, params=params, level=level))
    unknown = joint_angles(replace(motion, params=params))
    for name in ("tilt", "obliquity", "rotation"):
        assert abs(known[f"pelvis_{name}"][0]) < TOLERANCE
    assert abs(unknown["pelvis_tilt"][0]) == pytest.approx(25, abs=TOLERANCE)


def test_held_angles_play_the_rotation_where_axes_coincide():
    turns = Rotation.from_euler("ZXY", [[20, 80, 10], [20, 90, 30], [25, 90, 35], [30, 85, 30]], degrees=True)
    angles = held(turns.as_matrix(), "ZXY")
    again = Rotation.from_euler("ZXY", angles, degrees=True)
    assert np.degrees((again.inv() * turns).magnitude()).max() < 1e-9
    assert angles[1, 0] == angles[0, 0], "the first axis waits"
    assert abs(np.diff(angles, axis=0)).max() < 40


def test_a_body_without_fingers_has_straight_wrists(free_body: BodyModel):
    fingers = [JOINT[name] for name in JOINTS[25:]]
    regressor = free_body.joint_regressor.copy()
    for joint in fingers:
        regressor[joint] = regressor[JOINT["left_wrist" if JOINTS[joint].startswith("left") else "right_wrist"]]
    body = replace(free_body, joint_regressor=regressor)
    angles = joint_angles(Motion(body=body, params=BodyParams.neutral(2), camera=CAMERA, frame_rate=25, name="tpose"))
    assert all(abs(angles[f"left_wrist_{name}"]).max() < TOLERANCE for name in ("flexion", "deviation", "rotation"))
    assert abs(angles["left_elbow_pronation"] - 90).max() < 0.01, "the elbow lies a millimetre off the arm's line"
