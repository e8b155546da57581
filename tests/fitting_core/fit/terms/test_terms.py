"""Every term of E_o: its value written out by hand; its derivatives, by kernels and in torch, by automatic
differentiation; all in float64. Also how terms are listed elsewhere."""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import pytest
import torch
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body import rotations
from fitting_core.body.joint_ranges import joint_ranges
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.pairs import Contour, Joint, Surface
from fitting_core.config.schema import PRESETS, FitConfig, Weights
from fitting_core.fit.fused import ready
from fitting_core.fit.objective import FrameObjective, Normal
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.collision import Collision
from fitting_core.fit.terms.data import Data
from fitting_core.fit.terms.limits import JointLimits
from fitting_core.fit.terms.locks import LOCK_WEIGHT
from fitting_core.fit.terms.positions import HeldPosition, RelativePosition
from fitting_core.fit.terms.quadratic import Quadratic
from fitting_core.fit.terms.table import TERMS
from fitting_core.fit.terms.temporal import Smoothness
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.state import Free, State
from fitting_core.ground.contacts import FOOT_POINTS
from tests.drivers.written_terms import written
from tests.samples.scenes import (
    CAMERA,
    differentiated,
    hidden,
    keypoints_of,
    noisy,
    random_params,
    random_state,
    stages_of,
    with_positions,
    without_correctives,
)

T = 4
FRAMES = torch.tensor([2, 0, 3])
"""Of the clip, not in order: terms must look up each frame's own data."""
CONFIG = FitConfig(
    weights=replace(
        Weights(),
        body_pose=(0, 0, 0, 0, 3.0), hand_pose=(0, 0, 0, 0, 5.0), shape=(0, 0, 0, 0, 7.0),
        expression=(0, 0, 0, 0, 11.0), jaw_open=(0, 0, 0, 0, 13.0), jaw_sideways=(0, 0, 0, 0, 17.0),
        bending=(0, 0, 0, 0, 19.0), collision=(0,) * 5, lean=(0, 0, 0, 0, 23.0), turn=(0, 0, 0, 0, 29.0),
        rest=(0, 0, 0, 0, 31.0), relative_position=(0, 0, 0, 0, 41.0), held_position=(0, 0, 0, 0, 17.0),
        body_keypoints=(0, 0, 0, 0, 1.5), hand_keypoints=(0, 0, 0, 0, 2.0), face_keypoints=(0, 0, 0, 0, 0.5),
    ),
    pose_prior="relaxed", neck_weight=0.25, hip_weight=0.75, robust_pixels=80.0, robust_pixels_fine=30.0,
    robust_at_height=1000.0, one_sided_cut_off=True, robust_deviations=2.5,
)  # fmt: skip
"""Every weight another, so that no term can take another's. Collision and limits have tests of their own."""
LEGS = [kp.INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("hip", "knee", "ankle")]
LEFT_ARM = [kp.INDEX["left_elbow"], kp.INDEX["left_wrist"], kp.LEFT_HAND]
LOCKED = np.full((T, kp.COUNT, 3), np.nan)
LOCKED[2, kp.INDEX["right_elbow"]] = (0.1, 1.9, -0.4)
LOCKED[:3, kp.INDEX["nose"]] = (0.0, 0.3, 0.2)
LOCKED[3, kp.INDEX["left_knee"]] = (0.0, 0.0, 0.0)
LOCKED[0, kp.FINGER_JOINTS["left"]] = np.random.default_rng(3).normal(0, 0.5, (15, 3))
"""Turns that a person has locked, and a hand whose shape one stated."""


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    ready.prepare(print)


class Huddle(Term):
    """A user's own term, of which nothing is known but its residual: pixels in one place, pose and root at rest."""

    name = "huddle"

    def residual(self, e: Estimate) -> Tensor:
        return torch.cat([0.01 * e.pixels.std(1), torch.sin(e.body_pose[:, 50:53]), e.state.orient[:, 0, :2]], 1)


