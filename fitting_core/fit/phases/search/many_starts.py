"""The search for other minima of frames that are astray: many starts, of which few go on."""

from collections.abc import Generator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.fit.phases.progress import Step, reported
from fitting_core.fit.phases.search.fresh_starts import FreshStarts, Starts
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.state import State

DRAWN = 32
"""Poses drawn for each frame."""
KEPT = 3
"""Of each frame: how many minima are returned."""
TOGETHER = 8
"""Frames searched at a time: 8 x 32 normal matrices of 148 numbers square are 45 MB."""
_HALVING = ((8, 16), (12, 8), (25, 8))
"""Of drawn poses: iterations, and how many go on."""
_ITERATIONS = 25
"""Of poses that are put together or varied."""
_TOLERANCE = 1e-4
LAST = 10**6
"""A rank that no state has."""
_EQUAL = 1.001
"""Ratio of costs under which two minima are one."""


@dataclass(frozen=True)
class Pool:
    """States of some frames, with their cost."""

    state: State
    owner: Int[Tensor, "n"]
    """Which of the frames each belongs to."""
    cost: Float[Tensor, "n"]

    def __len__(self) -> int:
        return len(self.owner)

    def __getitem__(self, which: Tensor) -> "Pool":
        return Pool(self.state[which], self.owner[which], self.cost[which])

    @staticmethod
    def cat(pools: list["Pool"]) -> "Pool":
        """All of them."""
        owner, cost = (torch.cat([getattr(p, name) for p in pools]) for name in ("owner", "cost"))
        return Pool(State.cat([p.state for p in pools]), owner, cost)

    def ranks(self) -> Int[Tensor, "n"]:
        """Of each state among its owner's, by cost, from 0; LAST where its minimum is there already or has no cost."""
        rank = torch.full_like(self.owner, LAST)
        for owner in self.owner.unique():
            mine = (self.owner == owner).nonzero()[:, 0]
            mine = mine[self.cost[mine].argsort()]
            cost = self.cost[mine]
            new = torch.ones_like(mine, dtype=torch.bool)
            new[1:] = cost[1:] > _EQUAL * cost[:-1]
            new &= cost.isfinite()
            rank[mine[new]] = torch.arange(int(new.sum()), device=rank.device)
        return rank

    def best(self, count: int) -> "Pool":
        """Of each owner the cheapest ones, no two alike."""
        return self[(self.ranks() < count).nonzero()[:, 0]]


def other_minima(
    stages: Stages, state: State, frames: Int[Tensor, "n"], seed: int
) -> Generator[Step, None, list[tuple[Int[Tensor, "m"], State]]]:
    """Minima of some frames, found from fresh starts, of mean shape.

    Args:
        stages: with keypoints as sharp as it takes for one minimum to show beside others, and no sharper.
        state: of the whole clip: where the bodies are.
        frames: which are searched.
        seed: of what is drawn.

    Returns:
        For each place, from the first, the frames that have so many minima, and these.
    """
    found: list[Pool] = []
    for some in torch.arange(len(frames), device=frames.device).split(TOGETHER):
        pool = yield from _searched(FreshStarts(stages, state, seed), state, frames[some], stages)
        found.append(replace(pool, owner=some[pool.owner]))
    pool = Pool.cat(found)
    rank = pool.ranks()
    places = [pool[(rank == k).nonzero()[:, 0]] for k in range(KEPT)]
    return [(frames[p.owner], p.state) for p in places if len(p)]


def _searched(fresh: FreshStarts, state: State, frames: Tensor, stages: Stages) -> Generator[Step, None, Pool]:
    """Poses are drawn, the cheapest go on, and then parts of them are put together and varied in turn."""
    config = stages.config

    def descend(starts: Starts, iterations: int) -> Generator[Step, None, Pool]:
        settings = replace(config.settings, iterations=iterations, rounds=1, final_tolerance=_TOLERANCE)
        solver = make_solver(config.solver, settings)
        problem = IndependentFrames(fresh.objective, frames[starts.source])  # a frame comes more than once
        minimisation = solver.minimise(problem, starts.state, final=True)
        solution = yield from reported(minimisation, "fresh starts", (1.0, 1.0), solver.iterations)
        return Pool(solution.state, starts.source, solution.cost)

    own = torch.arange(len(frames), device=frames.device)
    starts = Starts.cat([Starts(fresh.of_mean_shape(state[frames]), own), fresh.drawn(state[frames], DRAWN)])
    for iterations, surviving in _HALVING:
        pool = (yield from descend(starts, iterations)).best(surviving)
        starts = Starts(pool.state, pool.owner)
    for change in (_crossed, _varied, _crossed, _varied, _crossed):
        starts = change(fresh, pool, frames)
        if starts is not None and len(starts.source):
            pool = Pool.cat([pool, (yield from descend(starts, _ITERATIONS))])
    return pool.best(KEPT)


def _crossed(fresh: FreshStarts, pool: Pool, frames: Tensor) -> Starts | None:
    base = (pool.ranks() == 0).nonzero()[:, 0]
    misfit = fresh.misfits(pool.state, frames[pool.owner])
    donors, better = fresh.better_donors(misfit, base, pool.owner)
    made = fresh.crossed(pool.state[base], donors, pool.state, better)
    return Starts(made.state, pool.owner[base][made.source])


def _varied(fresh: FreshStarts, pool: Pool, frames: Tensor) -> Starts | None:
    base = pool.best(1)
    made = fresh.varied(base.state, fresh.misfits(base.state, frames[base.owner]))
    return None if made is None else Starts(made.state, base.owner[made.source])
