"""The user's own rig: turned from rest to rest, feet on its floor, hands where they touch; read from files again."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pygltflib
import pytest
from scipy.spatial.transform import Rotation

from fitting_core.animation.retargeting.retarget import Posed, RigMotion, turned
from fitting_core.animation.retargeting.touch import gaps, touches
from fitting_core.animation.rigs.known_rigs import MIXAMO
from fitting_core.animation.rigs.own_rig import on_own
from fitting_core.body.geometry import SIDES
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.errors import InputError
from fitting_core.io.motion.rigs.mapping_file import RigMapping, read_mapping, read_skeleton
from fitting_core.io.motion.rigs.own_files import write_own_bvh, write_own_glb
from fitting_core.io.motion.rigs.rig_glb import write_standard_glb
from fitting_core.motion import Motion
from tests.fitting_core.io.motion.motions import swinging
from tests.fitting_core.io.motion.rigs.acts import touching_hands, weight_shifting
from tests.fitting_core.io.motion.rigs.readers import Bvh, glb_joints
from tests.fitting_core.io.motion.rigs.rig_files import PERSON, bvh_text, glb_bytes, gltf_document, with_mapping


def moved_by(motion: Motion, mapping: RigMapping) -> RigMotion:
    return on_own(motion, read_skeleton(mapping.skeleton), mapping.joints)


@pytest.fixture(scope="module")
def upright(free_body: BodyModel) -> Motion:
    return swinging(free_body).in_axes("y-up")


@pytest.fixture(scope="module")
def swaying(free_body: BodyModel) -> Motion:
    return weight_shifting(free_body)


def z_up() -> list:
    """The rig with z up, looking along -y, as Blender has it."""
    return [(name, above, (x, -z, y)) for name, above, (x, y, z) in PERSON]


def long_trunk() -> list:
    """The rig with a spine of five and a neck of two joints."""
    parts = [("Spine", "Hips", (0, 8, -1))]
    parts += [(f"Spine{k}", f"Spine{k - 1}" if k > 1 else "Spine", (0, 8, 0)) for k in range(1, 5)]
    parts += [("Neck", "Spine4", (0, 20, 1)), ("Neck1", "Neck", (0, 5, 0)), ("Head", "Neck1", (0, 5, 1))]
    rest = [bone for bone in PERSON if bone[0] not in ("Spine", "Spine1", "Neck", "Head", "Hips")]
    return [PERSON[0], *parts, *((n, "Spine4" if p == "Spine1" else p, o) for n, p, o in rest)]


def turned_bones(*names: str, by: float) -> list:
    """The rig with some bones turned about z, in degrees: what they carry goes with them."""
    turn = Rotation.from_euler("z", by, degrees=True)
    return [(n, above, tuple(turn.apply(offset)) if above in names else offset) for n, above, offset in PERSON]


@pytest.mark.parametrize(
    ("bones", "says"),
    [
        (turned_bones("LeftUpLeg", "LeftLeg", by=90), r"left_hip \(.*\) points [89]\d degrees off down"),
        (turned_bones("RightLeg", by=-60), r"right_knee \(.*\) points [56]\d degrees off down"),
        (
            turned_bones("RightArm", "RightForeArm", by=180),
            r"right_shoulder \(.*\) points 1\d\d degrees off outward",
        ),
    ],
)
def test_a_rig_that_does_not_stand_at_rest_is_refused(upright: Motion, tmp_path: Path, bones: list, says: str):
    """As files of motion capture that have every bone along one axis, and all of the pose in their motion."""
    with pytest.raises(InputError, match=says + ".*T pose, an A pose"):
        moved_by(upright, read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text(bones))))


@pytest.mark.parametrize("by", [-40, -85, 60])
def test_arms_may_be_in_any_pose_of_a_body_that_stands(upright: Motion, tmp_path: Path, by: float):
    bones = turned_bones("LeftArm", "LeftForeArm", by=by)
    moved_by(upright, read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text(bones))))


# --- joints ---


@pytest.mark.parametrize("frame", [0, 3, 6])
def test_a_rig_of_the_person_s_own_lengths_is_where_the_fit_is(upright: Motion, tmp_path: Path, frame: int):
    """What the Mixamo export writes, taken as the user's own rig: read, guessed, and its joints as in the fit."""
    write_standard_glb(tmp_path / "hero.glb", upright, MIXAMO)
    (tmp_path / "rig.toml").write_text('skeleton = "hero.glb"')
    write_own_glb(tmp_path / "out.glb", upright, tmp_path / "rig.toml")
    found = glb_joints(tmp_path / "out.glb", frame / upright.frame_rate)
    posed = Posed.of(upright).places[frame]
    moving = moved_by(upright, read_mapping(tmp_path / "rig.toml"))
    assert moving.target.scale == pytest.approx(1, abs=1e-6)
    sunk = found["mixamorig:Hips"][:3, 3] - posed[0]  # without a known floor, the lowest sole is put onto 0
    for name, joint in (("LeftArm", "left_shoulder"), ("RightHand", "right_wrist"), ("LeftLeg", "left_knee"),
                        ("RightToeBase", "right_foot"), ("Head", "head"), ("LeftHandRing2", "left_ring2")):  # fmt: skip
        assert np.linalg.norm(found[f"mixamorig:{name}"][:3, 3] - sunk - posed[JOINT[joint]]) < 1e-3, name
    assert np.allclose(sunk[[0, 2]], 0, atol=1e-3)


