"""BVH, OBJ, PLY and animation npz: what is read back is the fit."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.io.motion.animation_npz import write_animation_npz
from fitting_core.io.motion.bvh import continuous_euler, write_bvh
from fitting_core.io.motion.mesh_sequence import file_stem, write_obj_sequence
from fitting_core.motion import AXES, Motion
from tests.fitting_core.io.motion.motions import meshes, swinging
from tests.fitting_core.io.motion.rig_players import Bvh


def played(bvh: Bvh) -> np.ndarray:
    """Places of JOINTS, (T, 55, 3)."""
    frames = [bvh.joints(t) for t in range(len(bvh.frames))]
    return np.array([[frame[name][:3, 3] for name in JOINTS] for frame in frames])


@pytest.mark.parametrize("axes", AXES)
def test_bvh_gives_the_joints_back(tiny_body: BodyModel, tmp_path: Path, axes: str):
    motion = still_face(swinging(tiny_body)).in_axes(axes)
    write_bvh(tmp_path / "x.bvh", motion)
    bvh = Bvh.of(tmp_path / "x.bvh")
    assert sorted(bvh.names) == sorted(JOINTS) and bvh.frame_time == pytest.approx(1 / 29.97, abs=1e-8)
    assert np.allclose(played(bvh), motion.joints(), atol=1e-5)


def still_face(motion: Motion) -> Motion:
    """Without expression, which moves the tiny body's joints and has no place in BVH."""
    return replace(motion, params=replace(motion.params, expression=torch.zeros_like(motion.params.expression)))


@pytest.mark.parametrize("about", [(0.3, 1.5, 0.4), (1.0, 0.0, 0.0)])
def test_angles_do_not_jump(about: tuple[float, float, float]):
    """Full turns; about X, the angle in the middle, past 90 degrees, where the usual triple flips the other two."""
    t = np.linspace(0, 6, 200)
    pose = (np.array(about) * t[:, None])[:, None]
    angles = continuous_euler(pose)
    assert abs(np.diff(angles, axis=0)).max() < 60
    again = Rotation.from_euler("ZXY", angles[:, 0], degrees=True)
    assert (again.inv() * Rotation.from_rotvec(pose[:, 0])).magnitude().max() < 1e-9


def test_sequence_of_meshes(free_body: BodyModel, tmp_path: Path):
    motion, shares = swinging(free_body, 3).in_axes("y-up"), []
    write_obj_sequence(tmp_path, motion, shares.append)
    expected = meshes(motion)
    for t in range(3):
        read = trimesh.load(tmp_path / f"swing_{12 + t:06d}.obj", process=False)
        assert np.array_equal(read.faces, free_body.faces)
        assert np.allclose(read.vertices, expected[t], atol=1e-6)
    assert len(list(tmp_path.iterdir())) == 4 and shares == [1 / 3, 2 / 3, 1.0]
    said = json.loads((tmp_path / "motion.json").read_text())
    assert np.allclose(said["translation"], motion.params.camera_translation, atol=1e-9)
    head = (tmp_path / "swing_000012.obj").read_bytes()[:900].decode("ascii", "replace")
    for word in ("29.97", "y up", "910.0", "neutral", "translation"):
        assert word in head


@pytest.mark.parametrize("axes", AXES)
def test_npz_poses_the_mesh(free_body: BodyModel, tmp_path: Path, axes: str):
    motion = swinging(free_body, 3)
    write_animation_npz(tmp_path / "x.npz", motion.in_axes(axes))
    with np.load(tmp_path / "x.npz", allow_pickle=False) as read:
        vertices = posed_by_smplx(free_body, dict(read))
    assert np.allclose(vertices, meshes(motion) @ np.array(AXES[axes].from_camera).T, atol=2e-5)


def posed_by_smplx(body: BodyModel, arrays: dict[str, np.ndarray]) -> np.ndarray:
    """The mesh of an AMASS-like npz: hands as full axis-angle, of which the mean is taken off again."""
    frames, hands = len(arrays["poses"]), arrays["pose_hand"]
    mean = body.hand_mean
    given = {
        "betas": np.tile(arrays["betas"][:10], (frames, 1)),
        "global_orient": arrays["root_orient"],
        "body_pose": arrays["pose_body"],
        "left_hand_pose": hands[:, :45] - mean[0],
        "right_hand_pose": hands[:, 45:] - mean[1],
        "jaw_pose": arrays["pose_jaw"],
        "leye_pose": arrays["pose_eye"][:, :3],
        "reye_pose": arrays["pose_eye"][:, 3:],
        "expression": arrays["expressions"],
        "camera_translation": arrays["trans"],
    }
    return Mesh(body)(BodyParams(**{name: torch.as_tensor(value) for name, value in given.items()})).numpy()


def test_npz_has_every_key_that_others_read(tiny_body: BodyModel, tmp_path: Path):
    motion = swinging(tiny_body).in_axes("z-up")
    write_animation_npz(tmp_path / "x.npz", motion)
    with np.load(tmp_path / "x.npz", allow_pickle=False) as file:
        read = dict(file)
    n = len(motion)
    shapes = {
        "poses": (n, 165), "trans": (n, 3), "betas": (16,), "expressions": (n, 10), "root_orient": (n, 3),
        "pose_body": (n, 63), "pose_hand": (n, 90), "pose_jaw": (n, 3), "pose_eye": (n, 6), "gender": (),
        "mocap_frame_rate": (), "mocap_framerate": (), "surface_model_type": (),
    }  # fmt: skip
    assert {name: read[name].shape for name in shapes} == shapes
    assert str(read["surface_model_type"]) == "smplx" and str(read["gender"]) == "neutral"
    assert float(read["mocap_frame_rate"]) == float(read["mocap_framerate"]) == 29.97
    parts = [read[f"pose_{part}"] for part in ("body", "jaw", "eye", "hand")]
    assert np.array_equal(read["poses"], np.concatenate([read["root_orient"], *parts], 1))
    assert abs(read["poses"][:, 3:] - motion.pose.flatten(1)[:, 3:].numpy()).max() < 1e-5
    assert not read["betas"][10:].any() and np.allclose(read["betas"][:10], motion.params.betas[0])
    assert "z up" in str(read["axes"]) and read["camera_focal"].tolist() == [900.0, 910.0]


@pytest.mark.parametrize(
    ("name", "stem"), [("walk 1", "walk_1"), ("../a/b", "a_b"), ("größe", "gr_e"), ("…", "motion")]
)
def test_names_become_names_of_files(name: str, stem: str):
    assert file_stem(name) == stem