@dataclass(eq=False)
class Scene:
    """A clip of noisy detections, and a state somewhere else."""

    body: BodyModel
    stages: Stages
    state: State
    """Of FRAMES."""
    params: BodyParams
    """The same as a user knows it."""
    objectives: dict[str, FrameObjective]
    """E_o of stage 5, and the camera step."""

    def term(self, name: str) -> Term:
        if name == Huddle.name:
            return Huddle()
        if name == JointLimits.name:
            return JointLimits.of(37.0, joint_ranges(self.body), fingers=True, like=self.state.vector[:0, 0])
        objective = self.objectives["camera" if name == "depth" else "stage 5"]
        return next(t for t in (*objective.terms, *objective.shared) if t.name == name)

    def estimate(self, state: State | None = None) -> Estimate:
        return Estimate(self.objectives["stage 5"].view, state or self.state, FRAMES)

    def alone(self, term: Term, free: Free) -> FrameObjective:
        """An objective of one term, which counts in every frame; with a data term of weight 0, which kernels need."""
        term = replace(term, once=False) if isinstance(term, Quadratic) else term
        data = self.objectives["stage 5"].data
        silent = [] if isinstance(term, Data) else [replace(data, weight=torch.zeros_like(data.weight))]
        return FrameObjective([*silent, term], self.objectives["stage 5"].view, free)

    def _everything(self, state: State) -> dict[str, Tensor]:
        estimate = self.estimate(state)
        residuals = {name: self.term(name).residual(estimate) for name in DERIVED}
        return {"pixels": estimate.pixels, **residuals}

    @cached_property
    def values(self) -> dict[str, Tensor]:
        """Residuals of every term, and the pixels."""
        return self._everything(self.state)

    @cached_property
    def jacobians(self) -> dict[str, Tensor]:
        """Their derivatives by all columns, by automatic differentiation."""
        every = torch.arange(self.stages.parametrisation.columns.total)
        return differentiated(self._everything, self.state, every)  # pyright: ignore[reportArgumentType, reportReturnType]

    def jacobian(self, name: str, free: Free) -> Tensor:
        """The same by the free columns."""
        return self.jacobians[name][..., free.index(self.stages.parametrisation.columns)]


def make_scene(body: BodyModel, *, latent: bool = False) -> Scene:
    """Some limbs unseen in some frames, some detections at the image border, errors from 1 to 1000 pixels."""
    detections = noisy(keypoints_of(body, random_params(T, 5)), 15.0)
    detections = hidden(detections, *LEGS, frames=slice(2, 4))
    detections = hidden(detections, *LEFT_ARM, frames=slice(0, 2))
    detections.xy[0, kp.INDEX["nose"]] += (400, -700)
    detections.xy[:, kp.INDEX["right_wrist"]] = (798.0, 500.0)
    detections.xy[2, kp.INDEX["right_ankle"]] = (300.0, 797.0)
    detections.confidence[2, kp.INDEX["right_ankle"]] = 0.4
    detections.xy[3, kp.INDEX["left_ear"]] = (3.0, 2.0)
    detections = replace(detections, turn=LOCKED)
    stages = with_positions(stages_of(body, detections, CONFIG, latent=latent))
    p = stages.parametrisation
    whole = random_state(p, T, 11)
    depth = torch.tensor([2.0, 3.0, 4.0, 5.0], dtype=torch.float64)
    objectives = {"stage 5": stages.objective(5, whole, Free()), "camera": stages.camera_objective(depth)}
    state = whole[FRAMES]
    return Scene(body, stages, state, p.to_params(state), objectives)


@pytest.fixture(scope="module")
def scene(tiny_body: BodyModel) -> Scene:
    return make_scene(tiny_body)


@pytest.fixture(scope="module")
def latent_scene(tiny_body: BodyModel) -> Scene:
    return make_scene(tiny_body, latent=True)


