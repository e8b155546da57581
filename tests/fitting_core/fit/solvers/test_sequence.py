"""E_T by plain loops, derivatives of terms over time by automatic differentiation, and which residuals count where."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.camera import CameraPath, path_of
from fitting_core.config.schema import FitConfig, SolverSettings
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from fitting_core.fit.solvers.sequence import Coupling, Sequence
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.temporal import OFF_MEAN, Evenness, JointPositions
from fitting_core.fit.terms.term import Derivative, Term
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.state import Free, State
from fitting_core.least_squares import DIAGONAL_FLOOR
from tests.samples.scenes import differentiated, finished, hidden, keypoints_of, random_params, random_state, stages_of

WEIGHT = 70.0


class Scene:
    """E_T over some frames of a clip of random poses; with `terms`, E_o of stage 5 beside it."""

    def __init__(
        self,
        body: BodyModel,
        frames: int,
        *,
        camera: bool = False,
        latent: bool = False,
        terms: bool = False,
        path: CameraPath | None = None,
    ) -> None:
        self.body, self.terms = body, terms
        detections = hidden(keypoints_of(body, random_params(frames, 3)), kp.FACE)
        self.stages: Stages = stages_of(body, detections, FitConfig(), latent=latent)
        self.whole = random_state(self.stages.parametrisation, frames, 4)
        self.joints = JointPositions(body, self.stages.parametrisation, in_camera=camera, path=path)

    def objective(self, groups: Free | None = None, *over_time: Term) -> FrameObjective:
        objective = self.stages.objective(5, self.whole, groups or Free(betas=False))
        terms = [*(objective.terms if self.terms else []), *(over_time or [Evenness(WEIGHT, self.joints)])]
        return FrameObjective(terms, objective.view, objective.free)

    def sequence(self, free: range, groups: Free | None = None, *, windowed: bool = False) -> Sequence:
        return Sequence(self.objective(groups), self.whole, free, windowed=windowed)


def by_loops(scene: Scene, centres: range, *, camera: bool) -> float:
    """w^2 sum over frames, joints and axes of (J_i - mean of J over i - 1, i, i + 1)^2."""
    params = scene.stages.parametrisation.to_params(scene.whole)
    joints = Mesh(scene.body, dtype=torch.float64).joints(params).numpy()
    if not camera:
        joints = joints - params.camera_translation[:, None].numpy()
    if scene.joints.path is not None:  # x_camera = R x_still + t
        turns, moves = np.array(scene.joints.path.rotation), np.array(scene.joints.path.translation)
        joints = np.stack([(joint - camera * t) @ turn for joint, turn, t in zip(joints, turns, moves, strict=True)])
    cost = 0.0
    for i in centres:
        for j in range(55):
            for axis in range(3):
                mean = (joints[i - 1, j, axis] + joints[i, j, axis] + joints[i + 1, j, axis]) / 3
                cost += WEIGHT**2 * (joints[i, j, axis] - mean) ** 2
    return cost


def a_path(frames: int) -> CameraPath:
    """A camera that turns and goes about wildly."""
    random = np.random.default_rng(6)
    turns = Rotation.from_quat(random.normal(0, 1, (frames, 4))).as_matrix()
    return path_of(turns, random.normal(0, 1, (frames, 3)))


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("camera", [False, True])
@pytest.mark.parametrize("frames", [1, 2, 3, 6])
def test_value_by_loops(tiny_body: BodyModel, frames: int, camera: bool, moves: bool):
    scene = Scene(tiny_body, frames, camera=camera, path=a_path(frames) if moves else None)
    sequence = scene.sequence(range(frames))
    expected = by_loops(scene, range(1, frames - 1), camera=camera)
    assert float(sequence.cost(scene.whole, torch.tensor([0]))) == pytest.approx(expected, rel=1e-10)
    assert (expected > 0) == (frames >= 3)


def test_depth_jitter_counts_in_camera_space_alone(tiny_body: BodyModel):
    costs = {}
    for camera in (False, True):
        scene = Scene(tiny_body, 3, camera=camera)
        sequence, where = scene.sequence(range(3)), scene.stages.parametrisation.columns.translation
        moved = scene.whole.vector[:, where].clone()
        moved[1, 2] += 0.3
        moved = scene.whole.with_columns(where, moved)
        costs[camera] = [float(sequence.cost(s, torch.tensor([0]))) for s in (scene.whole, moved)]
    assert costs[False][0] == costs[False][1]
    assert abs(costs[True][0] - costs[True][1]) > 1


CASES = {
    "all frames": (7, range(7), False),
    "three frames": (3, range(3), False),
    "two frames": (2, range(2), False),
    "one frame": (1, range(1), False),
    "first window": (9, range(0, 4), True),
    "inner window": (9, range(3, 7), True),
    "last window": (9, range(5, 9), True),
    "re-run inside": (9, range(4, 6), False),
    "re-run of one frame": (9, range(4, 5), False),
    "re-run at the start": (9, range(0, 2), False),
    "re-run at the end": (9, range(7, 9), False),
}
"""Frames of the clip, those that move, and whether residuals count as in the paper's windows."""


