"""The whole mesh against linear blend skinning written out with plain loops, and its axioms."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fitting_core.body import rotations
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import N_JOINTS, BodyModel, sparse_if_mostly_zero
from fitting_core.body.params import BodyParams, full_pose
from tests.samples.scenes import random_params


def skinned_by_hand(body: BodyModel, params: BodyParams, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and joints of one frame: 4 x 4 transforms down the tree, one vertex after the other."""
    betas, expression = params.betas[frame].numpy(), params.expression[frame].numpy()
    shaped = body.template + body.shape_directions @ betas + body.expression_directions @ expression
    rest = body.joint_regressor @ shaped
    pose = full_pose(body, params)[frame].numpy()
    local = Rotation.from_rotvec(pose).as_matrix()
    features = np.concatenate([(local[j] - np.eye(3)).reshape(9) for j in range(1, N_JOINTS)])
    corrected = shaped + (body.pose_directions @ features).reshape(-1, 3)
    world = np.zeros((N_JOINTS, 4, 4))
    for j, parent in enumerate(body.parents):
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = local[j], rest[j] - (rest[parent] if parent >= 0 else 0)
        world[j] = world[parent] @ step if parent >= 0 else step
    posed = np.zeros_like(corrected)
    for v, x in enumerate(corrected):
        for j in np.flatnonzero(body.skinning_weights[v]):
            posed[v] += body.skinning_weights[v, j] * (world[j, :3, :3] @ (x - rest[j]) + world[j, :3, 3])
    translation = params.camera_translation[frame].numpy()
    return posed + translation, world[:, :3, 3] + translation


@pytest.mark.parametrize("share", [1.0, 0.05])
def test_agrees_with_plain_loops(tiny_body: BodyModel, share: float):
    """With many and with few correctives, for which it has a sparse table."""
    dense = tiny_body.correctives_of(np.arange(len(tiny_body.template))).reshape(-1, 486)
    kept = np.random.default_rng(0).random(dense.shape) < share
    tiny_body = replace(tiny_body, pose_directions=sparse_if_mostly_zero(np.where(kept, dense, 0)))
    params = random_params(3, size=0.7)
    params = replace(params, leye_pose=0.2 + params.jaw_pose, reye_pose=0.1 - params.jaw_pose)
    mesh = Mesh(tiny_body, dtype=torch.float64)
    vertices, joints = mesh(params), mesh.joints(params)
    for frame in range(3):
        expected_vertices, expected_joints = skinned_by_hand(tiny_body, params, frame)
        np.testing.assert_allclose(vertices[frame], expected_vertices, rtol=0, atol=1e-12)
        np.testing.assert_allclose(joints[frame], expected_joints, rtol=0, atol=1e-12)


def test_neutral_pose_is_the_template(tiny_body: BodyModel):
    flat = replace(tiny_body, hand_mean=np.zeros_like(tiny_body.hand_mean))
    vertices = Mesh(flat, dtype=torch.float64)(BodyParams.neutral(1))[0]
    np.testing.assert_allclose(vertices, tiny_body.template, rtol=0, atol=1e-13)


def test_turning_and_moving_the_whole_body(tiny_body: BodyModel):
    params, mesh = random_params(2), Mesh(tiny_body, dtype=torch.float64)
    turn, shift = rotations.exp(torch.tensor([0.4, -1.1, 0.2]).double()), torch.tensor([0.3, -0.2, 1.0]).double()
    orient = rotations.log(turn @ rotations.exp(params.global_orient))
    moved = replace(params, global_orient=orient, camera_translation=params.camera_translation + shift)
    pelvis = mesh.joints(params)[:, :1]
    expected = (mesh(params) - pelvis) @ turn.T + pelvis + shift
    torch.testing.assert_close(mesh(moved), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("components", [1, 6, 12, 44])
def test_hand_components_and_full_hands_are_one_pose(tiny_body: BodyModel, components: int):
    params = random_params(2, hand_components=components)
    basis = torch.as_tensor(tiny_body.hand_components[:, :components])
    full = replace(
        params, left_hand_pose=params.left_hand_pose @ basis[0], right_hand_pose=params.right_hand_pose @ basis[1]
    )
    assert full.left_hand_pose.shape == (2, 45)
    torch.testing.assert_close(full_pose(tiny_body, params), full_pose(tiny_body, full), rtol=0, atol=1e-13)
