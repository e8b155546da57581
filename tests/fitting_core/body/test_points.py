"""Chosen points against the whole mesh, and their closed-form derivatives against automatic differentiation."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.kinematics import contour_bins
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, N_JOINTS, SURFACE_KEYPOINTS, BodyModel, KeypointOffset
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.body.points.body_points import BodyPoints, Posed
from fitting_core.body.points.pairs import Contour, Joint, Offset, Point, Surface, keypoint_points, vertex
from tests.samples.scenes import random_params, without_correctives

OFFSET = Offset(JOINT["left_knee"], JOINT["left_hip"], (0.01, -0.02, 0.03))
POINTS: list[Point] = [
    Contour(3),
    vertex(11),
    Joint(JOINT["left_wrist"]),
    Surface((4, 100, 333), (0.2, 0.5, 0.3)),
    OFFSET,
    Joint(0),
    Contour(16),
    vertex(439),
    Joint(JOINT["right_thumb3"]),
    vertex(11),
    Joint(JOINT["jaw"]),
    Surface((60, 61, 190), (0.3, 0.3, 0.4)),
]
"""Every kind of point, mixed, one of them twice."""
BINS = torch.tensor([0, 39, 78, 41])


def posed_points(points: BodyPoints, params: BodyParams, body: BodyModel, bins: Tensor | None) -> Posed:
    pose = full_pose(body, params)
    coefficients = torch.cat([params.betas, params.expression], 1)
    return points.forward(rotations.exp(params.global_orient), pose[:, 1:], coefficients, bins)


def point_of_mesh(body: BodyModel, p: Point, vertices: np.ndarray, joints: np.ndarray, table: int) -> np.ndarray:
    """Where a point lies, given all vertices and joints of one frame."""
    if isinstance(p, Joint):
        return joints[p.joint]
    if isinstance(p, Surface):
        return np.array(p.weights) @ vertices[list(p.vertices)]
    assert isinstance(p, Contour)
    corners, weights = body.contour_vertices[table, p.landmark], body.contour_weights[table, p.landmark]
    return weights @ vertices[corners]


def test_points_lie_where_the_mesh_has_them(tiny_body: BodyModel):
    params = random_params(4)
    posed = posed_points(BodyPoints(tiny_body, POINTS), params, tiny_body, BINS)
    points = posed.points + params.camera_translation[:, None]
    mesh = Mesh(tiny_body, dtype=torch.float64)
    vertices, joints = mesh(params).numpy(), mesh.joints(params).numpy()
    for i in range(4):
        for k, p in enumerate(POINTS):
            if not isinstance(p, Offset):
                expected = point_of_mesh(tiny_body, p, vertices[i], joints[i], int(BINS[i]))
                np.testing.assert_allclose(points[i, k], expected, rtol=0, atol=1e-12, err_msg=f"{p} in frame {i}")


def test_offset_moves_with_its_bone(tiny_body: BodyModel):
    """joint's position + the bone's turn of (offset + how the joint hangs on the bone in the rest pose)."""
    params = random_params(4)
    posed = posed_points(BodyPoints(tiny_body, [OFFSET]), params, tiny_body, None)
    hip, knee = JOINT["left_hip"], JOINT["left_knee"]
    shaped = tiny_body.template + np.einsum("vdk,tk->tvd", tiny_body.shape_directions, params.betas)
    shaped = shaped + np.einsum("vdk,tk->tvd", tiny_body.expression_directions, params.expression)
    rest = tiny_body.joint_regressor @ shaped
    for i in range(4):
        arm = rest[i, knee] + np.array(OFFSET.offset) - rest[i, hip]
        expected = posed.joints[i, hip].numpy() + posed.world[i, hip].numpy() @ arm
        np.testing.assert_allclose(posed.points[i, 0], expected, rtol=0, atol=1e-12)


class Scene:
    """Points of a body in some state, and the derivatives of their positions by a step of joints and coefficients."""

    def __init__(self, body: BodyModel) -> None:
        self.points, params = BodyPoints(body, POINTS), random_params(4)
        self.orient, self.pose = rotations.exp(params.global_orient), full_pose(body, params)[:, 1:]
        self.coefficients = torch.cat([params.betas, params.expression], 1)
        self.posed = self.points.forward(self.orient, self.pose, self.coefficients, BINS)

    def by_joint(self, *, correctives_held: bool = False) -> Tensor:
        """(B, N, 3, 55, 3): by a turn of the root in space, and the axis-angles of the others."""

        def moved(step: Tensor) -> Tensor:
            orient, pose = rotations.exp(step[0]) @ self.orient, self.pose + step[1:]
            posed = self.points.forward(orient, pose, self.coefficients, BINS, correctives_held=correctives_held)
            return posed.points

        return torch.func.jacfwd(moved)(torch.zeros(N_JOINTS, 3, dtype=torch.float64))

    def by_coefficient(self) -> Tensor:
        """(B, N, 3, 20)."""
        place = torch.zeros(20, dtype=torch.float64)
        return torch.func.jacfwd(
            lambda step: self.points.forward(self.orient, self.pose, self.coefficients + step, BINS).points
        )(place)

    def entries(self, by_point: Tensor) -> Tensor:
        """`rotation_entries` with zeros between them, (B, N, R, 55, 3)."""
        whole = by_point.new_zeros(*by_point.shape[:3], N_JOINTS, 3)
        at, joint = self.points.entry_point, self.points.entry_joint
        whole[:, at, :, joint] = self.points.rotation_entries(self.posed, by_point).transpose(0, 1)
        return whole


@pytest.fixture(scope="module")
def scene(tiny_body: BodyModel) -> Scene:
    return Scene(tiny_body)


EVERY = torch.eye(3, dtype=torch.float64).expand(4, len(POINTS), 3, 3)


def test_entries_are_the_derivative_with_the_correctives_held(scene: Scene, tiny_body: BodyModel):
    expected = scene.by_joint(correctives_held=True)
    torch.testing.assert_close(scene.entries(EVERY), expected, rtol=0, atol=1e-12)
    assert float(expected.abs().max()) > 0.1
    assert float((scene.by_joint() - expected).abs().max()) > 1e-4  # the correctives do matter
    plain = Scene(without_correctives(tiny_body))
    torch.testing.assert_close(plain.entries(EVERY), plain.by_joint(), rtol=0, atol=1e-12)


def test_derivative_by_the_coefficients_is_exact(scene: Scene):
    found = scene.points.coefficient_jacobian(scene.posed, slice(0, 20))
    torch.testing.assert_close(found, scene.by_coefficient(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("yaw", [-80.0, -39.6, -39.4, -20.0, -0.6, -0.4, 0.0, 0.4, 0.6, 12.3, 38.4, 39.0, 60.0])
@pytest.mark.parametrize("roll", [0.0, 35.0, -70.0])
def test_contour_table_follows_the_turn_of_the_head(yaw: float, roll: float):
    """Turned to its right by k degrees: table k; to its left: 39 + k; both cut at 39 degrees.

    The head looks along its own z. Before a camera (y down, z away) a person who faces it is turned by 180 degrees
    about x; from there the head turns about its own y, to its right for a negative angle, whatever the roll of the
    image.
    """
    facing = rotations.exp(torch.tensor([torch.pi, 0, 0], dtype=torch.float64))
    rolled = rotations.exp(torch.tensor([0, 0, np.radians(roll)], dtype=torch.float64))
    world = torch.eye(3, dtype=torch.float64).repeat(1, N_JOINTS, 1, 1)
    world[0, JOINT["head"]] = rolled @ facing @ rotations.yaw(-yaw, facing)
    to_right = round(min(max(yaw, -39), 39))
    assert contour_bins(world).tolist() == [to_right if to_right >= 0 else 39 - to_right]


def test_contour_tables_are_those_of_the_cheek_that_is_seen(free_body: BodyModel):
    """On the free body the chosen contour is closest to the outline of the head as the camera sees it."""
    points, params = BodyPoints(free_body, [Contour(i) for i in range(17)]), BodyParams.neutral(2)
    turn = rotations.exp(torch.tensor([[0, 0.5, 0], [0, -0.5, 0]], dtype=torch.float64))
    facing = torch.tensor([torch.pi, 0, 0], dtype=torch.float64)
    params = replace(params, global_orient=rotations.log(rotations.exp(facing) @ turn))
    pose = full_pose(free_body, params)
    bins = contour_bins(points.world_rotations(rotations.exp(params.global_orient), pose[:, 1:]))
    width = {}
    for name, tables in (("right", bins), ("wrong", bins.flip(0))):
        x = posed_points(points, params, free_body, tables).points[..., 0]
        width[name] = x.amax(1) - x.amin(1)
    assert (width["right"] > width["wrong"] + 0.01).all()


def test_keypoint_points_follow_the_keypoints_order(tiny_body: BodyModel):
    points = keypoint_points(tiny_body)
    assert len(points) == kp.COUNT
    named = {kp.NAMES[i] if i not in (25, 46) else f"hand {i}": p for i, p in enumerate(points)}
    assert named["mid_hip"] == Joint(JOINT["pelvis"]) and named["right_knee"] == Joint(JOINT["right_knee"])
    assert named["hand 25"] == named["left_wrist"] == Joint(JOINT["left_wrist"])
    assert named["left_pinky3"] == Joint(JOINT["left_pinky3"])
    assert named["left_pinky4"] == vertex(tiny_body.surface_keypoints["left_pinky"])
    assert named["right_thumb1"] == Joint(JOINT["right_thumb1"])
    assert points[kp.CONTOUR] == [Contour(i) for i in range(17)]
    inner = points[kp.CONTOUR.stop : kp.INDEX["face_right_pupil"]]
    assert [getattr(p, "vertices", None) for p in inner] == [tuple(v) for v in tiny_body.landmark_vertices.tolist()]
    assert points[135:] == [None, None]
    surface = [named[n] for n in SURFACE_KEYPOINTS if n in kp.BODY_25]
    assert surface == [vertex(tiny_body.surface_keypoints[n]) for n in SURFACE_KEYPOINTS if n in kp.BODY_25]


def test_what_a_body_lacks_is_none_and_offsets_replace_joints(tiny_body: BodyModel):
    hip = KeypointOffset(joint="left_hip", bone="pelvis", offset=(0.02, 0.0, 0.01))
    bare = replace(
        tiny_body,
        surface_keypoints={},
        landmark_vertices=np.zeros((0, 3), int),
        landmark_weights=np.zeros((0, 3)),
        contour_vertices=np.zeros((0, 17, 3), int),
        contour_weights=np.zeros((0, 17, 3)),
        keypoint_offsets={"left_hip": hip},
    )
    points = keypoint_points(bare)
    assert len(points) == kp.COUNT and points[kp.FACE] == [None] * 70
    assert points[kp.INDEX["nose"]] is None and points[kp.INDEX["left_index4"]] is None
    assert points[kp.INDEX["left_hip"]] == Offset(JOINT["left_hip"], 0, (0.02, 0.0, 0.01))