@pytest.fixture(scope="module")
def rigid_scene(tiny_body: BodyModel) -> Scene:
    return make_scene(without_correctives(tiny_body))


def keypoint_in_camera(scene: Scene, b: int, i: int, vertices: np.ndarray, joints: np.ndarray) -> np.ndarray | None:
    """A keypoint of the posed mesh, its place looked up without BodyPoints."""
    p = scene.stages.fitted.keypoint_points[i]
    if p is None:
        return None
    if isinstance(p, Joint):
        return joints[b, p.joint]
    elif isinstance(p, Contour):
        bins = scene.objectives["stage 5"].view.contour_bin
        assert bins is not None
        table = int(bins[FRAMES[b]])
        corners, weights = scene.body.contour_vertices[table, p.landmark], scene.body.contour_weights[table, p.landmark]
        return weights @ vertices[b, corners]
    else:
        assert isinstance(p, Surface)
        return np.array(p.weights) @ vertices[b, list(p.vertices)]


def joint_weight(i: int) -> float:
    """The factors of CONFIG, by the keypoint's number in OpenPose's documentation."""
    if i >= 67:
        return 0.5
    if i >= 25:
        return 2.0
    return {1: 0.25 * 1.5, 9: 0.75 * 1.5, 12: 0.75 * 1.5}.get(i, 1.5)


def data_by_hand(scene: Scene) -> list[float]:
    mesh, detections = Mesh(scene.body, dtype=torch.float64), scene.stages.keypoints
    vertices, joints = mesh(scene.params).numpy(), mesh.joints(scene.params).numpy()
    costs = []
    for b, frame in enumerate(FRAMES.tolist()):
        cost = 0.0
        for i in range(137):
            point = keypoint_in_camera(scene, b, i, vertices, joints)
            if point is None:
                continue
            x, y, z = point
            pixel = np.array([900.0 * x / z + 410.0, 940.0 * y / z + 395.0])
            rho = (30.0 if i >= 25 else 80.0) * 800 / 1000
            weight = detections.confidence[frame, i] * joint_weight(i) * 1000 / 800
            for axis in (0, 1):
                found = detections.xy[frame, i, axis]
                error = pixel[axis] - found
                side = one_side(scene, frame, i, axis)
                if side * error > 0:  # the detection says no more than "at least so far out"
                    continue
                cost += weight**2 * rho**2 * error**2 / (error**2 + rho**2)
        costs.append(cost)
    return costs


def one_side(scene: Scene, frame: int, i: int, axis: int) -> int:
    """The detections that make_scene put within 1.5 % of the 800 pixels to the border; hips without a knee."""
    detections = scene.stages.keypoints
    if detections.confidence[frame, i] == 0:
        return 0
    found = detections.xy[frame, i, axis]
    side = int(found > 799 - 12) - int(found < 12)
    return 1 if axis == 1 and i == kp.INDEX["mid_hip"] and frame >= 2 else side


def relative_position_by_hand(scene: Scene) -> list[float]:
    mesh, known = Mesh(scene.body, dtype=torch.float64), scene.stages.observations
    vertices, joints = mesh(scene.params).numpy(), mesh.joints(scene.params).numpy()
    pelvis = scene.body.rest_joints[0]
    costs = []
    for b, frame in enumerate(FRAMES.tolist()):
        cost = 0.0
        for i in range(137):
            deviations = known.relative_position_deviation[frame, i].tolist()
            point = keypoint_in_camera(scene, b, i, vertices, joints)
            for axis in np.flatnonzero(np.isfinite(deviations)) if point is not None else ():
                # The pelvis lies where the likeliest shape's lies: the camera's translation starts from there.
                away = point[axis] - float(scene.params.camera_translation[b, axis]) - pelvis[axis]  # pyright: ignore[reportOptionalSubscript]
                error = (away - float(known.relative_position[frame, i, axis])) / deviations[axis]
                cost += 41.0**2 * 2.5**2 * error**2 / (error**2 + 2.5**2)
        costs.append(cost)
    return costs


