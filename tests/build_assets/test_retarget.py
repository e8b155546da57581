"""Retargeting: what must be as in the source, what must be as in the body, and what must be left out."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.mocap import SourceMotion, read_motions
from build_assets.motion_capture.retarget import load, mirrored, plausible, retarget
from build_assets.motion_capture.rigs import RIGS, SIDES
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.errors import InputError
from tests.build_assets.captured import (
    cmu_channels,
    deepmimic_frames,
    euler,
    random_deepmimic,
    write_cmu,
    write_deepmimic,
)

SIGNS = list(SIDES.items())
CMU_HINGE = np.array(RIGS["cmu"].arm.hinge) / np.linalg.norm(RIGS["cmu"].arm.hinge)


def joint(pose: Float[np.ndarray, "T 63"], name: str) -> Float[np.ndarray, "T 3"]:
    return pose.reshape(len(pose), 21, 3)[:, JOINT[name] - 1]


def posed(body: BodyModel, pose: np.ndarray, root: np.ndarray | None = None) -> Float[np.ndarray, "T 55 3"]:
    params = vars(BodyParams.neutral(len(pose)))
    orient = np.zeros((len(pose), 3)) if root is None else Rotation.from_matrix(root).as_rotvec()
    params |= {"body_pose": torch.as_tensor(pose), "global_orient": torch.as_tensor(orient)}
    return Mesh(body, dtype=torch.float64).joints(BodyParams(**params)).numpy()


def direction(points: np.ndarray, start: int, end: int) -> np.ndarray:
    bone = points[:, end] - points[:, start]
    return bone / np.linalg.norm(bone, axis=1, keepdims=True)


@pytest.fixture
def random_motion(tmp_path: Path) -> SourceMotion:
    (motion,) = read_motions(write_deepmimic(tmp_path, {"any": random_deepmimic(np.random.default_rng(1), 40)}))
    return motion


@pytest.mark.parametrize("side", SIDES)
def test_arms_and_thighs_point_where_the_source_points(free_body: BodyModel, random_motion: SourceMotion, side: str):
    """Whatever the collars do: the whole chain, through spine and collar, ends in the source's directions."""
    body = posed(free_body, retarget(random_motion), random_motion.world("root"))
    index = random_motion.skeleton.index
    for bone, largest in ((("shoulder", "elbow"), 0.3), (("elbow", "wrist"), 0.3), (("hip", "knee"), 0.5)):
        ours = direction(body, *(JOINT[f"{side}_{name}"] for name in bone))
        theirs = direction(random_motion.positions, *(index(f"{side}_{name}") for name in bone))
        angle = np.degrees(np.arccos(np.clip((ours * theirs).sum(1), -1, 1)))
        assert angle.max() < largest, bone


@pytest.mark.parametrize("side, sign", SIGNS)
def test_hinges_bend_about_their_own_axes_alone(random_motion: SourceMotion, side: str, sign: float):
    pose = retarget(random_motion)
    elbow, knee = joint(pose, f"{side}_elbow"), joint(pose, f"{side}_knee")
    assert (elbow[:, 1] * sign < -0.09).all() and (knee[:, 0] > 0.09).all()
    assert abs(elbow[:, [0, 2]]).max() < 1e-9 and abs(knee[:, 1:]).max() < 1e-9


def test_head_chest_and_feet_turn_as_in_the_source(random_motion: SourceMotion):
    pose = Rotation.from_rotvec(retarget(random_motion).reshape(-1, 3)).as_matrix().reshape(-1, 21, 3, 3)
    local = dict(zip(list(JOINT)[1:22], np.moveaxis(pose, 1, 0), strict=True))
    chest = random_motion.world("root") @ local["spine1"] @ local["spine2"] @ local["spine3"]
    foot = random_motion.world("root") @ local["left_hip"] @ local["left_knee"] @ local["left_ankle"]
    np.testing.assert_allclose(chest, random_motion.world("chest"), atol=1e-9)
    np.testing.assert_allclose(chest @ local["neck"] @ local["head"], random_motion.world("neck"), atol=1e-9)
    np.testing.assert_allclose(foot, random_motion.world("left_ankle"), atol=1e-9)