def step_of_all(scene: Scene, sequence: Sequence, free: range) -> Tensor:
    """Half the Hessian's Gauss-Newton part, (n d, n d), from the Jacobian of all residuals of E_T by all frames."""
    local = scene.whole[free.start : free.stop]
    frames = torch.arange(free.start, free.stop)
    jacobian = differentiated(
        lambda s: scene.joints.of(scene.joints.estimate(s, frames)).flatten(1), local, sequence.objective.index
    )
    coupling = sequence.coupled["temporal"].coupling
    matrix = written_out(coupling)[:, coupling.local]
    rows = WEIGHT * torch.einsum("rn,nkd->rknd", matrix, jacobian)
    rows = rows.flatten(2).flatten(0, 1)
    return rows.mT @ rows


def dense(blocks: tuple[Tensor, ...]) -> Tensor:
    diagonal, *below = blocks
    n, d = diagonal.shape[:2]
    matrix = diagonal.new_zeros(n, d, n, d)
    for i in range(n):
        matrix[i, :, i] = diagonal[i]
    for k, off in enumerate(below, 1):
        assert len(off) == max(n - k, 0)
        for i in range(n - k):
            matrix[i + k, :, i], matrix[i, :, i + k] = off[i], off[i].mT
    return matrix.view(n * d, n * d)


VARIANTS = [
    *((case, False, False, False) for case in CASES),
    *((case, latent, True, False) for case in ("three frames", "inner window") for latent in (False, True)),
    ("re-run inside", True, False, False),
    *(("inner window", False, camera, True) for camera in (False, True)),
]


@pytest.mark.parametrize(("case", "latent", "camera", "moves"), VARIANTS)
def test_blocks_and_gradient(
    tiny_body: BodyModel, case: str, latent: bool, camera: bool, moves: bool, monkeypatch: pytest.MonkeyPatch
):
    """The bands against dense Gauss-Newton, the gradient against autograd of the cost; chunks of 3 frames."""
    monkeypatch.setattr("fitting_core.fit.solvers.sequence.jacobians_at_once", lambda _: 3)
    frames, free, windowed = CASES[case]
    scene = Scene(tiny_body, frames, camera=camera, latent=latent, path=a_path(frames) if moves else None)
    sequence = scene.sequence(free, Free(betas=False, face=False, hands=not latent), windowed=windowed)
    local, group = scene.whole[free.start : free.stop], torch.tensor([0])
    cost, gradient, *blocks = sequence.normal(local, group)
    torch.testing.assert_close(cost, sequence.cost(local, group), rtol=1e-12, atol=1e-12)
    expected = step_of_all(scene, sequence, free)
    torch.testing.assert_close(dense(tuple(b[0] for b in blocks)), expected, rtol=1e-10, atol=1e-9)

    move = torch.zeros(1, sequence.unknowns, dtype=torch.float64, requires_grad=True)
    total = sequence.cost(local.moved(sequence.spread(move)), group).sum()
    (autograd,) = torch.autograd.grad(total, move)
    torch.testing.assert_close(gradient.flatten(), autograd.flatten() / 2, rtol=1e-9, atol=1e-9)
    assert (float(cost) > 0) == (frames >= 3)


@pytest.mark.parametrize("case", ["all frames", "inner window", "re-run inside", "one frame"])
def test_step_is_the_dense_one(tiny_body: BodyModel, case: str):
    """With E_o beside E_T: the banded solution of the damped system, and what it promises."""
    frames, free, windowed = CASES[case]
    scene = Scene(tiny_body, frames, terms=True)
    sequence = scene.sequence(free, windowed=windowed)
    normal = sequence.normal(scene.whole[free.start : free.stop], torch.tensor([0]))
    _, gradient, *blocks = normal
    matrix, g = dense(tuple(b[0] for b in blocks)), gradient.flatten()
    diagonal = matrix.diagonal().view(len(free), -1)
    extra = 0.1 * diagonal.mean(1, keepdim=True) + DIAGONAL_FLOOR * diagonal.amax(1, keepdim=True)
    extra = extra.expand_as(diagonal).flatten()
    expected = -torch.linalg.solve(matrix + extra.diag(), g)
    step = sequence.solve(normal, torch.tensor([0.1], dtype=torch.float64))
    assert step.solved.tolist() == [True]
    torch.testing.assert_close(step.move[:, sequence.objective.index].flatten(), expected, rtol=1e-6, atol=1e-9)
    # E(x) - E(x + m) of the quadratic model is -2 g m - m H m, and (H + D) m = -g
    promised = float(-2 * g @ expected - expected @ matrix @ expected)
    assert float(step.predicted) == pytest.approx(promised, rel=1e-6)