def held_position_by_hand(scene: Scene) -> list[float]:
    mesh, known = Mesh(scene.body, dtype=torch.float64), scene.stages.observations
    vertices, joints = mesh(scene.params).numpy(), mesh.joints(scene.params).numpy()
    costs = []
    for b, frame in enumerate(FRAMES.tolist()):
        cost = 0.0
        for foot, part in known.held_position_deviation[frame].isfinite().nonzero().tolist():
            point = keypoint_in_camera(scene, b, int(FOOT_POINTS[foot, part]), vertices, joints)
            assert point is not None
            for error in (point - known.held_position[frame, foot, part].numpy()) / 0.02:
                cost += 17.0**2 * 30.0**2 * error**2 / (error**2 + 30.0**2)
        costs.append(cost)
    return costs


def rest_by_hand(scene: Scene) -> list[float]:
    costs = []
    for b, frame in enumerate(FRAMES.tolist()):
        cost = 0.0
        for j in range(1, 22):
            if not scene.stages.context.turned[frame, j]:
                target = neutral_pose(scene)[3 * (j - 1) : 3 * j]
                cost += 31.0**2 * sum((scene.params.body_pose[b, 3 * (j - 1) : 3 * j].numpy() - target) ** 2)
        costs.append(cost)
    return costs


def neutral_pose(scene: Scene) -> np.ndarray:
    prior = scene.stages.parametrisation.prior
    return prior.decode(prior.neutral[None])[0].numpy()


def squares(values: Tensor, weight: float) -> list[float]:
    return [weight**2 * sum(float(x) ** 2 for x in row) for row in values]


def body_pose_by_hand(scene: Scene) -> list[float]:
    p = scene.stages.parametrisation
    return squares(scene.state.vector[:, p.columns.body] - p.prior.neutral, 3.0)


def jaw_by_hand(scene: Scene) -> list[float]:
    return [(13 * x) ** 2 + (17 * y) ** 2 + (17 * z) ** 2 for x, y, z in scene.params.jaw_pose.tolist()]


def bending_by_hand(scene: Scene) -> list[float]:
    angles = scene.params.body_pose.view(-1, 21, 3)

    def angle(b: int, joint: str, axis: int) -> float:
        return float(angles[b, JOINT[joint] - 1, axis])

    return [
        19.0**2
        * (
            np.exp(angle(b, "left_elbow", 1)) ** 2
            + np.exp(-angle(b, "right_elbow", 1)) ** 2
            + np.exp(-angle(b, "left_knee", 0)) ** 2
            + np.exp(-angle(b, "right_knee", 0)) ** 2
        )
        for b in range(len(FRAMES))
    ]


def upright_by_hand(scene: Scene) -> list[float]:
    """Legs are hidden in frames 2 and 3 only."""
    costs = []
    for b, frame in enumerate(FRAMES.tolist()):
        turn = rotations.exp(scene.params.global_orient[b]).numpy()
        up, forward = turn @ (0, 1, 0), turn @ (0, 0, 1)
        held = 23.0**2 * (up[0] ** 2 + up[2] ** 2) + 29.0**2 * forward[0] ** 2
        costs.append(held if frame >= 2 else 0.0)
    return costs


def hand_pose_by_hand(scene: Scene) -> list[float]:
    """5^2 x^2, and LOCK_WEIGHT^2 (x - x')^2 where x' are the nearest numbers to the stated shape."""
    found = []
    for i, frame in enumerate(FRAMES.tolist()):
        of_frame = 0.0
        for side, hand in enumerate(("left", "right")):
            numbers = getattr(scene.params, f"{hand}_hand_pose")[i].numpy()
            stated = LOCKED[frame, kp.FINGER_JOINTS[hand]].flatten()
            weight, away = 5.0, numbers
            if np.isfinite(stated).all():
                weight = LOCK_WEIGHT
                rows = scene.body.hand_components[side, : len(numbers)]
                away = numbers - rows @ (stated - scene.body.hand_mean[side])
            of_frame += float((weight * away) @ (weight * away))
        found.append(of_frame)
    return found


