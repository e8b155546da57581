"""Phase 3 on its own: windows, the order of stages, and what a re-run may touch."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.points.body_points import BodyPoints, Posed
from fitting_core.config.schema import FitConfig, SolverSettings, Temporal, Weights
from fitting_core.fit.phases.consistency import Consistency, coupled
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.temporal import REACH
from fitting_core.fit.variables.state import State
from fitting_core.results.provenance import Stopped
from tests.samples.scenes import CAMERA, finished, hidden, keypoints_of, listed, random_params, random_state, stages_of

FRAMES = 6
CONFIG = FitConfig(
    weights=replace(Weights(), collision=(0.0,) * 5),
    temporal=Temporal(window_size=3, stages=(4, 5)),
    settings=SolverSettings(iterations=3),
)


def start_of(body: BodyModel, config: FitConfig, frames: int = FRAMES) -> tuple[Consistency, State]:
    stages = stages_of(body, hidden(keypoints_of(body, random_params(frames)), kp.HANDS, kp.FACE), config)
    state = random_state(stages.parametrisation, frames, 0)
    betas = stages.parametrisation.columns.betas
    state = state.with_columns(betas, state.vector[:1, betas].expand(frames, 10))
    return Consistency(stages, make_solver("lm", config.settings)), state


def cost_of(consistency: Consistency, start: State) -> Callable[[State], float]:
    """The whole clip's E_o of stage 5 and E_T."""
    stages = consistency.stages
    objective = stages.objective(5, start, stages.free(5, betas=False))
    return lambda s: float(objective.cost(s, stages.all_frames).sum()) + sum(objective.costs_over_time(s).values())


