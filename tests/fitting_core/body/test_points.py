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
from fitting_core.fit.variables.point_jacobian import PointJacobian
from fitting_core.fit.variables.state import Columns, Free, Parametrisation, State
from fitting_core.priors.pose import AxisAnglePrior
from tests.samples.scenes import differentiated, random_params, random_state, without_correctives

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


def test_keypoints_of_the_free_body_lie_on_its_mesh(free_body: BodyModel):
    """All keypoints that are joints or fixed surface points, on the real mesh with correctives."""
    # Without translation: the landmarks' float32 weights sum to 1 only within 1e-7.
    params = replace(random_params(2), camera_translation=torch.zeros(2, 3, dtype=torch.float64))
    known = [p for p in keypoint_points(free_body) if p is not None and not isinstance(p, Contour | Offset)]
    assert len(known) > 100
    posed = posed_points(BodyPoints(free_body, known), params, free_body, None)
    mesh = Mesh(free_body, dtype=torch.float64)
    vertices, joints = mesh(params).numpy(), mesh.joints(params).numpy()
    for i in range(2):
        expected = [point_of_mesh(free_body, p, vertices[i], joints[i], 0) for p in known]
        np.testing.assert_allclose(posed.points[i], np.array(expected), rtol=0, atol=1e-12)


def test_batch_is_single_frames(tiny_body: BodyModel):
    params, points = random_params(4), BodyPoints(tiny_body, POINTS)
    together = posed_points(points, params, tiny_body, BINS).points
    for i in range(4):
        alone = posed_points(points, params[i : i + 1], tiny_body, BINS[i : i + 1]).points
        torch.testing.assert_close(together[i : i + 1], alone, rtol=0, atol=1e-13)


def test_contour_needs_its_tables(tiny_body: BodyModel):
    with pytest.raises(AssertionError, match="yaw table"):
        posed_points(BodyPoints(tiny_body, [Contour(0)]), random_params(2), tiny_body, None)


def test_joints_alone_and_nothing(tiny_body: BodyModel):
    params = random_params(2)
    posed = posed_points(BodyPoints(tiny_body, [Joint(j) for j in range(N_JOINTS)]), params, tiny_body, None)
    expected = Mesh(tiny_body, dtype=torch.float64).joints(params) - params.camera_translation[:, None]
    torch.testing.assert_close(posed.points, expected, rtol=0, atol=1e-13)
    assert posed_points(BodyPoints(tiny_body, []), params, tiny_body, None).points.shape == (2, 0, 3)


FREES = {
    "all": Free(),
    "camera step": Free(body=False, hands=False, face=False, betas=False),
    "frozen camera": Free(translation=False),
    "no body": Free(body=False),
    "hands": Free(face=False, betas=False),
    "face": Free(hands=False),
}


class Scene:
    """Points of a body in some state, and the derivatives of their positions by a step in all columns."""

    def __init__(self, body: BodyModel, components: int) -> None:
        self.p = Parametrisation(body, AxisAnglePrior(), hand_components=components, dtype=torch.float64)
        self.points = BodyPoints(body, POINTS)
        self.state = random_state(self.p, 4)
        self.posed = self._posed(self.state)
        self.differentiated = differentiated(self._in_camera, self.state, torch.arange(self.p.columns.total))

    def _posed(self, state: State) -> Posed:
        pose = self.p.pose(state, self.p.body_pose(state))
        return self.points.forward(state.orient, pose, self.p.coefficients(state), BINS)

    def _in_camera(self, state: State) -> Tensor:
        return self._posed(state).points + state.vector[:, None, self.p.columns.translation]

    def jacobian(self, free: Free) -> PointJacobian:
        return PointJacobian(self.points, Columns(63, self.p.columns.hand), free, self.p.hand_basis)


@pytest.fixture(scope="module")
def scene(tiny_body: BodyModel) -> Scene:
    return Scene(tiny_body, 12)


@pytest.fixture(scope="module", params=[12, 45])
def rigid_scene(tiny_body: BodyModel, request: pytest.FixtureRequest) -> Scene:
    return Scene(without_correctives(tiny_body), request.param)


EVERY = torch.eye(3, dtype=torch.float64).expand(4, len(POINTS), 3, 3)


@pytest.mark.parametrize("free", FREES.values(), ids=FREES.keys())
def test_jacobian_is_exact_without_correctives(rigid_scene: Scene, free: Free):
    expected = rigid_scene.differentiated[..., free.index(rigid_scene.p.columns)]
    rows = rigid_scene.jacobian(free)(rigid_scene.posed, EVERY)
    torch.testing.assert_close(rows.view_as(expected), expected, rtol=0, atol=1e-12)
    assert float(expected.abs().max()) > 0.1


def test_left_factor_is_applied_to_each_point(scene: Scene):
    left = torch.randn(4, len(POINTS), 2, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    jacobian = scene.jacobian(Free())
    expected = left @ jacobian(scene.posed, EVERY).view(4, len(POINTS), 3, -1)
    torch.testing.assert_close(jacobian(scene.posed, left), expected.flatten(1, 2), rtol=0, atol=1e-12)


def test_without_translation_the_rest_is_the_same(scene: Scene):
    jacobian, columns = scene.jacobian(Free()), scene.p.columns
    moving, still = jacobian(scene.posed, EVERY), jacobian(scene.posed, EVERY, translation=False)
    index = Free().index(columns)
    where = (index >= columns.translation.start) & (index < columns.translation.stop)
    assert int(where.sum()) == 3
    torch.testing.assert_close(still[..., ~where], moving[..., ~where], rtol=0, atol=0)
    assert float(still[..., where].abs().max()) == 0
    torch.testing.assert_close(moving[..., where].view(4, -1, 3, 3), EVERY, rtol=0, atol=0)


@pytest.mark.parametrize("free", FREES.values(), ids=FREES.keys())
def test_gradient_is_exact_with_correctives(scene: Scene, free: Free):
    pull = torch.randn(4, len(POINTS), 3, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    exact = scene.differentiated[..., free.index(scene.p.columns)]
    expected = torch.einsum("bnk,bnkd->bd", pull, exact)
    jacobian = scene.jacobian(free)
    by_jacobian = jacobian(scene.posed, pull[:, :, None]).sum(1)
    gradient = by_jacobian + jacobian.corrective_gradient(scene.posed, pull)
    torch.testing.assert_close(gradient, expected, rtol=0, atol=1e-11)
    if free.body:
        assert float((by_jacobian - expected).abs().max()) > 1e-4  # the correctives do matter


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


def test_world_rotations_are_those_of_the_forward_pass(tiny_body: BodyModel):
    params, points = random_params(3), BodyPoints(tiny_body, [Joint(5)])
    posed = posed_points(points, params, tiny_body, None)
    pose = full_pose(tiny_body, params)
    world = points.world_rotations(rotations.exp(params.global_orient), pose[:, 1:])
    torch.testing.assert_close(world, posed.world, rtol=0, atol=1e-13)


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