def locks_by_hand(scene: Scene) -> list[float]:
    """3 - trace(R_0^T R) is (2 sin(a / 2))^2."""
    costs = []
    for b, frame in enumerate(FRAMES.tolist()):
        turns = rotations.exp(scene.params.body_pose[b].view(21, 3)).numpy()
        cost = 0.0
        for keypoint, joint in (("right_elbow", 19), ("nose", 15), ("left_knee", 4)):
            lock = LOCKED[frame, kp.INDEX[keypoint]]
            if np.isfinite(lock).all():
                there = rotations.exp(torch.as_tensor(lock)).numpy()
                cost += (6 / np.radians(2)) ** 2 * (3 - np.trace(there.T @ turns[joint - 1]))
        costs.append(cost)
    return costs


def depth_by_hand(scene: Scene) -> list[float]:
    guesses = [2.0, 3.0, 4.0, 5.0]
    depths = scene.params.camera_translation[:, 2].tolist()
    return [100.0**2 * (z - guesses[frame]) ** 2 for z, frame in zip(depths, FRAMES.tolist(), strict=True)]


BY_HAND = {
    "data": data_by_hand,
    "relative_position": relative_position_by_hand,
    "held_position": held_position_by_hand,
    "body_pose": body_pose_by_hand,
    "hand_pose": hand_pose_by_hand,
    "shape": lambda s: squares(s.params.betas, 7.0),
    "shared_shape": lambda s: squares(s.params.betas, 7.0),
    "expression": lambda s: squares(s.params.expression, 11.0),
    "jaw": jaw_by_hand,
    "bending": bending_by_hand,
    "upright": upright_by_hand,
    "rest": rest_by_hand,
    "locks": locks_by_hand,
    "depth": depth_by_hand,
}
"""Cost of each term in FRAMES, from the formulas of the method."""
DERIVED = (*BY_HAND, JointLimits.name, Huddle.name)
"""Terms whose derivatives are compared; test_joint_limits.py has the limits' values."""


def test_every_term_is_written_out_by_hand(scene: Scene):
    tested, elsewhere = {type(scene.term(name)) for name in BY_HAND}, {JointLimits, Collision, Smoothness}
    assert tested == {Data, RelativePosition, HeldPosition, *(entry.kind for entry in TERMS.values())} - elsewhere
    assert {t.name for o in scene.objectives.values() for t in (*o.terms, *o.shared)} == set(BY_HAND)


@pytest.mark.parametrize("name", ["temporal", "bending", "upright", "limits", "rest", "collision", "held_position"])
def test_terms_of_weight_zero_are_not_made(tiny_body: BodyModel, name: str):
    zero = dict.fromkeys(("lean", "turn", "rest", "limits", "bending", "collision", "held_position"), (0.0,) * 5)
    config = replace(CONFIG, weights=replace(CONFIG.weights, **zero), temporal=replace(CONFIG.temporal, weight=0.0))
    stages = with_positions(stages_of(tiny_body, hidden(keypoints_of(tiny_body, random_params(2, 5)), *LEGS), config))
    assert TERMS[name].make(stages.context, stages._used_in(5), 4) is None


@pytest.mark.parametrize("name", BY_HAND)
@pytest.mark.parametrize("which", ["scene", "latent_scene"])
def test_value_by_hand(name: str, which: str, request: pytest.FixtureRequest):
    scene = request.getfixturevalue(which)
    cost = scene.values[name].square().sum(1)
    np.testing.assert_allclose(cost, BY_HAND[name](scene), rtol=1e-9)
    assert float(cost.max()) > 0