def test_the_t_pose_stays_one(tmp_path: Path):
    (motion,) = read_motions(write_cmu(tmp_path, {"07_01": cmu_channels()}))
    pose = retarget(motion)
    # Upper arms and thighs of the two figures rest up to 4 degrees apart, arms and hands are rolled against each other.
    for name in ("spine2", "head", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_hip", "left_collar"):
        assert np.degrees(np.linalg.norm(joint(pose, name), axis=1)).max() < 4, name
    hand = np.eye(3)
    for name in ("left_collar", "left_shoulder", "left_elbow", "left_wrist"):
        hand = hand @ Rotation.from_rotvec(joint(pose, name)[0]).as_matrix()
    assert np.degrees(Rotation.from_matrix(hand).magnitude()) < 5, "the palm faces down"


@pytest.mark.parametrize("bend", [70.0, -70.0])
def test_cmu_elbows_bend_forward_even_where_the_clip_bends_them_backward(tmp_path: Path, bend: float):
    turn = Rotation.from_rotvec(np.radians(bend) * CMU_HINGE)
    (motion,) = read_motions(write_cmu(tmp_path, {"13_18": cmu_channels({"lForeArm": euler(turn)})}))
    pose = retarget(motion)
    elbow = Rotation.from_rotvec(joint(pose, "left_elbow")[0])
    untwisted = elbow * Rotation.from_euler("x", 15, degrees=True).inv()
    np.testing.assert_allclose(np.degrees(untwisted.as_rotvec()), [0, -70, 0], atol=1e-6)


def still(frames: int = 6) -> Float[np.ndarray, "T 63"]:
    pose = np.zeros((frames, 63))
    for side, sign in SIGNS:
        joint(pose, f"{side}_shoulder")[:] = [0, 0, -1.1 * sign]
        joint(pose, f"{side}_elbow")[:] = [0, -0.6 * sign, 0]
    return pose


@pytest.mark.parametrize(
    "name, rotation",
    [
        ("left_elbow", [0, 0.5, 0]),
        ("right_elbow", [0, -0.5, 0]),
        ("left_knee", [-0.4, 0, 0]),
        ("left_wrist", [1.0, 0, 0]),
        ("right_ankle", [0, 1.4, 0]),
        ("left_shoulder", [2.5, 0, 0]),
        ("spine1", [0.7, 0, 0]),
    ],
)
def test_what_no_body_can_do_is_dropped(name: str, rotation: list[float]):
    pose = still()
    joint(pose, name)[:] = rotation
    assert not plausible(pose, 30).any()
    assert not plausible(mirrored(pose), 30).any()


def test_frames_beside_a_jump_are_dropped():
    pose = still()
    joint(pose, "left_hip")[3:] = [-1.3, 0, 0]
    assert plausible(pose, 30).tolist() == [True, True, False, False, True, True]
    assert plausible(pose, 10).all(), "in a tenth of a second a leg gets there"


def test_load_leaves_out_what_is_wrong_or_there_twice(tmp_path: Path):
    good, twisted = deepmimic_frames(frames=5), deepmimic_frames({"left_ankle": [0, 0, 1, 0]}, frames=5)
    write_deepmimic(tmp_path, {"a": good, "b": good, "c": twisted, "d": np.concatenate([good, twisted[:1]])})
    clips = load(tmp_path)
    assert [(clip.name, len(clip.body_pose), clip.dropped) for clip in clips] == [("a", 5, 0), ("d", 4, 2)]
    assert clips[0].body_pose.dtype == np.float64
    write_deepmimic(tmp_path / "bad", {"c": twisted})
    with pytest.raises(InputError, match="none of its frames"):
        load(tmp_path / "bad")


def test_real_motion_capture(shared_data: Path, tmp_path: Path):
    """A walk, boxing with backward elbows, and floor poses: elbows bend forward, hinges alone, nothing turns wildly."""
    source = shared_data / "mocap"
    if not source.is_dir():
        pytest.skip(f"there is no motion capture at {source}")
    for file in ("skeleton.json", "manifest.csv", "clips/07_01.npz", "clips/13_18.npz"):
        (tmp_path / "cmu" / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source / "cmu" / file, tmp_path / "cmu" / file)
    (tmp_path / "deepmimic").mkdir()
    shutil.copy(source / "deepmimic" / "humanoid3d_crawl.txt", tmp_path / "deepmimic")
    clips = {clip.name: clip for clip in load(tmp_path)}
    assert set(clips) == {"07_01", "13_18", "crawl"}
    assert len(clips["07_01"].body_pose) == 79 and clips["07_01"].dropped == 0
    for clip in clips.values():
        assert np.isfinite(clip.body_pose).all() and len(clip.body_pose) > 70
        for side, sign in SIGNS:
            assert np.median(joint(clip.body_pose, f"{side}_elbow")[:, 1]) * sign < -0.2
            assert np.median(joint(clip.body_pose, f"{side}_knee")[:, 0]) > 0.1
    walk = clips["07_01"].body_pose
    # A walker's arms hang; his thighs swing against each other.
    arm = Rotation.from_rotvec(joint(walk, "left_collar")) * Rotation.from_rotvec(joint(walk, "left_shoulder"))
    assert arm.apply([1, 0, 0])[:, 1].max() < -0.8
    assert np.corrcoef(joint(walk, "left_hip")[:, 0], joint(walk, "right_hip")[:, 0])[0, 1] < -0.5