def test_files_hold_what_was_put_on_the_rig(swaying: Motion, tmp_path: Path):
    table = with_mapping(tmp_path, "hero.glb", glb_bytes(gltf_document()))
    moving = moved_by(swaying, read_mapping(table))
    write_own_glb(tmp_path / "out.glb", swaying, table)
    write_own_bvh(tmp_path / "out.bvh", swaying, table)
    bvh = Bvh.of(tmp_path / "out.bvh")
    assert bvh.names[0] == "Hips" and set(bvh.names) == {name for name, _, _ in PERSON}
    for frame in (0, 13, 35):
        in_glb, in_bvh = glb_joints(tmp_path / "out.glb", frame / 30), bvh.joints(frame)
        for k, name in enumerate(moving.target.names):
            if name != "Armature":
                assert np.allclose(in_glb[name][:3, 3], moving.places[frame, k], atol=1e-5), name
                assert np.allclose(in_bvh[name][:3, 3], moving.places[frame, k], atol=1e-5), name


def test_an_armature_that_is_turned_changes_nothing(swaying: Motion, tmp_path: Path):
    """As Blender exports what has z up: bones with z up below an armature that turns them upright."""
    document = gltf_document(z_up())
    document["nodes"][0]["rotation"] = Rotation.from_euler("x", -90, degrees=True).as_quat().tolist()
    (tmp_path / "z").mkdir()
    for folder, rig in ((tmp_path, gltf_document()), (tmp_path / "z", document)):
        write_own_glb(folder / "out.glb", swaying, with_mapping(folder, "hero.glb", glb_bytes(rig)))
    straight, below_armature = glb_joints(tmp_path / "out.glb", 0.3), glb_joints(tmp_path / "z" / "out.glb", 0.3)
    for name in ("Hips", "LeftHand", "RightToeBase", "Head"):
        assert np.allclose(straight[name][:3, 3], below_armature[name][:3, 3], atol=1e-5), name


def test_a_bvh_keeps_its_unit_and_a_z_up_rig_its_axes(swaying: Motion, tmp_path: Path):
    (tmp_path / "z").mkdir()
    for folder, bones in ((tmp_path, PERSON), (tmp_path / "z", z_up())):
        write_own_bvh(folder / "out.bvh", swaying, with_mapping(folder, "hero.bvh", bvh_text(bones)))
    straight, turned_up = Bvh.of(tmp_path / "out.bvh").joints(9), Bvh.of(tmp_path / "z" / "out.bvh").joints(9)
    for name in ("Hips", "LeftHand", "RightToeBase", "Head"):
        x, y, z = straight[name][:3, 3]
        assert np.allclose(turned_up[name][:3, 3], (x, -z, y), atol=1e-3)
    assert 80 < straight["Hips"][1, 3] < 105, "centimetres"


