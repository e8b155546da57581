"""Mixamo's and Unreal's skeletons: where their joints are in files, how they stand at rest, and how they are turned."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.animation.animated import on_standard
from fitting_core.animation.known_rigs import MIXAMO, UNREAL, VRM
from fitting_core.animation.retargeting import PosedSkeleton
from fitting_core.animation.standard import Standard
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.io.motion.rig_glb import write_standard_glb
from fitting_core.motion import Motion
from tests.fitting_core.io.motion.gltf_player import Player
from tests.fitting_core.io.motion.motions import CAMERA, meshes, swinging
from tests.fitting_core.io.motion.rig_players import glb_joints

RIGS = {"mixamo": MIXAMO, "unreal": UNREAL, "vrm": VRM}
FRAMES = (0, 3, 6)
BODY = {
    "mixamo": {
        "mixamorig:Hips": "pelvis", "mixamorig:Spine2": "spine3", "mixamorig:Head": "head",
        "mixamorig:LeftShoulder": "left_collar", "mixamorig:LeftArm": "left_shoulder",
        "mixamorig:RightForeArm": "right_elbow", "mixamorig:RightHand": "right_wrist",
        "mixamorig:LeftUpLeg": "left_hip", "mixamorig:RightLeg": "right_knee", "mixamorig:LeftFoot": "left_ankle",
        "mixamorig:RightToeBase": "right_foot", "mixamorig:LeftHandPinky3": "left_pinky3",
        "mixamorig:RightHandThumb2": "right_thumb2",
    },
    "unreal": {
        "pelvis": "pelvis", "spine_03": "spine3", "neck_01": "neck", "clavicle_r": "right_collar",
        "upperarm_l": "left_shoulder", "lowerarm_r": "right_elbow", "hand_l": "left_wrist", "thigh_l": "left_hip",
        "calf_r": "right_knee", "foot_l": "left_ankle", "ball_r": "right_foot", "index_03_l": "left_index3",
        "thumb_01_r": "right_thumb1",
    },
    "vrm": {
        "hips": "pelvis", "upperChest": "spine3", "leftUpperArm": "left_shoulder", "rightLowerLeg": "right_knee",
        "leftToes": "left_foot", "rightThumbMetacarpal": "right_thumb1", "leftLittleDistal": "left_pinky3",
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def upright(free_body: BodyModel) -> Motion:
    return swinging(free_body).in_axes("y-up")


@pytest.fixture(scope="module", params=RIGS)
def rig(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def file(upright: Motion, rig: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp(rig)
    write_standard_glb(folder / "x.glb", upright, RIGS[rig])
    return folder / "x.glb"


def neutral(body: BodyModel) -> Motion:
    params = BodyParams.neutral(2, hand_components=45)
    hands = torch.as_tensor(-body.hand_mean)  # flat hands: the rest pose, and not the mean
    params = replace(params, left_hand_pose=hands[:1].expand(2, -1), right_hand_pose=hands[1:].expand(2, -1))
    return Motion(body=body, params=params, camera=CAMERA, frame_rate=30.0, name="still", axes="y-up")


@pytest.mark.parametrize("frame", FRAMES)
def test_joints_are_where_the_fit_has_them(file: Path, upright: Motion, rig: str, frame: int):
    expected = PosedSkeleton.of(upright).places[frame]
    in_glb = glb_joints(file, frame / upright.frame_rate)
    for name, joint in BODY[rig].items():
        assert np.linalg.norm(in_glb[name][:3, 3] - expected[JOINT[joint]]) < 1e-4, name


def test_the_surface_is_the_fit_s_as_far_as_it_says(file: Path, upright: Motion, rig: str):
    player = Player.of(file)
    extras = player.document.asset.extras
    shown = [player.vertices(float(time)) for time in player.times]
    off = np.linalg.norm(shown - meshes(upright), axis=2)
    assert np.max(off) == pytest.approx(extras["largest_deviation_m"], abs=2e-5)
    assert np.mean(off) == pytest.approx(extras["mean_deviation_m"], abs=2e-6) and np.mean(off) < 5e-4
    assert rig == "unreal" or np.max(off) < 2e-3


@pytest.fixture(scope="module")
def at_rest(free_body: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Where the bones of Mixamo's and Unreal's rigs are at rest, (4, 4), by the nodes of their GLBs."""
    found = {}
    for standard in (MIXAMO, UNREAL):
        path = tmp_path_factory.mktemp("rest") / "x.glb"
        write_standard_glb(path, neutral(free_body), standard)
        player = Player.of(path)
        found |= zip((node.name for node in player.document.nodes), player.matrices(None), strict=True)
    return found


