"""Fits of sharp keypoints, level after level; what then turns out to be astray is searched for other minima."""

from collections.abc import Generator
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.fit.phases.progress import Step, reported
from fitting_core.fit.phases.search.many_starts import other_minima
from fitting_core.fit.phases.search.sharpening import (
    LEVELS,
    PARTS,
    astray,
    misfits,
    residuals,
    sharp_settings,
    tells_noise,
    warrants,
)
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.variables.state import State

SEARCHED = (1e3, 1e4)
"""Levels at which frames that are astray are searched. Below them a wrong pose on a shape of its own may cost less than
the right one (one arm behind the back: 928 against 1026 at 100, 1632 against 1241 at 1000)."""
SEARCHED_AT = 100.0
"""Level of the search itself: blunt enough that a descent comes far."""
COMPARED_AT = 1e3
"""Level at which what the search found is compared."""
OTHER_CONTOURS = (0, 1, -1)
"""Degrees from where the head now is: the face contour's tables go by its yaw, as it was before a descent, and a fit
settles in the wrong one where that is on edge."""
_LOWER = 1e-4
"""Share by which a cost must be lower to count."""

Fits = tuple[State, Float[Tensor, "T"]]
"""State of the whole clip and cost of its frames, infinite where none was minimised."""


@dataclass(frozen=True)
class Sharpened:
    """Fits of some frames at one level."""

    stages: Stages

    def descend(self, state: State, frames: Tensor, *, contour: int = 0) -> Generator[Step, None, Fits]:
        """The frames minimised, with the face contour of heads that are turned so much further."""
        config, level = self.stages.config, self.stages.sharpness
        objective = self.stages.objective(N_STAGES, state, self.stages.free(N_STAGES, betas=True))
        objective = objective.with_contour(contour) if contour else objective
        solver = make_solver(config.solver, sharp_settings(config.settings, level))
        minimisation = solver.minimise(IndependentFrames(objective, frames), state[frames], final=True)
        solution = yield from reported(minimisation, f"keypoints x{level:.0f}", (1.0, 1.0), solver.iterations)
        cost = torch.full((len(state),), torch.inf, dtype=solution.cost.dtype, device=solution.cost.device)
        cost[frames] = solution.cost
        return state.put(frames, solution.state), cost

    def astray(self, state: State, frames: Tensor, groups: tuple[slice, ...] = PARTS) -> Int[Tensor, "n"]:
        """Which of the frames stay away from their keypoints, or from those of some groups."""
        return frames[astray(misfits(self.stages, state, groups)[frames], self.stages.sharpness)]

    def other_contours(self, state: State, cost: Tensor, frames: Tensor) -> Generator[Step, None, Fits]:
        """Frames whose faces are astray with the tables of the face contour beside theirs."""
        points = self.stages.data_keypoints(N_STAGES)
        if not bool(((points >= kp.CONTOUR.start) & (points < kp.CONTOUR.stop)).any()):
            return state, cost
        for degrees in OTHER_CONTOURS:
            stuck = self.astray(state, frames, (kp.FACE,))
            if len(stuck):
                other = yield from self.descend(state, stuck, contour=degrees)
                state, cost = lower((state, cost), other)
        return state, cost

    def searched(self, state: State, cost: Tensor, frames: Tensor) -> Generator[Step, None, Fits]:
        """Frames that are astray take another minimum that is lower."""
        stuck = self.astray(state, frames)
        if not len(stuck):
            return state, cost
        level = self.stages.sharpness
        blunt, compared = (Sharpened(self.stages.sharpened(at)) for at in (SEARCHED_AT, COMPARED_AT))
        found = yield from other_minima(blunt.stages, state, stuck, seed=int(level))
        best: Fits = state, torch.full_like(cost, torch.inf)
        for some, start in found:
            trial, _ = yield from blunt.descend(state.put(some, start), some)
            best = lower(best, (yield from compared.descend(trial, some)))
        stuck = stuck[best[1][stuck].isfinite()]
        if level > COMPARED_AT and len(stuck):
            best = yield from self.descend(best[0], stuck)
        return lower((state, cost), best)


def lower(fits: Fits, others: Fits) -> Fits:
    """Of each frame what costs less."""
    (state, cost), (other, other_cost) = fits, others
    better = other_cost < cost * (1 - _LOWER)
    return state.put(better, other[better]), torch.where(better, other_cost, cost)


def sharpen(
    stages: Stages, state: State, cost: Float[Tensor, "T"], frames: Int[Tensor, "n"]
) -> Generator[Step, None, tuple[Stages, State, Tensor]]:
    """Raises the weight of the data term as far as the residual warrants (see sharpening.py).

    What is stuck in a wrong minimum then shows: its residual stays behind.

    Args:
        stages: as given.
        state: of the whole clip, fitted.
        cost: of every frame.
        frames: which are fitted.

    Returns:
        The stages that the fit now belongs to, its state and cost; what was given where nothing is warranted.
    """
    if not tells_noise(stages):
        return stages, state, cost
    given = stages
    for level in LEVELS:
        if not warrants(residuals(stages, state)[frames], level):
            break
        sharp = stages.sharpened(level)
        if stages is given:
            state = sharp.parametrisation.received(state)
        stages, at = sharp, Sharpened(sharp)
        state, cost = yield from at.descend(state, frames)
        if level >= min(SEARCHED):
            state, cost = yield from at.other_contours(state, cost, frames)
        if level in SEARCHED:
            state, cost = yield from at.searched(state, cost, frames)
    return stages, state, cost
