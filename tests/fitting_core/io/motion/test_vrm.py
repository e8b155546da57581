"""VRM 1.0 and its animation: what the specification asks, and where the bones are.

The files were also opened with three-vrm and three-vrm-animation 3.5: all 55 bones were within 0.1 micrometres.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pygltflib
import pytest

from fitting_core.animation.retargeting import PosedSkeleton
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.io.motion.vrm import UNITS, write_vrm, write_vrm_animation
from fitting_core.motion import Motion
from tests.fitting_core.io.motion.gltf_player import Player
from tests.fitting_core.io.motion.motions import swinging
from tests.fitting_core.io.motion.rig_players import glb_joints

SIDES = ("left", "right")
REQUIRED = {
    "hips", "spine", "head",
    *(f"{s}{b}" for s in SIDES for b in ("UpperLeg", "LowerLeg", "Foot", "UpperArm", "LowerArm", "Hand")),
}  # fmt: skip
"""Bones that VRMC_vrm 1.0 (humanoid.md) requires."""
PARENTS = {
    "spine": "hips", "chest": "spine", "upperChest": "chest", "neck": "upperChest", "head": "neck", "jaw": "head",
    "leftEye": "head", "leftUpperLeg": "hips", "leftLowerLeg": "leftUpperLeg", "leftFoot": "leftLowerLeg",
    "leftToes": "leftFoot", "leftShoulder": "upperChest", "leftUpperArm": "leftShoulder",
    "leftLowerArm": "leftUpperArm", "leftHand": "leftLowerArm", "leftThumbMetacarpal": "leftHand",
    "leftThumbProximal": "leftThumbMetacarpal", "leftThumbDistal": "leftThumbProximal",
    "leftLittleProximal": "leftHand", "leftLittleDistal": "leftLittleIntermediate",
}  # fmt: skip
"""What hangs on what there."""


@pytest.fixture(scope="module")
def upright(free_body: BodyModel) -> Motion:
    return swinging(free_body).in_axes("y-up")


@pytest.fixture(scope="module")
def avatar(upright: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("vrm") / "x.vrm"
    write_vrm(path, upright)
    return path


@pytest.fixture(scope="module")
def animation(upright: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("vrma") / "x.vrma"
    write_vrm_animation(path, upright)
    return path


def extension(path: Path, name: str) -> dict:
    document = pygltflib.GLTF2().load_binary(str(path))
    assert document is not None and document.extensionsUsed == [name]
    assert document.extensions is not None and document.extensions[name]["specVersion"] == "1.0"
    return document.extensions[name]


def test_the_avatar_has_the_bones_that_are_required_in_their_order(avatar: Path):
    bones = {name: bone["node"] for name, bone in extension(avatar, "VRMC_vrm")["humanoid"]["humanBones"].items()}
    nodes = pygltflib.GLTF2().load_binary(str(avatar)).nodes  # pyright: ignore[reportOptionalMemberAccess]
    assert set(bones) >= REQUIRED and len(set(bones.values())) == len(bones) == 55
    assert len({node.name for node in nodes}) == len(nodes)
    for child, parent in PARENTS.items():
        for swap in (str, lambda name: name.replace("left", "right")):
            assert bones[swap(child)] in nodes[bones[swap(parent)]].children, child


def test_it_stands_in_a_t_pose_on_the_floor_and_looks_along_z(avatar: Path):
    player = Player.of(avatar)
    rest = dict(zip((node.name for node in player.document.nodes), player.matrices(None), strict=True))
    at = {name: matrix[:3, 3] for name, matrix in rest.items()}
    assert at["leftHand"][0] > 0.5 > -0.5 > at["rightHand"][0], "its left is +x"
    assert np.allclose(at["leftUpperArm"][1:], at["leftHand"][1:], atol=1e-4), "arms are level"
    assert at["leftToes"][2] > at["leftFoot"][2] + 0.05, "toes point along +z"
    skin, mesh = player.document.skins[0], player.document.meshes[0]
    inverse = player.array(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    bound = [rest[player.document.nodes[n].name] @ inverse[k] for k, n in enumerate(skin.joints)]
    assert np.allclose(bound, np.eye(4), atol=1e-5), "the skin is bound where the bones are at rest"
    vertices = player.array(mesh.primitives[0].attributes.POSITION)
    assert vertices[:, 1].min() == pytest.approx(0, abs=1e-5) and 1.4 < vertices[:, 1].max() < 2.2
    assert not player.document.animations


@pytest.mark.parametrize("frame", [0, 3, 6])
def test_the_animation_has_the_fit_s_joints(animation: Path, upright: Motion, frame: int):
    found = glb_joints(animation, frame / upright.frame_rate)
    posed = PosedSkeleton.of(upright).places
    begin = posed[0, 0] * (1, 0, 1) + (0, upright.joints()[0, :, 1].min(), 0)
    for name, joint in (("hips", "pelvis"), ("leftHand", "left_wrist"), ("rightToes", "right_foot"), ("head", "head")):
        assert np.linalg.norm(found[name][:3, 3] - (posed[frame, JOINT[joint]] - begin)) < 1e-4


def test_the_animation_s_bones_and_expressions(animation: Path, avatar: Path, upright: Motion):
    about = extension(animation, "VRMC_vrm_animation")
    player = Player.of(animation)
    bones = about["humanoid"]["humanBones"]
    assert set(bones) >= REQUIRED and not {"leftEye", "rightEye"} & set(bones)
    moved = {c.target.node for c in player.document.animations[0].channels if c.target.path == "translation"}
    expressions = {name: of["node"] for name, of in about["expressions"]["custom"].items()}
    assert moved == {bones["hips"]["node"], *expressions.values()}, "only the hips and the expressions are moved"
    assert set(expressions) <= set(extension(avatar, "VRMC_vrm")["expressions"]["custom"])
    for frame in (0, 4):
        for k in range(10):
            values = [player.values(expressions[n], "translation", float(player.times[frame])) if n in expressions
                      else np.zeros(3) for n in (f"expression_{k}", f"expression_{k}_negative")]  # fmt: skip
            weight = (values[0] - values[1])[0]  # pyright: ignore[reportOptionalOperand]
            assert weight == pytest.approx(float(upright.params.expression[frame, k]) / UNITS, abs=1e-6)


def test_a_body_without_a_face(tiny_body: BodyModel, tmp_path: Path):
    plain = replace(tiny_body, expression_directions=np.zeros_like(tiny_body.expression_directions))
    write_vrm(tmp_path / "x.vrm", swinging(plain))
    write_vrm_animation(tmp_path / "x.vrma", swinging(plain))
    found = extension(tmp_path / "x.vrm", "VRMC_vrm")["expressions"]
    assert set(found["preset"]) == {"aa"} and not found["custom"]