def test_costs_are_the_terms_and_their_sum(scene: Scene):
    objective = scene.objectives["stage 5"]
    costs = objective.costs(scene.state, FRAMES)
    assert set(costs) == set(BY_HAND) - {"depth", "shared_shape"}
    for name, cost in costs.items():
        np.testing.assert_allclose(cost, BY_HAND[name](scene), rtol=1e-9)
    total = torch.stack(list(costs.values())).sum(0)
    torch.testing.assert_close(objective.cost(scene.state, FRAMES), total, rtol=1e-12, atol=0)
    torch.testing.assert_close(objective.normal(scene.state, FRAMES).cost, total, rtol=1e-12, atol=0)


def test_camera_step_looks_at_the_torso_and_at_the_head_where_hips_are_hidden(scene: Scene):
    """Weights 1, also of neck and hips, whatever the stages' factors are."""
    data = next(t for t in scene.objectives["camera"].terms if isinstance(t, Data))
    confidence = scene.stages.observations.confidence * 1000 / 800
    torso = [1, 2, 5, 8, 9, 12]
    used = [i for i in range(25) if i in torso or i in (0, 15, 16, 17, 18)]
    torch.testing.assert_close(data.weight[0].sum(), confidence[0, torso].sum())
    torch.testing.assert_close(data.weight[2].sum(), confidence[2, used].sum())
    assert {t.name for t in scene.objectives["camera"].terms} == {"data", "depth", "upright"}
    assert scene.objectives["camera"].free == FREES["camera step"]


FREES = {
    "all": Free(),
    "camera step": Free(body=False, hands=False, face=False, betas=False),
    "no hands": Free(hands=False, betas=False),
    "no body": Free(body=False),
    "frozen camera": Free(face=False, translation=False),
}


BY_KERNELS = [(free, True) for free in FREES.values()] + [(Free(), False)]
"""Groups that move, and whether kernels evaluate the term. In torch columns are the same code for all terms."""
WAYS = [f"{name}, kernels" for name in FREES] + ["all, torch"]


def normal_of(scene: Scene, term: Term, free: Free, *, kernels: bool, monkeypatch: pytest.MonkeyPatch) -> Normal:
    monkeypatch.setattr(ready._Use, "allowed", kernels)
    objective = scene.alone(term, free)
    assert (objective.fused is not None) == kernels
    if kernels:
        assert objective.fused.others == ([term] if term.name == Huddle.name else [])  # pyright: ignore[reportOptionalMemberAccess]
    return objective.normal(scene.state, FRAMES)


@pytest.mark.parametrize(
    ("which", "free", "kernels"),
    [
        *(("scene", *way) for way in BY_KERNELS),
        *(("latent_scene", *way) for way in ((Free(), True), (FREES["no hands"], True), (Free(), False))),
    ],
    ids=[*WAYS, "latent, all, kernels", "latent, no hands, kernels", "latent, all, torch"],
)
@pytest.mark.parametrize("name", DERIVED)
def test_gradient_is_exact_and_matrix_gauss_newton(
    name: str, free: Free, kernels: bool, which: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
):
    """J^T r, also of the data term on a body with pose correctives and through a non-linear prior's decoder; and J^T J,
    where the kernels have the derivative of a latent prior in float32. What looks at points is reweighted: see below.
    """
    scene = request.getfixturevalue(which)
    found = normal_of(scene, scene.term(name), free, kernels=kernels, monkeypatch=monkeypatch)
    jacobian = scene.jacobian(name, free)
    gradient, matrix = (jacobian.mT @ scene.values[name][..., None])[..., 0], jacobian.mT @ jacobian
    scale = max(float(gradient.abs().max()), 1.0)
    torch.testing.assert_close(found.cost, scene.values[name].square().sum(1), rtol=1e-10, atol=0)
    torch.testing.assert_close(found.gradient, gradient, rtol=1e-9, atol=1e-10 * scale)
    if name not in ("data", "relative_position", "held_position", Huddle.name):
        close = 1e-6 if kernels and which == "latent_scene" else 1e-10
        torch.testing.assert_close(found.matrix, matrix, rtol=close, atol=close * max(1.0, float(matrix.max())))
    assert not found.matrix.requires_grad