def test_not_positive_definite_is_reported(tiny_body: BodyModel):
    scene = Scene(tiny_body, 4, terms=True)
    sequence = scene.sequence(range(4))
    normal = list(sequence.normal(scene.whole, torch.tensor([0])))
    normal[2] = normal[2] - 1e9 * torch.eye(normal[2].shape[-1], dtype=torch.float64)
    step = sequence.solve(tuple(normal), torch.tensor([1e-3], dtype=torch.float64))
    assert step.solved.tolist() == [False] and float(step.move.abs().max()) == 0


def written_out(coupling: Coupling) -> Tensor:
    """L, residuals x frames of the span."""
    return OFF_MEAN(torch.eye(len(coupling.span), dtype=torch.float64))


def counted(coupling: Coupling) -> set[int]:
    """Frames on which a residual is centred."""
    matrix = written_out(coupling)
    centres = {int(row.argmax()) + coupling.span.start for row in matrix}
    assert len(centres) == len(matrix) == coupling.residuals
    for row in matrix:
        np.testing.assert_allclose(sorted(row[row != 0]), [-1 / 3, -1 / 3, 2 / 3])
        assert abs(float(row.sum())) < 1e-15
    return centres


@pytest.mark.parametrize(
    ("frames", "free", "windowed", "expected"),
    [
        (1, range(1), False, set()),
        (2, range(2), False, set()),
        (3, range(3), False, {1}),
        (8, range(8), False, set(range(1, 7))),
        # A window: all its frames but the last, the frame before it is a constant.
        (12, range(0, 7), True, {1, 2, 3, 4, 5}),
        (12, range(3, 10), True, set(range(3, 9))),
        (12, range(5, 12), True, set(range(5, 11))),
        # A re-run: every residual that looks at a free frame.
        (12, range(4, 6), False, {3, 4, 5, 6}),
        (12, range(0, 1), False, {1}),
        (12, range(11, 12), False, {10}),
        (12, range(1, 2), False, {1, 2}),
    ],
)
def test_which_residuals_count(frames: int, free: range, windowed: bool, expected: set[int]):
    coupling = Coupling.of(free, frames, OFF_MEAN.reach, windowed=windowed)
    assert counted(coupling) == expected
    assert set(free) <= set(coupling.span) <= set(range(frames))
    assert list(coupling.span)[coupling.local] == list(free)
    matrix = written_out(coupling)
    assert torch.allclose(OFF_MEAN.transposed(torch.eye(len(matrix), dtype=matrix.dtype), len(coupling.span)), matrix.T)
    square = matrix.T @ matrix
    for k, band in enumerate(OFF_MEAN.square(len(coupling.span), matrix)):
        below = square.diagonal(-k) if k < len(square) else square[0, :0]
        assert torch.allclose(band[: len(below)], below) and not band[len(below) :].any()


def test_cost_of_a_rerun_looks_at_the_frames_around_it(tiny_body: BodyModel):
    """A change of a held neighbour within two frames changes the cost, one farther away does not."""
    scene = Scene(tiny_body, 12)
    local, group = scene.whole[5:7], torch.tensor([0])
    before = float(scene.sequence(range(5, 7)).cost(local, group))
    where = scene.stages.parametrisation.columns.body
    for frame in range(12):
        pose = scene.whole.vector[:, where].clone()
        pose[frame] += 0.1
        moved: State = scene.whole.with_columns(where, pose)
        after = Sequence(scene.objective(), moved, range(5, 7)).cost(local, group)
        assert (float(after) != before) == (frame in (3, 4, 7, 8)), frame


@dataclass(frozen=True)
class Hurry(Term):
    """A user's own term over time, of which nothing is known but its residual: haste of an arm and of a point."""

    name: str = "hurry"
    reach: ClassVar[int] = 1

    def residual(self, e: Estimate) -> Tensor:
        pose, place = e.body_pose[:, 45:48], e.in_camera[:, 3]
        return torch.cat([torch.tanh(4 * (pose[2:] - pose[:-2])), (place[2:] - place[1:-1]) ** 2], 1)


@dataclass(frozen=True)
class Swing(Term):
    """One that looks two frames back and one ahead, so that frames four apart are coupled."""

    name: str = "swing"
    reach: ClassVar[int] = 2

    def residual(self, e: Estimate) -> Tensor:
        turn, pose = e.state.orient[:, 0], e.body_pose[:, 50:52]
        return torch.cat([turn[:-4] * turn[3:-1], torch.sin(pose[2:-2] - pose[:-4])], 1)