def direction(at_rest: dict[str, np.ndarray], bone: str, towards: str) -> np.ndarray:
    along = at_rest[towards][:3, 3] - at_rest[bone][:3, 3]
    return along / np.linalg.norm(along)


def test_a_bone_that_a_vertex_does_not_follow_is_number_0(file: Path, rig: str):
    """As the specification asks, and validators warn."""
    player = Player.of(file)
    attributes = player.document.meshes[0].primitives[0].attributes
    bones, weights = player.array(attributes.JOINTS_0), player.array(attributes.WEIGHTS_0)
    assert (weights == 0).any() and not bones[weights == 0].any()


@pytest.mark.parametrize(
    ("bone", "towards", "expected"),
    [
        ("LeftArm", "LeftForeArm", [1, 0, 0]),
        ("LeftHandIndex1", "LeftHandIndex2", [1, 0, 0]),
        ("RightForeArm", "RightHand", [-1, 0, 0]),
        ("RightUpLeg", "RightLeg", [0, -1, 0]),
    ],
)
def test_mixamo_stands_in_a_t_pose(at_rest: dict[str, np.ndarray], bone: str, towards: str, expected: list[int]):
    found = direction(at_rest, f"mixamorig:{bone}", f"mixamorig:{towards}")
    assert np.allclose(found, expected, atol=0.05 if "Leg" in bone else 1e-3)


@pytest.mark.parametrize(
    ("bone", "axis", "towards"),
    [
        ("mixamorig:LeftArm", 1, "mixamorig:LeftForeArm"),
        ("mixamorig:RightForeArm", 1, "mixamorig:RightHand"),
        ("mixamorig:LeftLeg", 1, "mixamorig:LeftFoot"),
        ("mixamorig:RightHandIndex2", 1, "mixamorig:RightHandIndex3"),
        ("upperarm_l", 0, "lowerarm_l"),
        ("lowerarm_r", -1, "hand_r"),
        ("thigh_l", -1, "calf_l"),
        ("calf_r", 0, "foot_r"),
        ("spine_01", 0, "spine_02"),
    ],
)
def test_axes_run_along_the_bones(at_rest: dict[str, np.ndarray], bone: str, axis: int, towards: str):
    """`axis` 0 or 1 is x or y along the bone; -1 is x against it."""
    along = at_rest[bone][:3, max(axis, 0)] * (-1 if axis < 0 else 1)
    assert along @ direction(at_rest, bone, towards) > 0.999


def standing_as(body: BodyModel, standard: Standard, **turned: np.ndarray) -> Motion:
    """A body in the pose that a rig has at rest; with joints turned on, by rotations in the rig's world."""
    still = neutral(body)
    rest, parents = on_standard(still, standard).target.rest, body.parents
    world = np.stack([turned.get(name, np.eye(3)) @ rest[j] for name, j in JOINT.items()])
    local = np.stack([world[parents[j]].T @ world[j] if j else world[j] for j in range(55)])
    pose, hands = torch.as_tensor(Rotation.from_matrix(local).as_rotvec()), torch.as_tensor(body.hand_mean)
    params = replace(
        still.params,
        body_pose=pose[1:22].reshape(1, -1).expand(2, -1),
        left_hand_pose=(pose[25:40].reshape(1, -1) - hands[:1]).expand(2, -1),
        right_hand_pose=(pose[40:55].reshape(1, -1) - hands[1:]).expand(2, -1),
    )
    return replace(still, params=params)


@pytest.mark.parametrize("standard", RIGS.values(), ids=list(RIGS))
def test_a_body_that_stands_as_the_rig_does_turns_nothing(free_body: BodyModel, standard: Standard):
    moving = on_standard(standing_as(free_body, standard), standard)
    assert np.allclose(moving.moved, np.eye(3), atol=1e-6)


def test_unreal_s_root_is_on_the_floor_below_the_person(file: Path, upright: Motion, rig: str):
    if rig != "unreal":
        pytest.skip("the others have no root above the pelvis")
    nodes = [glb_joints(file, frame / upright.frame_rate) for frame in FRAMES]
    pelvis = PosedSkeleton.of(upright).places[0, 0]
    assert all(np.allclose(node["root"][:3, 3], nodes[0]["root"][:3, 3]) for node in nodes)
    assert np.allclose(nodes[0]["root"][[0, 2], 3], pelvis[[0, 2]], atol=1e-6)
    assert nodes[0]["root"][1, 3] == pytest.approx(upright.joints()[0, :, 1].min(), abs=1e-5)
