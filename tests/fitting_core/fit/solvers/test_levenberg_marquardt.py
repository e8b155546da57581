"""Levenberg-Marquardt where the optimum is known, and the damped steps of each structure against dense algebra."""

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from fitting_core.body.model import BodyModel
from fitting_core.config.schema import FitConfig, SolverSettings
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from fitting_core.fit.solvers.problem import IndependentFrames, Sample, SharedShape
from fitting_core.fit.solvers.solution import Progress, Solution
from fitting_core.fit.terms.quadratic import Quadratic
from fitting_core.fit.variables.state import Free, State
from fitting_core.least_squares import DIAGONAL_FLOOR, Descent, Step, damping_diagonal
from tests.samples.scenes import finished, keypoints_of, listed, noisy, random_params, random_state, stages_of

EXACT = SolverSettings(final_tolerance=1e-14, stage_tolerance=1e-14, iterations=300)


def rosenbrock(x: Tensor) -> Tensor:
    """Minimum 0 at (1, 1), at the end of a curved valley."""
    return torch.stack([10 * (x[..., 1] - x[..., 0] ** 2), 1 - x[..., 0]], -1)


def powell(x: Tensor) -> Tensor:
    """Powell's singular function: minimum 0 at zero, where the Jacobian loses rank."""
    a, b, c, d = x.unbind(-1)
    return torch.stack([a + 10 * b, math.sqrt(5) * (c - d), (b - 2 * c) ** 2, math.sqrt(10) * (a - d) ** 2], -1)


class Toy:
    """Independent least squares problems in the columns 3 and on of a state; cost infinite where `allowed` says no."""

    coupled = False
    cold = False

    def __init__(
        self,
        function: Callable[[Tensor], Tensor],
        start: Tensor,
        allowed: Callable[[Tensor], Tensor] = lambda x: torch.ones(len(x), dtype=torch.bool),
    ) -> None:
        self.function, self.groups, self.unknowns, self.allowed = function, len(start), start.shape[1], allowed
        vector = torch.cat([torch.zeros(len(start), 3, dtype=start.dtype), start], 1)
        self.start = State(torch.eye(3, dtype=start.dtype).repeat(len(start), 1, 1), vector)

    def rows(self, groups: Tensor) -> Tensor:
        return groups

    def softened(self) -> None:
        return None

    def descents(self, start: State, *, iterations: int, tolerance: float) -> None:
        return None

    def descent(self, start: State) -> Descent[State]:
        return Descent(self, start, torch.arange(self.groups))

    def spread(self, x: Tensor) -> Tensor:
        return torch.cat([torch.zeros(len(x), 3, dtype=x.dtype), x], 1)

    def cost(self, state: State, groups: Tensor) -> Tensor:
        x = state.vector[:, 3:]
        return torch.where(self.allowed(x), self.function(x).square().sum(1), torch.inf)

    def normal(self, state: State, groups: Tensor) -> tuple[Tensor, ...]:
        x = state.vector[:, 3:]
        jacobian = torch.func.vmap(torch.func.jacrev(self.function))(x)
        gradient = (jacobian.mT @ self.function(x)[..., None])[..., 0]
        return self.cost(state, groups), gradient, jacobian.mT @ jacobian

    def solve(self, normal: tuple[Tensor, ...], damping: Tensor) -> Step:
        _, gradient, matrix = normal
        extra = damping_diagonal(matrix.diagonal(dim1=1, dim2=2), damping)
        factor, info = torch.linalg.cholesky_ex(matrix + extra.diag_embed())
        move = -torch.cholesky_solve(gradient[..., None], factor)[..., 0]
        predicted = -(gradient * move).sum(1) + (extra * move * move).sum(1)
        return Step(self.spread(move), predicted, info == 0)


def minimised(toy: Toy, settings: SolverSettings = EXACT) -> tuple[Solution, list[Progress]]:
    progress, solution = listed(LevenbergMarquardt(settings).minimise(toy, toy.start, final=True))
    return solution, progress


STARTS = torch.tensor([[-1.2, 1.0], [5.0, -7.0], [0.0, 0.0], [1.0, 1.0], [30.0, 2.0]], dtype=torch.float64)


def test_known_optima():
    solution, _ = minimised(Toy(rosenbrock, STARTS))
    torch.testing.assert_close(solution.state.vector[:, 3:], torch.ones_like(STARTS), rtol=0, atol=1e-7)
    singular, _ = minimised(Toy(powell, torch.tensor([[3.0, -1, 0, 1]], dtype=torch.float64)))
    assert float(singular.cost) < 1e-12
    assert set(solution.reason) == {"converged"}