def test_bones_keep_the_rig_s_lengths_and_take_the_fit_s_directions(swaying: Motion, tmp_path: Path):
    mapping = read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text()))
    moving, posed = moved_by(swaying, mapping), Posed.of(swaying)
    for side, names in (("left", ("LeftArm", "LeftForeArm", "LeftHand")), ("right", ("RightUpLeg", "RightLeg"))):
        k = [moving.target.names.index(name) for name in names]
        joints = ("shoulder", "elbow", "wrist") if side == "left" else ("hip", "knee")
        for (a, b), (p, q) in zip(pairwise(k), pairwise(joints), strict=True):
            bone = moving.places[:, b] - moving.places[:, a]
            rest = moving.target.places[b] - moving.target.places[a]
            assert np.allclose(np.linalg.norm(bone, axis=1), np.linalg.norm(rest))
            own = posed.places[:, JOINT[f"{side}_{q}"]] - posed.places[:, JOINT[f"{side}_{p}"]]
            cosine = (bone * own).sum(1) / np.linalg.norm(bone, axis=1) / np.linalg.norm(own, axis=1)
            # Arms are not adapted where nothing touches; legs by what brings the feet onto the floor.
            assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < (0.01 if side == "left" else 12)


def test_a_longer_trunk_carries_the_chest_and_the_head_as_the_fit_does(upright: Motion, tmp_path: Path):
    short = read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text()))
    (tmp_path / "long").mkdir()
    long = read_mapping(with_mapping(tmp_path / "long", "hero.bvh", bvh_text(long_trunk())))
    assert len(long.joints["spine"]) == 5 and long.joints["neck"] == ("Neck", "Neck1")
    turns = {}
    for name, mapping, last in (("short", short, "Spine1"), ("long", long, "Spine4")):
        moving = moved_by(upright, mapping)
        turns[name] = moving.moved[:, [moving.target.names.index(n) for n in (last, "Head", "Spine")]]
    assert np.allclose(turns["short"][:, :2], turns["long"][:, :2], atol=1e-9)
    angles = [Rotation.from_matrix(turns[n][:, 2].swapaxes(1, 2) @ turns[n][:, 0]).magnitude() for n in turns]
    assert (angles[1] > angles[0]).all(), "the first of five has turned less of the way than the first of two"


# --- feet ---


@pytest.mark.parametrize("shape", ["long legs", "short thighs", "wide hips"])
def test_standing_feet_slide_in_proportion_and_stay_on_the_floor(swaying: Motion, tmp_path: Path, shape: str):
    def changed(name: str, offset: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = offset
        if shape == "wide hips" and name.endswith("UpLeg"):
            return (2 * x, y, z)
        if shape == "short thighs" and name in ("LeftLeg", "RightLeg"):
            return (x, 0.7 * y, z)
        return (x, 1.5 * y, z) if shape == "long legs" and name.endswith(("Leg", "Foot")) else offset

    bones = [(name, above, changed(name, offset)) for name, above, offset in PERSON]
    moving = moved_by(swaying, read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text(bones))))
    target, posed = moving.target, Posed.of(swaying)
    assert swaying.contacts is not None
    for f, side in enumerate(SIDES):
        standing = swaying.contacts.standing[:, f]
        for joint in ("foot", "ankle"):
            k = target.of_joint[f"{side}_{joint}"]
            rig = moving.places[standing, k] / target.scale
            fit = posed.places[standing, JOINT[f"{side}_{joint}"]]
            slid, slid_in_fit = (np.linalg.norm(np.diff(p[:, [0, 2]], axis=0), axis=1).sum() for p in (rig, fit))
            assert slid <= slid_in_fit * (1.001 if joint == "foot" else 1.2) + 1e-6
        toes = moving.places[standing, target.of_joint[f"{side}_foot"], 1]
        rest = target.places[target.of_joint[f"{side}_foot"], 1] - target.floor
        fit_height = posed.places[standing, JOINT[f"{side}_foot"], 1]
        assert np.allclose(toes - rest, target.scale * (fit_height - fit_height.min()), atol=2e-3 * target.scale)


def test_without_the_feet_s_goals_they_would_slide(swaying: Motion, tmp_path: Path):
    mapping = read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text()))
    alone = turned(Posed.of(swaying), moved_by(swaying, mapping).target)
    k = alone.target.of_joint["left_foot"]
    fit = Posed.of(swaying).places[:, JOINT["left_foot"]]
    assert np.ptp(alone.places[:, k, 2]) / alone.target.scale > np.ptp(fit[:, 2]) + 0.01


