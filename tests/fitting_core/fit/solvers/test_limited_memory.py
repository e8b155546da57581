"""L-BFGS behind the solvers' interface: the same optima as Levenberg-Marquardt on all three problems."""

import pytest
import torch

from fitting_core.config.schema import FitConfig, SolverSettings
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.solvers.problem import IndependentFrames, Problem, Sample, SharedShape
from fitting_core.fit.solvers.sequence import Sequence
from fitting_core.fit.solvers.solution import Solution
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.quadratic import Quadratic
from fitting_core.fit.terms.temporal import JointPositions, Smoothness
from fitting_core.fit.variables.state import State
from tests.samples.posed_clips import clip_of, motion, shipped_body
from tests.samples.scenes import finished, listed

pytestmark = pytest.mark.thorough

FRAMES = 5
TIGHT = SolverSettings(final_tolerance=1e-13, sequence_tolerance=1e-13, iterations=200)


@pytest.fixture(scope="module")
def stages() -> Stages:
    clip = clip_of(motion(FRAMES), noise=1.0)
    return Stages.of(clip.keypoints, clip.camera, shipped_body(), FitConfig(pose_prior="axis_angle"))


@pytest.fixture(scope="module")
def near_truth(stages) -> State:
    """The true motion, joints off by 0.05 rad: from here every solver falls into the same valley."""
    state = stages.parametrisation.from_params(motion(FRAMES))
    move = 0.05 * torch.randn(state.vector.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    betas = stages.parametrisation.columns.betas
    state = state.moved(move)
    return state.with_columns(betas, state.vector[:1, betas].expand(FRAMES, -1))


def every_frame(stages: Stages, state: State) -> Problem:
    return IndependentFrames(stages.objective(2, state, stages.free(2, betas=True)), stages.all_frames)


def one_shape(stages: Stages, state: State) -> Problem:
    objective = stages.objective(2, state, stages.free(2, betas=True))
    terms = [t for t in objective.terms if t.name != "shape"]
    held = Quadratic("held", stages.parametrisation.columns.betas, stages.xy.new_full((10,), 50.0), once=True)
    held_too = FrameObjective([*terms, held], objective.view, objective.free)
    return SharedShape(Sample(held_too, stages.all_frames))


def sequence(stages: Stages, state: State) -> Problem:
    objective = stages.objective(2, state, stages.free(2, betas=False))
    smoothness = Smoothness(100.0, JointPositions(stages.body, stages.parametrisation, in_camera=True))
    return Sequence(
        FrameObjective([*objective.terms, smoothness], objective.view, objective.free), state, range(FRAMES)
    )


PROBLEMS = [every_frame, one_shape, sequence]


def minimise(name: str, problem: Problem, start: State, settings: SolverSettings = TIGHT) -> Solution:
    return finished(make_solver(name, settings).minimise(problem, start, final=True))


@pytest.mark.parametrize("make", PROBLEMS)
def test_ends_where_levenberg_marquardt_ends(stages, near_truth, make):
    problem = make(stages, near_truth)
    lm, lbfgs = (minimise(name, problem, near_truth) for name in ("lm", "lbfgs"))
    assert set(lbfgs.reason) == {"converged"}
    torch.testing.assert_close(lbfgs.cost, lm.cost, rtol=1e-6, atol=0)
    torch.testing.assert_close(lbfgs.state.orient, lm.state.orient, rtol=0, atol=2e-3)
    torch.testing.assert_close(lbfgs.state.vector, lm.state.vector, rtol=0, atol=5e-3)


@pytest.mark.parametrize("make", PROBLEMS)
def test_unknowns_are_the_steps_that_a_normal_matrix_would_solve_for(stages, near_truth, make):
    """A damped Gauss-Newton step lies in the space that the unknowns span, and they span no more than it."""
    problem = make(stages, near_truth)
    x = torch.eye(problem.unknowns, dtype=torch.float64)
    if problem.groups == 1:
        spread = torch.stack([problem.spread(e[None]).flatten() for e in x])
        groups = torch.arange(1)
        target = problem.solve(problem.normal(near_truth, groups), torch.ones(1)).move.flatten()[None]
    else:
        spread = problem.spread(x)
        groups = torch.arange(problem.groups)
        target = problem.solve(problem.normal(near_truth, groups), torch.ones(problem.groups)).move
    assert torch.linalg.matrix_rank(spread) == problem.unknowns
    coordinates = torch.linalg.lstsq(spread.T, target.T).solution
    torch.testing.assert_close(spread.T @ coordinates, target.T, rtol=0, atol=1e-9)


def test_overflowing_bend_does_not_leave_a_trace(stages, near_truth):
    """A knee bent by 400 rad overflows the exponential prior: METHOD tells of a run that it killed."""
    start = near_truth.put(torch.tensor([1]), near_truth[1:2].with_columns(slice(12, 13), torch.tensor([[-400.0]])))
    solution = minimise("lbfgs", every_frame(stages, start), start)
    assert solution.reason[1] == "failed"
    assert solution.cost[[0, 2, 3, 4]].isfinite().all() and solution.state.vector.isfinite().all()


def test_yields_between_evaluations_and_can_be_closed(stages, near_truth):
    solver = make_solver("lbfgs", TIGHT)
    steps = solver.minimise(every_frame(stages, near_truth), near_truth, final=False)
    progress, _ = listed(steps)
    assert len(progress) > 20
    iterations = [p.iteration for p in progress]
    assert iterations == sorted(iterations) and 10 < iterations[-1] <= solver.iterations
    costs = torch.stack([p.cost for p in progress])
    assert (costs.diff(dim=0) <= 0).all() and (costs[-1] < costs[0]).all()
    assert progress[-1].running == 0

    again = solver.minimise(every_frame(stages, near_truth), near_truth, final=False)
    torch.testing.assert_close(next(again).cost, costs[0])
    again.close()
    assert torch.is_grad_enabled()
    with pytest.raises(StopIteration):
        next(again)