def test_cost_never_rises():
    _, progress = minimised(Toy(rosenbrock, STARTS))
    costs = torch.stack([p.cost for p in progress])
    assert (costs[1:] <= costs[:-1]).all() and len(costs) > 5
    assert [p.iteration for p in progress] == list(range(1, len(progress) + 1))
    assert [p.running for p in progress] == sorted((p.running for p in progress), reverse=True)


def test_yielded_costs_are_copies():
    """An event that a consumer keeps must not change under its hands."""
    steps = LevenbergMarquardt(EXACT).minimise(toy := Toy(rosenbrock, STARTS), toy.start, final=True)
    first = next(steps).cost
    kept = first.clone()
    finished(steps)
    assert torch.equal(first, kept)


def test_a_group_alone_ends_where_it_ends_in_the_batch():
    together, _ = minimised(Toy(rosenbrock, STARTS))
    for i in range(len(STARTS)):
        alone, _ = minimised(Toy(rosenbrock, STARTS[i : i + 1]))
        torch.testing.assert_close(alone.state.vector, together.state.vector[i : i + 1], rtol=0, atol=1e-12)
        assert alone.reason[0] == together.reason[i]


def test_infinite_start_is_returned_as_it_came():
    toy = Toy(rosenbrock, STARTS, allowed=lambda x: x[:, 0] > -1)
    solution, _ = minimised(toy)
    assert solution.reason == ("failed", *["converged"] * 4)
    assert solution.cost[0].isinf()
    assert torch.equal(solution.state.vector[0], toy.start.vector[0])
    torch.testing.assert_close(solution.state.vector[1:, 3:], torch.ones(4, 2, dtype=torch.float64), rtol=0, atol=1e-7)


def test_steps_to_forbidden_places_are_refused():
    """From x = 10 the full step for log(x) = 0 leads to -13, where there is no logarithm."""
    toy = Toy(torch.log, torch.tensor([[10.0], [500.0]], dtype=torch.float64), allowed=lambda x: x[:, 0] > 0)
    solution, progress = minimised(toy)
    torch.testing.assert_close(solution.state.vector[:, 3], torch.ones(2, dtype=torch.float64), rtol=0, atol=1e-7)
    assert torch.equal(progress[0].cost, toy.cost(toy.start, torch.arange(2)))  # refused, not taken
    assert all(p.cost.isfinite().all() for p in progress)


class Misled(Toy):
    """Its gradient points uphill, so that no step lowers the cost however short it is."""

    def normal(self, state: State, groups: Tensor) -> tuple[Tensor, ...]:
        cost, gradient, matrix = super().normal(state, groups)
        return cost, -gradient, matrix


def test_a_group_that_no_step_lowers_is_not_called_converged():
    """The damping runs out; a start at the optimum ends the same way and has converged."""
    solution, _ = minimised(Misled(rosenbrock, STARTS))
    assert solution.reason == ("stalled", "stalled", "stalled", "converged", "stalled")
    assert torch.equal(solution.state.vector[:, 3:], STARTS)


@pytest.fixture(scope="module")
def objective(tiny_body: BodyModel):
    """E_o of stage 4 (no contour) on noisy keypoints, all columns free, and a state near the truth."""
    detections = noisy(keypoints_of(tiny_body, random_params(5, 1)), 5.0)
    stages = stages_of(tiny_body, detections, FitConfig())
    state = random_state(stages.parametrisation, 5, 1)
    return stages.objective(3, state, Free()), state


@pytest.fixture(params=["compiled", "torch"])
def either(request: pytest.FixtureRequest, objective):
    """The same with the kernels, where they are compiled, and without."""
    e, state = objective
    if request.param == "torch":
        request.getfixturevalue("in_torch")
        e = FrameObjective(e.terms, e.view, e.free)
        assert e.fused is None
    return e, state


def holding(objective: FrameObjective, weight: float) -> FrameObjective:
    """The same with the shared betas held at 0."""
    betas = objective.view.parametrisation.columns.betas
    held = Quadratic("held", betas, torch.full((10,), weight, dtype=torch.float64), once=True)
    return FrameObjective([*objective.terms, held], objective.view, objective.free)


