"""The mapping file: what is guessed, read, written and refused."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core.animation.rigs.guessing import guessed
from fitting_core.animation.rigs.mapping import guess_joints
from fitting_core.animation.rigs.parts import CHAINS, NEEDED, PARTS
from fitting_core.body.model import JOINTS
from fitting_core.errors import InputError
from fitting_core.io.motion.rigs.mapping_file import RigMapping, read_mapping, read_skeleton, write_mapping
from tests.fitting_core.io.motion.rigs.rig_files import PERSON, bvh_text, glb_bytes, gltf_document, with_mapping

FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")


def sided(form: str, sides: str, names: str) -> list[str]:
    return [form.format(s=side, n=name) for side in sides.split() for name in names.split()]


RIGS: dict[str, list[str]] = {
    "mixamo": [
        *(f"mixamorig:{n}" for n in "Hips Spine Spine1 Spine2 Neck Head HeadTop_End".split()),
        *sided("mixamorig:{s}{n}", "Left Right", "Shoulder Arm ForeArm Hand UpLeg Leg Foot ToeBase Toe_End"),
        *sided("mixamorig:{s}Hand{n}", "Left Right", " ".join(f"{f}{k}" for f in FINGERS for k in (1, 2, 3, 4))),
    ],
    "unreal": [
        *"root pelvis spine_01 spine_02 spine_03 neck_01 head ik_foot_root ik_foot_l ik_hand_gun".split(),
        *sided("{n}_{s}", "l r", "clavicle upperarm lowerarm hand thigh calf foot ball upperarm_twist_01"),
        *sided("{n}_{s}", "l r", "index_metacarpal calf_twist_01"),
        *sided("{n}_{s}", "l r", " ".join(f"{f.lower()}_0{k}" for f in FINGERS for k in (1, 2, 3))),
    ],
    "vrm": [
        *"hips spine chest upperChest neck head".split(),
        *sided("{s}{n}", "left right", "Shoulder UpperArm LowerArm Hand UpperLeg LowerLeg Foot Toes"),
        *sided("{s}{n}", "left right", "ThumbMetacarpal ThumbProximal ThumbDistal"),
        *(f"{s}{f}{p}" for s in ("left", "right") for f in ("Index", "Middle", "Ring", "Little")
          for p in ("Proximal", "Intermediate", "Distal")),
    ],
    "rigify": [
        "DEF-spine", *(f"DEF-spine.00{k}" for k in range(1, 7)),
        *sided("DEF-{n}.{s}", "L R", "shoulder upper_arm upper_arm.001 forearm hand thigh shin foot toe"),
        *sided("DEF-{n}.{s}", "L R", " ".join(
            f"{'' if f == 'Thumb' else 'f_'}{f.lower()}.0{k}" for f in FINGERS for k in (1, 2, 3)
        )),
    ],
    "plain": list(JOINTS),
}  # fmt: skip
EXPECTED: dict[str, dict[str, tuple[str, ...]]] = {
    "mixamo": {
        "pelvis": ("mixamorig:Hips",),
        "spine": ("mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"),
        "left_collar": ("mixamorig:LeftShoulder",),
        "left_shoulder": ("mixamorig:LeftArm",),
        "right_knee": ("mixamorig:RightLeg",),
        "right_foot": ("mixamorig:RightToeBase",),
        "left_pinky3": ("mixamorig:LeftHandPinky3",),
    },
    "unreal": {
        "pelvis": ("pelvis",),
        "neck": ("neck_01",),
        "left_collar": ("clavicle_l",),
        "left_shoulder": ("upperarm_l",),
        "right_hip": ("thigh_r",),
        "right_ankle": ("foot_r",),
        "right_foot": ("ball_r",),
        "left_index1": ("index_01_l",),
    },
    "vrm": {
        "spine": ("spine", "chest", "upperChest"),
        "left_shoulder": ("leftUpperArm",),
        "left_thumb1": ("leftThumbMetacarpal",),
        "left_thumb3": ("leftThumbDistal",),
        "right_pinky2": ("rightLittleIntermediate",),
    },
    "rigify": {
        "pelvis": ("DEF-spine",),
        "spine": ("DEF-spine.001", "DEF-spine.002", "DEF-spine.003"),
        "neck": ("DEF-spine.004", "DEF-spine.005"),
        "head": ("DEF-spine.006",),
        "left_shoulder": ("DEF-upper_arm.L",),
        "right_index2": ("DEF-f_index.02.R",),
    },
    "plain": {"left_collar": ("left_collar",), "left_shoulder": ("left_shoulder",), "left_foot": ("left_foot",)},
}


@pytest.mark.parametrize("rig", RIGS)
def test_names_are_guessed(rig: str):
    found = guessed(RIGS[rig])
    assert {part: found.get(part) for part in EXPECTED[rig]} == EXPECTED[rig]
    assert set(PARTS) - set(found) <= {"jaw", "left_eye", "right_eye"}


def test_every_joint_has_one_part():
    assert set(CHAINS) < set(PARTS) and set(NEEDED) <= set(PARTS) and len(PARTS) == 53


@pytest.mark.parametrize("kind", ["bvh", "glb", "gltf"])
def test_a_rig_is_read_and_guessed(tmp_path: Path, kind: str):
    document = gltf_document()
    content = {"bvh": bvh_text(), "glb": glb_bytes(document), "gltf": json.dumps(document)}[kind]
    mapping = read_mapping(with_mapping(tmp_path, f"hero.{kind}", content))
    assert mapping.joints["spine"] == ("Spine", "Spine1") and mapping.joints["left_knee"] == ("LeftLeg",)
    skeleton = read_skeleton(mapping.skeleton)
    assert skeleton.offered == tuple(name for name, _, _ in PERSON) or set(skeleton.offered) == {b[0] for b in PERSON}
    unit = 1.0 if kind == "bvh" else 0.01
    assert skeleton.places[skeleton.index("LeftHand")] == pytest.approx([72 * unit, 145 * unit, -5 * unit])


@pytest.mark.parametrize(("kind", "content"), [("bvh", bvh_text()), ("glb", glb_bytes(gltf_document()))])
def test_a_rig_without_a_mapping_file_is_guessed(tmp_path: Path, kind: str, content: str | bytes):
    stated = read_mapping(with_mapping(tmp_path, f"hero.{kind}", content))
    assert read_mapping(tmp_path / f"hero.{kind}") == stated


def test_an_fbx_in_place_of_a_mapping_file_is_refused(tmp_path: Path):
    (tmp_path / "hero.fbx").write_bytes(b"Kaydara FBX Binary")
    with pytest.raises(InputError, match=r"hero.fbx: .fbx is not read as a rig; .* Convert it to GLB"):
        read_mapping(tmp_path / "hero.fbx")


def test_what_the_file_says_comes_first(tmp_path: Path):
    table = 'spine = "Spine"\nleft_pinky1 = ""\nleft_index1 = "LeftHandPinky1"'
    joints = read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text(), table)).joints
    assert joints["spine"] == ("Spine",) and joints["left_index1"] == ("LeftHandPinky1",)
    assert "left_pinky1" not in joints and joints["left_index2"] == ("LeftHandIndex2",)


def test_what_is_written_is_read(tmp_path: Path):
    (tmp_path / "hero.bvh").write_text(bvh_text())
    joints = guess_joints(read_skeleton(tmp_path / "hero.bvh"))
    del joints["left_index3"]
    write_mapping(tmp_path / "rig.toml", RigMapping(skeleton=tmp_path / "hero.bvh", joints=joints))
    read = read_mapping(tmp_path / "rig.toml")
    assert read.joints == joints and read.skeleton == tmp_path / "hero.bvh"


def test_odd_names_are_written_so_that_they_are_read(tmp_path: Path):
    odd = 'a "b" \\ ä\t'
    bones = [(odd if n == "Hips" else n, odd if p == "Hips" else p, o) for n, p, o in PERSON]
    (tmp_path / "hero.glb").write_bytes(glb_bytes(gltf_document(bones)))
    joints = guess_joints(read_skeleton(tmp_path / "hero.glb")) | {"pelvis": (odd,)}
    write_mapping(tmp_path / "rig.toml", RigMapping(skeleton=tmp_path / "hero.glb", joints=joints))
    assert read_mapping(tmp_path / "rig.toml").joints["pelvis"] == (odd,)


def bvh(change: Callable[[str], str]) -> Callable[[Path], Path]:
    return lambda folder: with_mapping(folder, "hero.bvh", change(bvh_text()))


def table(lines: str) -> Callable[[Path], Path]:
    return lambda folder: with_mapping(folder, "hero.bvh", bvh_text(), lines)


def glb(change: Callable[[dict], object]) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        document = gltf_document()
        change(document)
        return with_mapping(folder, "hero.glb", glb_bytes(document))

    return make


def toml(text: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / "rig.toml").write_bytes(text.encode("latin-1"))
        return folder / "rig.toml"

    return make


def pipe(folder: Path) -> Path:
    path = with_mapping(folder, "other.bvh", "")
    path.write_text('skeleton = "hero.bvh"')
    os.mkfifo(folder / "hero.bvh")
    return path


MALFORMED: dict[str, tuple[Callable[[Path], Path], str]] = {
    "no file": (lambda folder: folder / "rig.toml", "cannot be read"),
    "no TOML": (toml("skeleton: hero"), "is not a TOML file"),
    "not UTF-8": (toml('skeleton = "h\xe9ro.bvh"'), "is not a TOML file"),
    "an unknown table": (toml('skeleton = "a.bvh"\n[bones]'), "bones is unknown"),
    "no skeleton": (toml("[joints]"), "skeleton is None"),
    "a skeleton that is a number": (toml("skeleton = 3"), "skeleton is 3"),
    "a rig that is not there": (toml('skeleton = "hero.glb"'), "not in its folder"),
    "joints that are no table": (lambda f: with_mapping(f, "hero.bvh", bvh_text()).rename(f / "x") and toml(
        'joints = 3\nskeleton = "hero.bvh"')(f), "joints is 3"),
    "an FBX": (lambda f: with_mapping(f, "hero.fbx", b"Kaydara FBX Binary"), "Convert it to GLB"),
    "no ending": (lambda f: with_mapping(f, "hero", b""), "no ending is not read"),
    "an unknown part": (table('elbow = "LeftForeArm"'), "'elbow' is no part of a body"),
    "an unknown joint": (table('head = "Kopf"'), "no joint 'Kopf' for head"),
    "a joint twice": (table('head = "Neck"\nneck = "Neck"'), "stands for head and for neck|for neck and for head"),
    "two joints for one part": (table('head = ["Neck", "Head"]'), "head has 2 joints"),
    "a number for a joint": (table("head = 3"), "head is 3, expected a name"),
    "a list of numbers": (table("spine = [1, 2]"), "spine is .1, 2., expected a name"),
    "a part that is needed": (table('left_elbow = ""'), "no joint stands for left_elbow .left forearm."),
    "left and right mixed up": (table('left_knee = "RightLeg"\nright_knee = "LeftLeg"'), "hang on 'LeftUpLeg'"),
    "a spine from above to below": (table('spine = ["Spine1", "Spine"]'), "does not hang on 'Spine1'"),
    "an empty BVH": (bvh(lambda text: ""), "not HIERARCHY"),
    "a BVH that ends early": (bvh(lambda text: text[: len(text) // 3]), "ends in the middle|where"),
    "a BVH with a word too much": (bvh(lambda text: text.replace("JOINT Neck", "BONE Neck")), "it has 'BONE'"),
    "a BVH whose offset is no number": (bvh(lambda text: text.replace("OFFSET 0 100 0", "OFFSET 0 a 0")), "'a'"),
    "a BVH whose offset is not finite": (bvh(lambda text: text.replace("OFFSET 0 100 0", "OFFSET 0 nan 0")), "finite"),
    "a BVH with an unknown channel": (bvh(lambda text: text.replace("Xposition", "Wposition")), "channel 'Wposition'"),
    "a BVH without known names": (bvh(lambda text: text.replace("Arm", "Qrm")), "no joint stands for left_elbow"),
    "a pipe": (pipe, "is a named pipe"),
    "a GLB that is cut off": (
        lambda f: with_mapping(f, "hero.glb", glb_bytes(gltf_document())[:200]), "is not a readable glTF 2.0 file"),
    "a GLB of version 1": (glb(lambda d: d["asset"].update(version="1.0")), "its version is '1.0'"),
    "a GLB without asset": (glb(lambda d: d.pop("asset")), "its version is None"),
    "a GLB without nodes": (glb(lambda d: d.pop("nodes")), "has no nodes"),
    "nodes in a circle": (glb(lambda d: d["nodes"][5].update(children=[2])), "child of two nodes|circle"),
    "a child that is not there": (glb(lambda d: d["nodes"][5].update(children=[999])), "does not exist"),
    "a rotation of nothing": (glb(lambda d: d["nodes"][3].update(rotation=[0, 0, 0, 0])), "not a quaternion"),
    "a transform that is not finite": (glb(lambda d: d["nodes"][3].update(translation=[0, float("inf"), 0])), "finite"),
    "a matrix of nine": (glb(lambda d: d["nodes"][3].update(matrix=[1] * 9)), "skeleton cannot be read"),
    "a skin without joints": (glb(lambda d: d["skins"][0].pop("joints")), "lacks 'joints'"),
    "two joints of a name": (glb(lambda d: d["nodes"][5].update(name="Hips")), "several joints 'Hips'"),
    "no JSON": (lambda f: with_mapping(f, "hero.gltf", "{"), "is not a readable glTF 2.0"),
    "a number beyond all numbers": (glb(lambda d: d["nodes"][3].update(translation=[10**400, 0, 0])), "too large"),
    "children that are none": (glb(lambda d: d["nodes"][3].update(children=None)), "of the wrong kind"),
    "more nodes than a character has": (glb(lambda d: d["nodes"].extend([{}] * 5000)), "nodes, expected at most 4096"),
    "a GLB of a few bytes": (lambda f: with_mapping(f, "hero.glb", b"glTF and"), "it is cut off"),
    "a VRM without bones": (glb(lambda d: d.update(extensions={"VRMC_vrm": {}})), "lacks 'humanoid'"),
    "a BVH with a brace too few": (bvh(lambda text: text.replace("{", "", 1)), "'OFFSET' where '{'"),
    "TOML nested without end": (toml('skeleton = "a.bvh"\nx = ' + "[" * 20000), "is not a TOML file"),
    "a number of 5000 digits": (toml('skeleton = "a.bvh"\nx = ' + "9" * 5000), "is not a TOML file"),
    "a name of 5000 letters": (toml(f'skeleton = "{"a" * 5000}.bvh"'), "not in its folder"),
    "JSON that is no object": (lambda f: with_mapping(f, "hero.gltf", "[]"), "not an object"),
}  # fmt: skip


@pytest.mark.parametrize("name", MALFORMED)
def test_what_cannot_be_used_is_refused(tmp_path: Path, name: str):
    make, says = MALFORMED[name]
    with pytest.raises(InputError, match=says) as error:
        read_mapping(make(tmp_path))
    assert str(tmp_path) in str(error.value)


def test_a_rig_elsewhere_is_not_written_about(tmp_path: Path):
    (tmp_path / "a").mkdir()
    (tmp_path / "hero.bvh").write_text(bvh_text())
    with pytest.raises(InputError, match="is not in its folder"):
        write_mapping(tmp_path / "a" / "rig.toml", RigMapping(skeleton=tmp_path / "hero.bvh", joints={}))
    assert not list((tmp_path / "a").iterdir())


def test_scales_that_differ_by_axis_are_refused(tmp_path: Path):
    document = gltf_document()
    document["nodes"][0]["scale"] = [0.01, 0.02, 0.01]
    (tmp_path / "hero.glb").write_bytes(glb_bytes(document))
    with pytest.raises(InputError, match="Apply the scale"):
        read_skeleton(tmp_path / "hero.glb").turns([3])


# --- odd, and right ---


def test_a_mesh_may_have_a_bone_s_name_and_a_prop_any_scale(tmp_path: Path):
    document = gltf_document()
    for prop in ({"name": "Head"}, {"name": "Ground", "scale": [9, 1, 9]}, {"name": "Hidden", "scale": [0, 0, 0]}):
        document["scenes"][0]["nodes"].append(len(document["nodes"]))
        document["nodes"].append(prop)
    mapping = read_mapping(with_mapping(tmp_path, "hero.glb", glb_bytes(document)))
    skeleton = read_skeleton(mapping.skeleton)
    assert mapping.joints["head"] == ("Head",)
    assert skeleton.places[skeleton.index("Head"), 1] == pytest.approx(1.6)
    assert skeleton.turns(map(skeleton.index, skeleton.offered)) == pytest.approx(
        np.tile(np.eye(3), (len(skeleton), 1, 1))
    )


def test_hips_that_no_vertex_follows_are_found(tmp_path: Path):
    document = gltf_document()
    document["skins"][0]["joints"].remove(1)
    mapping = read_mapping(with_mapping(tmp_path, "hero.glb", glb_bytes(document)))
    assert mapping.joints["pelvis"] == ("Hips",)
    assert "Armature" not in read_skeleton(mapping.skeleton).offered


@pytest.mark.parametrize("version", ["0", "1.0"])
def test_a_vrm_says_itself_what_its_bones_are(tmp_path: Path, version: str):
    document = gltf_document()
    vrm = {"Hips": "hips", "Spine": "spine", "Spine1": "chest", "Neck": "neck", "Head": "head"}
    for side in ("Left", "Right"):
        own = {"Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand", "UpLeg": "UpperLeg", "Leg": "LowerLeg"}
        vrm |= {f"{side}{name}": f"{side.lower()}{bone}" for name, bone in (own | {"Foot": "Foot"}).items()}
    nodes = {vrm[node["name"]]: n for n, node in enumerate(document["nodes"]) if node["name"] in vrm}
    for n, node in enumerate(document["nodes"]):
        node["name"] = f"骨{n}"
    if version == "0":
        bones = [{"bone": bone, "node": n} for bone, n in reversed(nodes.items())]
        document["extensions"] = {"VRM": {"humanoid": {"humanBones": bones}}}
    else:
        bones = {bone: {"node": n} for bone, n in reversed(nodes.items())}
        document["extensions"] = {"VRMC_vrm": {"humanoid": {"humanBones": bones}}}
    joints = read_mapping(with_mapping(tmp_path, "hero.vrm", glb_bytes(document))).joints
    assert joints["spine"] == (f"骨{nodes['spine']}", f"骨{nodes['chest']}")
    assert joints["left_shoulder"] == (f"骨{nodes['leftUpperArm']}",)
    assert len(joints) == len(vrm) - 1


def test_blanks_in_a_bvh_s_names_and_marks_of_windows_are_read(tmp_path: Path):
    text = bvh_text().replace("UpLeg", " Up Leg").replace("Zrotation", "ZROTATION").replace("\n", "\r\n")
    path = with_mapping(tmp_path, "hero.bvh", ("\ufeff" + text).encode())
    path.write_text(path.read_text(), encoding="utf-8-sig")
    assert read_mapping(path).joints["left_hip"] == ("Left Up Leg",)
