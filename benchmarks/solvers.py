"""Levenberg-Marquardt against L-BFGS: the five stages of phase 1 from the same start on the same cost.

Start is the camera step's result; 180 degree tests and relay are off. Frames are solved one at a time, as SMPLify-X
does it, and all together.
"""

import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Int
from torch import Tensor
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import read
from benchmarks.measures import Figures
from benchmarks.real_clips import config_of
from benchmarks.report import Common, Row, progress, report, start
from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.events import drained
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.phases.initialize import guess_depth, starting_state
from fitting_core.fit.solvers import SOLVERS, Solver, make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.solvers.solution import Solution
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.variables.state import State
from tests.samples.excerpts import picked, spread

_HAND_POINTS = 15
"""A hand counts as detected from so many of its 21 keypoints on."""


@dataclass(frozen=True, kw_only=True)
class Solvers:
    """Which frames, which cost, which solvers."""

    solvers: tuple[str, ...] = tuple(SOLVERS)
    """Ratios are against the first."""
    preset: str = "paper"
    """Whose weights and terms make the cost."""
    pose_priors: tuple[str, ...] = ()
    """Compare on each of these pose priors (names or files); by default on the preset's."""
    one_at_a_time: bool = True
    """Also solve frame by frame, as SMPLify-X does it."""
    balancing_frames: int = 10
    """Frames with body keypoints only, spread over cam03."""
    signing_frames: int = 6
    """Frames with hands and face, spread over gebaerden; 0: none."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def with_hands(clip: Clip) -> Int[np.ndarray, "n"]:
    """Frames in which at least one hand and the face were detected."""
    seen = clip.keypoints.confidence > 0
    hands = np.maximum(seen[:, kp.LEFT_HAND].sum(1), seen[:, kp.RIGHT_HAND].sum(1)) >= _HAND_POINTS
    return np.flatnonzero(hands & seen[:, kp.FACE].any(1))


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


def five_stages(stages: Stages, solver: Solver, state: State, groups: list[Tensor]) -> Outcome:
    """All stages in a row; frames of one group are solved together. Only the solver's own time counts."""
    evaluations, seconds = 0, 0.0
    for frames in groups:
        for stage in range(1, N_STAGES + 1):
            problem = IndependentFrames(stage_objective(stages, stage, state), frames)
            begin = time.perf_counter()
            solution = solved(solver, problem, state[frames], final=stage == N_STAGES)
            seconds += time.perf_counter() - begin
            state = state.put(frames, solution.state)
            evaluations += solution.evaluations
    return Outcome(state=state, seconds=seconds, evaluations=evaluations)


def stage_objective(stages: Stages, stage: int, state: State) -> FrameObjective:
    """The objective of a stage with everything free that phase 1 frees in it."""
    free = stages.free(stage, betas=True, resting=True, translation=not stages.config.camera_frozen)
    return stages.objective(stage, state, free)


def compared(clip: Clip, body: BodyModel, options: Solvers, config: FitConfig) -> list[Row]:
    """A row for each solver and each way to group the frames."""
    stages = Stages.of_clip(clip, body, config)
    origin = camera_start(stages)
    ways = {"one at a time": list(stages.all_frames[:, None])} if options.one_at_a_time else {}
    ways["together"] = [stages.all_frames]
    rows: list[Row] = []
    for way, groups in ways.items():
        outcomes: list[tuple[str, Figures]] = []
        for name in options.solvers:
            progress(f"{clip.name}, {len(clip)} frames {way}, {name}")
            outcome = five_stages(stages, make_solver(name, config.settings), origin, groups)
            outcomes.append((name, figures(stages, outcome)))
        rows += [
            {"frames": f"{len(clip)} {way}", "prior": Path(config.pose_prior).stem, "solver": n}
            | f
            | _ratios(f, outcomes[0])
            for n, f in outcomes
        ]
    return rows


def figures(stages: Stages, outcome: Outcome) -> Figures:
    """What one run came to; the objective is the last stage's, with the face contour as the result turns it."""
    cost = stage_objective(stages, N_STAGES, outcome.state).cost(outcome.state, stages.all_frames)
    count = len(stages.all_frames)
    return {
        "mean objective": float(cost.mean()),
        "median objective": float(cost.median()),
        "evaluations / frame": outcome.evaluations / count,
        "s / frame": outcome.seconds / count,
    }


def _ratios(here: Figures, first: tuple[str, Figures]) -> Figures:
    name, there = first
    return {f"{what} / {name}": here[what] / there[what] for what in ("mean objective", "s / frame")}


def _on_each_prior(clip: Clip, body: BodyModel, options: Solvers) -> list[Row]:
    config = replace(config_of(options.preset), relay_rounds=0)
    priors = options.pose_priors or (config.pose_prior,)
    return [row for prior in priors for row in compared(clip, body, options, replace(config, pose_prior=prior))]


def run(options: Solvers) -> None:
    """Compares the solvers on both kinds of frames."""
    body, tables = options.common.load_body(), {}
    balancing = read("cam03").clip
    chosen = spread(np.arange(len(balancing)), options.balancing_frames)
    tables["Balancing, body keypoints"] = _on_each_prior(picked(balancing, chosen), body, options)
    if options.signing_frames:
        signing = read("gebaerden").clip
        chosen = spread(with_hands(signing), options.signing_frames)
        tables["Signing, body, hands and face"] = _on_each_prior(picked(signing, chosen), body, options)
    report(options, tables)


if __name__ == "__main__":
    start(Solvers, run)