# --- hands ---


@pytest.fixture(scope="module")
def clasped(free_body: BodyModel) -> Motion:
    return touching_hands(free_body)


def apart(moving: RigMotion, motion: Motion, side: str) -> np.ndarray:
    """How far the points of a hand that touch are from where they should, metres of the person."""
    touch = touches(motion)[side]
    way = (gaps(moving, Posed.of(motion), side, touch, motion.body.parents) * touch.counts[..., None]).sum(1)
    return np.linalg.norm(way, axis=1) / moving.target.scale


@pytest.mark.parametrize("side", SIDES)
def test_hands_that_touch_in_the_fit_touch_on_the_rig(clasped: Motion, tmp_path: Path, side: str):
    mapping = read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text()))
    moving, touch = moved_by(clasped, mapping), touches(clasped)[side]
    together = touch.share == 1.0
    assert 9 <= together.sum() <= 12 and touch.distance[together].max() < 0.01
    before = apart(turned(Posed.of(clasped), moving.target), clasped, side)[together]
    after = apart(moving, clasped, side)[together]
    assert before.min() > 0.02 and after.max() < 0.005 and np.median(after) < 0.001


def test_hands_that_do_not_touch_are_left_alone(clasped: Motion, tmp_path: Path):
    mapping = read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text()))
    moving = moved_by(clasped, mapping)
    plain = turned(Posed.of(clasped), moving.target)
    far = [0, 1, 2, 27, 28, 29]
    arms = [moving.target.of_joint[f"{side}_{j}"] for side in SIDES for j in ("shoulder", "elbow", "wrist")]
    assert np.allclose(moving.moved[far][:, arms], plain.moved[far][:, arms], atol=1e-6)


def test_it_comes_and_goes_evenly(clasped: Motion, tmp_path: Path):
    """No wrist jumps: its second differences stay near those of the arms that nothing was done to."""
    mapping = read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text()))
    moving = moved_by(clasped, mapping)
    k = moving.target.of_joint["left_wrist"]
    plain = turned(Posed.of(clasped), moving.target).places[:, k]
    moved = moving.places[:, k] - plain
    assert np.linalg.norm(np.diff(moved, axis=0), axis=1).max() / moving.target.scale < 0.012


# --- what cannot be ---


def test_a_bvh_has_no_surface(upright: Motion, tmp_path: Path):
    with pytest.raises(InputError, match="is a BVH, which has no surface"):
        write_own_glb(tmp_path / "x.glb", upright, with_mapping(tmp_path, "hero.bvh", bvh_text()))
    assert not (tmp_path / "x.glb").exists()


def test_a_rig_that_lies_is_refused(upright: Motion, tmp_path: Path):
    flat = [(name, above, (0.0, 0.0, 0.0)) for name, above, _ in PERSON]
    with pytest.raises(InputError, match="rest pose must be standing"):
        moved_by(upright, read_mapping(with_mapping(tmp_path, "hero.bvh", bvh_text(flat))))


@pytest.mark.parametrize("bone", ["LeftLeg", "RightHand"])
def test_a_limb_without_length_is_refused(upright: Motion, tmp_path: Path, bone: str):
    bones = [(name, above, (0, 0, 0) if name == bone else offset) for name, above, offset in PERSON]
    path = with_mapping(tmp_path, "hero.glb", glb_bytes(gltf_document(bones)))
    with pytest.raises(InputError, match="are in one place"):
        write_own_glb(tmp_path / "out.glb", upright, path)
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize("offset", [(10, 0, 0), (0, 0, 0)])
def test_fingers_in_one_place_do_not_turn_the_hand(
    upright: Motion, tmp_path: Path, offset: tuple[float, float, float], recwarn: pytest.WarningsRecorder
):
    bare = [bone for bone in PERSON if not bone[0].startswith("LeftHand") or bone[0] == "LeftHand"]
    odd = [*bare, *((f"LeftHand{finger}1", "LeftHand", offset) for finger in ("Index", "Pinky", "Ring"))]
    found = []
    for name, bones in (("bare", bare), ("odd", odd)):
        mapping = read_mapping(with_mapping(tmp_path, f"{name}.bvh", bvh_text(bones)))
        moving = moved_by(upright, mapping)
        found.append(moving.moved[:, moving.target.of_joint["left_wrist"]])
    assert found[0] == pytest.approx(found[1], abs=1e-9)
    assert not recwarn.list