class Unknown(Evenness):
    """E_T as if nothing were known of its derivatives."""

    derivative: ClassVar = Derivative.AUTOMATIC


def all_residuals(objective: FrameObjective, clip: State, free: range, move: Tensor) -> Tensor:
    """Of the terms over time at all frames of the clip, with the free ones moved."""
    frames = torch.arange(free.start, free.stop)
    moved = clip.put(frames, clip[frames].moved(objective.step(move)))
    e = Estimate(objective.view, moved, torch.arange(len(clip)))
    terms = [term for term in objective.coupling if len(clip) > 2 * term.reach]
    return torch.cat([move.new_zeros(0), *(term.residual(e).flatten() for term in terms)])


OVER_TIME = {"hurry": (Hurry(),), "swing": (Swing(),), "both": (Hurry(), Swing())}


PLACES = [case for case, (_, _, windowed) in CASES.items() if not windowed]


@pytest.mark.parametrize(
    ("terms", "case", "latent"),
    [
        *(("both", case, False) for case in PLACES),
        *((terms, case, False) for terms in ("hurry", "swing") for case in ("all frames", "re-run inside")),
        *(("both", case, True) for case in ("all frames", "re-run inside")),
    ],
)
def test_a_term_over_time_needs_no_more_than_its_residual(tiny_body: BodyModel, terms: str, case: str, latent: bool):
    """Gradient and blocks against those of all residuals of the clip, by all free numbers at once."""
    frames, free, _ = CASES[case]
    scene = Scene(tiny_body, frames, latent=latent)
    objective = scene.objective(Free(hands=False, face=False, betas=False), *OVER_TIME[terms])
    sequence, local = Sequence(objective, scene.whole, free), scene.whole[free.start : free.stop]
    cost, gradient, *blocks = sequence.normal(local, torch.tensor([0]))
    assert len(blocks) == 1 + 2 * max(term.reach for term in OVER_TIME[terms])
    move = torch.zeros(len(free), len(objective.index), dtype=torch.float64)
    residual = all_residuals(objective, scene.whole, free, move)
    assert bool(residual.any()) == (frames > 2 * min(term.reach for term in OVER_TIME[terms]))
    jacobian = residual.new_zeros(0, move.numel())
    if len(residual):
        jacobian = torch.func.jacrev(lambda m: all_residuals(objective, scene.whole, free, m))(move).flatten(1)
    torch.testing.assert_close(gradient.flatten(), jacobian.T @ residual, rtol=1e-9, atol=1e-10)
    torch.testing.assert_close(dense(tuple(b[0] for b in blocks)), jacobian.T @ jacobian, rtol=1e-9, atol=1e-10)
    torch.testing.assert_close(cost, sequence.cost(local, torch.tensor([0])))
    assert bool(jacobian.any()) == bool(residual.any()) == (float(cost) > 0)


@pytest.mark.parametrize("case", ["three frames", "inner window"])
def test_closed_form_is_that_of_automatic_differentiation(tiny_body: BodyModel, case: str):
    frames, free, windowed = CASES[case]
    scene, found = Scene(tiny_body, frames, camera=True), []
    for kind in (Evenness, Unknown):
        objective = scene.objective(Free(hands=False, face=False, betas=False), kind(WEIGHT, scene.joints))
        sequence = Sequence(objective, scene.whole, free, windowed=windowed)
        found.append(sequence.normal(scene.whole[free.start : free.stop], torch.tensor([0])))
    for known, by_autograd in zip(*found, strict=True):
        torch.testing.assert_close(known, by_autograd, rtol=1e-9, atol=1e-9)


def test_a_term_cannot_declare_what_its_reach_does_not_allow():
    with pytest.raises(AssertionError, match="Late has a reach of 1: its derivative is one of AUTOMATIC, STENCIL"):

        class Late(Hurry):
            derivative: ClassVar = Derivative.ROWS

    with pytest.raises(AssertionError, match="Still has a reach of 0"):

        class Still(Evenness):
            reach: ClassVar[int] = 0


def test_terms_of_different_reach_are_minimised_together(tiny_body: BodyModel):
    """With E_o and E_T beside them, as a term of the table would be."""
    scene = Scene(tiny_body, 6, terms=True)
    objective = scene.objective(None, Evenness(WEIGHT, scene.joints), Hurry(), Swing())
    sequence = Sequence(objective, scene.whole, range(6))
    solution = finished(LevenbergMarquardt(SolverSettings(iterations=5)).minimise(sequence, scene.whole, final=True))
    assert float(solution.cost) < 0.5 * float(sequence.cost(scene.whole, torch.tensor([0])))
    terms = sequence.terms(solution.state)
    assert set(terms) >= {"temporal", "hurry", "swing"}
    assert 6 * sum(terms.values()) == pytest.approx(float(solution.cost))