@pytest.mark.usefixtures("in_torch")
def test_a_window_poses_no_frame_that_it_is_not_coupled_to(tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    """Else the cost of all windows is quadratic in the clip's length."""
    posed, forward = [], BodyPoints.forward

    def counted(self: BodyPoints, orient: Tensor, *rest: Any, **options: Any) -> Posed:
        posed.append(len(orient))
        return forward(self, orient, *rest, **options)

    quick = replace(CONFIG, temporal=replace(CONFIG.temporal, stages=(5,)), settings=SolverSettings(iterations=1))
    consistency, state = start_of(tiny_body, quick, frames=8)
    monkeypatch.setattr(BodyPoints, "forward", counted)
    finished(consistency.sliding_window(state))
    assert max(posed) == CONFIG.temporal.window_size + REACH  # the frames before it, which its residuals look at


@pytest.mark.thorough
def test_a_long_clip_is_fitted_in_parts_that_overlap(tiny_body: BodyModel, monkeypatch: pytest.MonkeyPatch):
    """To nearly the cost of the whole; what a part leaves to no other one is final."""
    frames, config = 16, replace(CONFIG, settings=SolverSettings(iterations=60, sequence_tolerance=1e-9))
    consistency, state = start_of(tiny_body, config, frames)
    stages, cost = consistency.stages, cost_of(consistency, state)
    best = finished(consistency.all_at_once(state))
    state = best.moved(0.01 * torch.randn(best.vector.shape, generator=torch.manual_seed(0), dtype=torch.float64))
    betas = stages.parametrisation.columns.betas
    state = state.with_columns(betas, best.vector[:, betas])  # which no phase 3 moves
    monkeypatch.setattr("fitting_core.fit.phases.consistency._PART", 12)
    monkeypatch.setattr("fitting_core.fit.phases.consistency._SEAM", 8)
    steps, end = listed(consistency.all_at_once(state))
    assert [step.label for step in steps][-1] == "part 2 of 2, stage 5 of 5"
    fitted = [step.fitted for step in steps if step.fitted is not None]
    assert [(part.start, part.stop) for part, _ in fitted] == [(0, 4)]
    for part, params in fitted:
        last = stages.parametrisation.to_params(end[part.start : part.stop])
        torch.testing.assert_close(params.body_pose, last.body_pose, rtol=0, atol=1e-12)
    assert cost(end) < 1.001 * cost(best) < 0.9 * cost(state)
    assert (consistency.stopped != Stopped.UNKNOWN).all()


@pytest.mark.parametrize("frames", [range(0, 2), range(2, 4), range(3, 4), range(5, 6), range(0, 6)])
def test_a_rerun_moves_its_frames_alone_and_lowers_the_whole_cost(tiny_body: BodyModel, frames: range):
    consistency, state = start_of(tiny_body, replace(CONFIG, temporal=replace(CONFIG.temporal, stages=(5,))))
    end = finished(consistency.rerun(state, frames))
    for i in range(FRAMES):
        assert torch.equal(end.vector[i], state.vector[i]) == (i not in frames)
    whole = cost_of(consistency, state)
    assert whole(end) < whole(state)


def test_a_rerun_counts_the_residuals_of_the_frames_around_it(tiny_body: BodyModel):
    """Where all frames are near their optimum already, a re-run cannot lower its part at the cost of the whole."""
    temporal = replace(CONFIG.temporal, weight=1000.0, stages=(5,))
    consistency, state = start_of(
        tiny_body, replace(CONFIG, temporal=temporal, settings=SolverSettings(iterations=40, sequence_tolerance=1e-9))
    )
    best = finished(consistency.all_at_once(state))
    whole = cost_of(consistency, state)
    for frames in (range(2, 4), range(0, 1), range(5, 6)):
        assert whole(finished(consistency.rerun(best, frames))) <= whole(best) * (1 + 1e-12)


@pytest.mark.parametrize("frames", [range(0, 2), range(2, 4), range(5, 6)])
def test_a_rerun_among_what_is_coupled_is_that_of_the_whole_clip(tiny_body: BodyModel, frames: range):
    consistency, state = start_of(tiny_body, replace(CONFIG, temporal=replace(CONFIG.temporal, stages=(5,))))
    near = coupled(frames, FRAMES)
    part = Consistency(consistency.stages.within(near), consistency.solver)
    inner = range(frames.start - near.start, frames.stop - near.start)
    alone = finished(part.rerun(state[slice(near.start, near.stop)], inner))
    whole = finished(consistency.rerun(state, frames))
    torch.testing.assert_close(alone.vector, whole.vector[near.start : near.stop], rtol=0, atol=1e-9)
    torch.testing.assert_close(alone.orient, whole.orient[near.start : near.stop], rtol=0, atol=1e-9)


def test_more_weight_makes_smoother(tiny_body: BodyModel):
    costs = []
    for weight in (10.0, 100.0, 1000.0):
        temporal = replace(CONFIG.temporal, weight=weight, stages=(5,))
        settings = SolverSettings(iterations=25)
        consistency, state = start_of(tiny_body, replace(CONFIG, temporal=temporal, settings=settings))
        end, stages = finished(consistency.all_at_once(state)), consistency.stages
        objective = stages.objective(5, end, stages.free(5, betas=False))
        costs.append(objective.costs_over_time(end)["temporal"] / weight**2)
    assert costs[0] > costs[1] > costs[2]


def test_weight_follows_the_frame_rate_where_asked(tiny_body: BodyModel):
    """Twice the frames of one motion: second differences a quarter as long, so w_T four times as large."""
    config = replace(CONFIG, temporal=replace(CONFIG.temporal, weight=80.0, reference_rate=25.0))
    keypoints = hidden(keypoints_of(tiny_body, random_params(2)), kp.HANDS, kp.FACE)
    built = {rate: Stages.of(keypoints, CAMERA, tiny_body, config, frame_rate=rate) for rate in (25.0, 50.0)}
    assert built[25.0].temporal_weight == 80.0 and built[50.0].temporal_weight == 320.0
    plain = replace(CONFIG, temporal=replace(CONFIG.temporal, weight=80.0))
    assert Stages.of(keypoints, CAMERA, tiny_body, plain, frame_rate=50.0).temporal_weight == 80.0