def test_a_chain_of_a_thousand_joints_is_written(upright: Motion, tmp_path: Path):
    tail = [("Tail0", "Hips", (0, 0, -1)), *((f"Tail{k}", f"Tail{k - 1}", (0, 0, -1)) for k in range(1, 1200))]
    path = with_mapping(tmp_path, "hero.glb", glb_bytes(gltf_document([*PERSON, *tail])))
    write_own_bvh(tmp_path / "out.bvh", upright[:2], path)
    written = Bvh.of(tmp_path / "out.bvh")
    assert written.parents[written.names.index("Tail1199")] == written.names.index("Tail1198")
    assert written.offsets[written.names.index("Tail1199")] == pytest.approx([0, 0, -0.01])


def test_data_that_meshopt_has_compressed_is_refused(upright: Motion, tmp_path: Path):
    document = gltf_document() | {"extensionsUsed": ["EXT_meshopt_compression"]}
    with pytest.raises(InputError, match="compressed by EXT_meshopt_compression"):
        write_own_glb(tmp_path / "out.glb", upright, with_mapping(tmp_path, "hero.glb", glb_bytes(document)))


def test_images_beside_a_gltf_keep_their_kind(upright: Motion, tmp_path: Path):
    kinds = {"a.webp": b"RIFF....WEBP", "b.png": b"\x89PNG", "c.jpg": b"\xff\xd8", "d.ktx2": b"\xabKTX 20\xbb"}
    for name, content in kinds.items():
        (tmp_path / name).write_bytes(content)
    document = gltf_document() | {"images": [{"uri": name} for name in kinds]}
    write_own_glb(tmp_path / "out.glb", upright, with_mapping(tmp_path, "hero.gltf", json.dumps(document)))
    written = pygltflib.GLTF2().load_binary(str(tmp_path / "out.glb"))
    assert written is not None
    assert [i.mimeType for i in written.images] == ["image/webp", "image/png", "image/jpeg", "image/ktx2"]


def test_a_glb_keeps_what_is_in_it(upright: Motion, tmp_path: Path):
    document = gltf_document()
    document |= {"animations": [{"name": "idle", "samplers": [], "channels": []}], "materials": [{"name": "skin"}]}
    document["nodes"][3] |= {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 16, -2, 1]}
    del document["nodes"][3]["translation"]
    write_own_glb(tmp_path / "out.glb", upright, with_mapping(tmp_path, "hero.glb", glb_bytes(document)))
    written = pygltflib.GLTF2().load(str(tmp_path / "out.glb"))
    assert [animation.name for animation in written.animations] == ["swing", "idle"]
    assert written.materials[0].name == "skin" and written.nodes[3].translation == [0, 16, -2]
    assert written.asset.extras["rig"] == "hero.glb" and written.asset.extras["frame_rate"] == 29.97


def test_one_shape_and_a_rest_pose_of_its_own(free_body: BodyModel, tmp_path: Path):
    """A rig that stands in an A pose gets the same bones' directions as one in a T pose."""
    turn = {side: Rotation.from_euler("z", angle, degrees=True) for side, angle in (("Left", -40), ("Right", 40))}

    def lowered(name: str, offset: tuple[float, float, float]) -> tuple[float, float, float]:
        side = next((s for s in turn if name.startswith(s)), None)
        below = any(part in name for part in ("ForeArm", "Hand"))
        return tuple(turn[side].apply(offset)) if side is not None and below else offset

    bones = [(name, above, lowered(name, offset)) for name, above, offset in PERSON]
    motion = touching_hands(free_body, 6)
    far = replace(motion, params=motion.params[:1])
    found = []
    for folder, rig in (("t", PERSON), ("a", bones)):
        (tmp_path / folder).mkdir()
        mapping = read_mapping(with_mapping(tmp_path / folder, "hero.bvh", bvh_text(rig)))
        moving = moved_by(far, mapping)
        found.append(moving.places[0] - moving.root[0])
    assert np.allclose(found[0], found[1], atol=0.3), "centimetres"