def test_matrix_of_a_term_without_a_kernel_is_gauss_newton(rigid_scene: Scene, monkeypatch: pytest.MonkeyPatch):
    matrix = normal_of(rigid_scene, Huddle(), Free(), kernels=True, monkeypatch=monkeypatch).matrix
    jacobian = rigid_scene.jacobian(Huddle.name, Free())
    torch.testing.assert_close(matrix, jacobian.mT @ jacobian, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("free", "kernels"), BY_KERNELS, ids=WAYS)
def test_matrix_of_the_data_term_is_reweighted_least_squares(
    rigid_scene: Scene, free: Free, kernels: bool, monkeypatch: pytest.MonkeyPatch
):
    """IRLS: J^T W J of the projections' Jacobian, W = weight^2 rho^4 / (r^2 + rho^2)^2, which is g'(r) / 2 r.

    Exact where the body has no pose correctives: these are left out of the matrix, not of the gradient.
    """
    scene, data = rigid_scene, rigid_scene.term("data")
    assert isinstance(data, Data)
    error = scene.values["pixels"] - data.xy[FRAMES]
    error = torch.where(error * data.side[FRAMES] > 0, 0.0, error)
    weight = data.weight[FRAMES][..., None] ** 2 * data.rho**4 / (error**2 + data.rho**2) ** 2
    jacobian = scene.jacobian("pixels", free)
    expected = torch.einsum("bnrd,bnr,bnre->bde", jacobian, weight, jacobian)
    matrix = normal_of(scene, data, free, kernels=kernels, monkeypatch=monkeypatch).matrix
    torch.testing.assert_close(matrix, expected, rtol=1e-9, atol=1e-9 * float(expected.max()))


@pytest.mark.parametrize("name", ["relative_position", "held_position"])
@pytest.mark.parametrize(("free", "kernels"), BY_KERNELS, ids=WAYS)
def test_matrix_of_positions_is_reweighted_least_squares(
    rigid_scene: Scene, name: str, free: Free, kernels: bool, monkeypatch: pytest.MonkeyPatch
):
    """As of the data term; relative positions do not move with the camera's translation."""
    scene, term = rigid_scene, rigid_scene.term(name)
    assert isinstance(term, RelativePosition | HeldPosition)
    moved = differentiated(
        lambda s: term.points(scene.estimate(s)),
        scene.state,
        free.index(scene.stages.parametrisation.columns),
    )
    error, rho = term.errors(scene.estimate()), term.rho[FRAMES]
    weight = term.weight[FRAMES] ** 2 * rho**4 / (error**2 + rho**2) ** 2
    expected = torch.einsum("bnrd,bnr,bnre->bde", moved, weight, moved)
    matrix = normal_of(scene, term, free, kernels=kernels, monkeypatch=monkeypatch).matrix
    torch.testing.assert_close(matrix, expected, rtol=1e-9, atol=1e-9 * float(expected.max()))