def test_step_of_independent_frames_is_the_dense_one(objective):
    e, state = objective
    problem = IndependentFrames(e, torch.arange(5))
    normal = problem.normal(state, torch.arange(5))
    step = problem.solve(normal, torch.full((5,), 0.01, dtype=torch.float64))
    for i in range(5):
        matrix, gradient = normal[2][i], normal[1][i]
        extra = 0.01 * matrix.diagonal().mean() + DIAGONAL_FLOOR * matrix.diagonal().max()
        expected = -torch.linalg.solve(matrix + extra * torch.eye(len(matrix), dtype=torch.float64), gradient)
        torch.testing.assert_close(step.move[i, e.index], expected, rtol=1e-6, atol=1e-9)
        promised = float(-2 * gradient @ expected - expected @ matrix @ expected)
        assert float(step.predicted[i]) == pytest.approx(promised, rel=1e-6)
    still = torch.ones(step.move.shape[1], dtype=torch.bool)
    still[e.index] = False
    assert float(step.move[:, still].abs().sum()) == 0


def test_step_of_shared_shape_is_the_dense_one(objective):
    """The Schur complement on the betas against the whole arrow matrix with one block of betas."""
    e, state = objective
    frames, weight, damping = torch.tensor([3, 0, 4]), 7.0, 0.02
    betas = e.view.parametrisation.columns.betas
    state = state[frames]
    state = state.with_columns(betas, state.vector[:, betas].mean(0).expand(3, -1))
    problem = SharedShape(Sample(holding(e, weight), frames))
    normal = problem.normal(state, torch.tensor([0]))
    n = e.normal(state, frames)
    d = len(e.index)
    own = d - 10
    select = torch.zeros(3, d, 3 * own + 10, dtype=torch.float64)  # each frame's columns from all unknowns
    for i in range(3):
        select[i, :own, i * own : (i + 1) * own] = torch.eye(own)
        select[i, own:, 3 * own :] = torch.eye(10)
    prior = torch.zeros(3 * own + 10, 3 * own + 10, dtype=torch.float64)
    prior[-10:, -10:] = weight**2 * torch.eye(10)
    matrix, gradient = prior.clone(), torch.zeros(3 * own + 10, dtype=torch.float64)
    gradient[-10:] = weight**2 * state.vector[0, betas]
    damped = prior.clone()
    for i in range(3):
        block = n.matrix[i] / 3
        matrix += select[i].mT @ block @ select[i]
        gradient += select[i].mT @ n.gradient[i] / 3
        extra = damping * block.diagonal().mean() + DIAGONAL_FLOOR * block.diagonal().max()
        damped += select[i].mT @ (block + extra * torch.eye(d, dtype=torch.float64)) @ select[i]
    expected = -torch.linalg.solve(damped, gradient)
    step = problem.solve(normal, torch.tensor([damping], dtype=torch.float64))
    torch.testing.assert_close(step.move[:, e.index], select @ expected, rtol=1e-6, atol=1e-8)
    promised = float(-2 * gradient @ expected - expected @ matrix @ expected)
    assert float(step.predicted) == pytest.approx(promised, rel=1e-5)
    shape_cost = weight**2 * state.vector[0, betas].square().sum()
    torch.testing.assert_close(normal[0][0], n.cost.mean() + shape_cost)


def test_whole_descents_find_their_way_back_from_rejected_steps(objective):
    """Where a step too long is not made shorter, a descent goes on proposing it until its iterations are over."""
    e, state = objective
    problem = IndependentFrames(e, torch.arange(5))
    solution = finished(LevenbergMarquardt(SolverSettings()).minimise(problem, state, final=True))
    assert set(solution.reason) == {"converged"}
    assert solution.cost.mean() < 1.1e4  # 10.3 thousand; 17.7 where the damping stays as it is


@pytest.mark.parametrize("structure", ["independent", "shared"])
def test_bodies_behind_the_camera_are_returned_as_they_came(either, structure: str):
    e, state = either
    where = e.view.parametrisation.columns.translation
    behind = state.with_columns(where, -state.vector[:, where])
    frames = torch.arange(5)
    problem = (
        IndependentFrames(e, frames) if structure == "independent" else SharedShape(Sample(holding(e, 3.0), frames))
    )
    solution = finished(LevenbergMarquardt(SolverSettings()).minimise(problem, behind, final=True))
    assert set(solution.reason) == {"failed"} and bool(solution.cost.isinf().all())
    assert torch.equal(solution.state.vector, behind.vector) and torch.equal(solution.state.orient, behind.orient)
