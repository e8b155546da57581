"""The five stages of phase 1 alone, from one start that all solvers share: what a comparison of solvers needs."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from fitting_core.fit.events import drained
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.phases.initialize import guess_depth, starting_state
from fitting_core.fit.solvers import Solver, make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.solvers.solution import Solution
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.variables.state import State


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Five stages over some frames."""

    state: State
    seconds: float
    evaluations: int


def solved(solver: Solver, problem: IndependentFrames, state: State, *, final: bool) -> Solution:
    """The solution of a minimisation, without its progress."""
    return drained(solver.minimise(problem, state, final=final))


def camera_start(stages: Stages) -> State:
    """What all solvers start from: the camera step, facing the camera, solved by lm."""
    depth = guess_depth(stages).depth
    problem = IndependentFrames(stages.camera_objective(depth), stages.all_frames)
    solver = make_solver("lm", stages.config.settings)
    return solved(solver, problem, starting_state(stages, depth, 0.0), final=True).state


def five_stages(
    stages: Stages,
    solver: Solver,
    state: State,
    groups: list[Tensor],
    *,
    clock: Callable[[], float] = time.perf_counter,
) -> Outcome:
    """All stages in a row; frames of one group are solved together. Only the solver's own time counts."""
    evaluations, seconds = 0, 0.0
    for frames in groups:
        for stage in range(1, N_STAGES + 1):
            problem = IndependentFrames(stage_objective(stages, stage, state), frames)
            begin = clock()
            solution = solved(solver, problem, state[frames], final=stage == N_STAGES)
            seconds += clock() - begin
            state = state.put(frames, solution.state)
            evaluations += solution.evaluations
    return Outcome(state=state, seconds=seconds, evaluations=evaluations)


def stage_objective(stages: Stages, stage: int, state: State) -> FrameObjective:
    """The objective of a stage with everything free that phase 1 frees in it."""
    free = stages.free(stage, betas=True, resting=True, translation=not stages.config.camera_frozen)
    return stages.objective(stage, state, free)