def test_the_pose_correctives_are_left_out_of_the_matrix_alike(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    """Kernels and torch, of a body that has some; with them the matrix is another one."""
    data = scene.term("data")
    by_kernels, in_torch = (
        normal_of(scene, data, Free(), kernels=kernels, monkeypatch=monkeypatch) for kernels in (True, False)
    )
    largest = float(in_torch.matrix.abs().max())
    torch.testing.assert_close(by_kernels.matrix, in_torch.matrix, rtol=1e-9, atol=1e-9 * largest)
    whole = differentiated(
        lambda s: data.reweighted(scene.estimate(s)), scene.state, Free().index(scene.stages.parametrisation.columns)
    )
    assert float((whole.mT @ whole - in_torch.matrix).abs().max()) > 1e-4 * largest


def test_normal_equations_add_up(scene: Scene):
    """The whole objective is the sum of its terms, each in whatever space it counts."""
    objective = scene.objectives["stage 5"]
    whole = objective.normal(scene.state, FRAMES)
    parts: list[Normal] = [scene.alone(t, Free()).normal(scene.state, FRAMES) for t in objective.terms]
    for name in ("cost", "gradient", "matrix"):
        expected = torch.stack([getattr(p, name) for p in parts]).sum(0)
        torch.testing.assert_close(getattr(whole, name), expected, rtol=1e-10, atol=1e-9 * float(expected.abs().max()))


def test_what_counts_once_is_apart_from_what_counts_in_every_frame(scene: Scene):
    """E_beta' has the normal equations of E_beta, of one frame."""
    objective = scene.objectives["stage 5"]
    once = objective.shared_normal(scene.state)
    alone = scene.alone(scene.term("shape"), Free()).normal(scene.state[:1], FRAMES[:1])
    for name in ("cost", "gradient", "matrix"):
        torch.testing.assert_close(getattr(once, name), getattr(alone, name))
    assert {name: float(cost) for name, cost in objective.shared_costs(scene.state).items()} == pytest.approx(
        {"shared_shape": float(alone.cost)}
    )


@pytest.mark.parametrize("kernels", [True, False])
def test_points_behind_the_camera_cost_infinity(scene: Scene, request: pytest.FixtureRequest, kernels: bool):
    behind = scene.state.vector.clone()
    behind[1, scene.stages.parametrisation.columns.translation] = torch.tensor([0.0, 0.0, -3.0], dtype=torch.float64)
    objective, state = scene.objectives["stage 5"], State(scene.state.orient, behind)
    if not kernels:
        request.getfixturevalue("in_torch")
        objective = FrameObjective(objective.terms, objective.view, objective.free)
        assert objective.fused is None
    assert objective.cost(state, FRAMES).isinf().tolist() == [False, True, False]
    assert objective.normal(state, FRAMES).cost.isinf().tolist() == [False, True, False]


def test_a_bending_prior_of_weight_zero_is_no_term(tiny_body: BodyModel):
    """0 x exp(overflow) is not a number, and would end a minimisation that has no use for the term."""
    stages = stages_of(tiny_body, keypoints_of(tiny_body, random_params(1, 5)), PRESETS["tcfit"])
    bent = random_state(stages.parametrisation, 1, 3)
    bent.vector[:, stages.parametrisation.columns.body] *= 1e4
    objective = stages.objective(5, bent, Free())
    assert PRESETS["tcfit"].weights.bending[4] == 0 and bool(objective.cost(bent, torch.tensor([0])).isfinite())
    assert "bending" not in objective.costs(bent, torch.tensor([0]))


def test_undetected_keypoints_do_not_count(scene: Scene):
    """Where a detector puts a keypoint that it has not found means nothing."""
    detections = scene.stages.keypoints
    moved = detections.xy.copy()
    moved[detections.confidence == 0] = -1234.5
    stages = with_positions(stages_of(scene.body, replace(detections, xy=moved), CONFIG, camera=CAMERA))
    whole = random_state(stages.parametrisation, T, 11)
    before, after = (s.objective(5, whole, Free()).normal(whole[FRAMES], FRAMES) for s in (scene.stages, stages))
    for name in ("cost", "gradient", "matrix"):
        assert torch.equal(getattr(before, name), getattr(after, name))


def test_the_docs_table_is_as_written_from_the_terms():
    for path, text in written().items():
        assert path.read_text(encoding="utf-8") == text, f"{path}: run python -m tests.drivers.written_terms"


def test_a_weight_belongs_to_one_term():
    names = [weight for entry in TERMS.values() for weight in entry.weights]
    assert sorted(names) == sorted(field.name for field in fields(PRESETS["paper"].weights))
