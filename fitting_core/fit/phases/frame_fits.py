"""The state of every frame while phase 1 tries different starts: variables, cost, and their origin."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.fit.solvers.solution import Solution
from fitting_core.fit.variables.state import State
from fitting_core.least_squares import Ending
from fitting_core.results.provenance import Provenance, Start, Stopped

_STOPPED: dict[Ending, Stopped] = {
    "converged": Stopped.CONVERGED,
    "iterations": Stopped.ITERATIONS,
    "stalled": Stopped.STALLED,
    "failed": Stopped.FAILED,
}
"""By `Solution.reason`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameFits:
    """Every frame's state, with cost and origin."""

    state: State
    cost: Float[Tensor, "T"]
    """Infinite for frames that were not fitted or failed."""
    start: UInt8[Tensor, "T"]
    """Codes of `Start`."""
    stopped: UInt8[Tensor, "T"]
    """Codes of `Stopped`."""
    notes: tuple[str, ...] = ()
    """For users."""

    @staticmethod
    def at(state: State, start: Start) -> "FrameFits":
        """States before any minimisation."""
        codes = torch.zeros(len(state), dtype=torch.uint8, device=state.vector.device)
        cost = torch.full_like(state.vector[:, 0], torch.inf)
        return FrameFits(state=state, cost=cost, start=codes + int(start), stopped=codes)

    @property
    def provenance(self) -> Provenance:
        """The origin of each frame."""
        return Provenance(self.start.cpu().numpy(), self.stopped.cpu().numpy())

    def __len__(self) -> int:
        return len(self.cost)

    def __getitem__(self, frames: slice | Int[Tensor, "n"]) -> "FrameFits":
        return replace(
            self,
            state=self.state[frames],
            cost=self.cost[frames],
            start=self.start[frames],
            stopped=self.stopped[frames],
        )

    def with_frames(self, frames: range, other: "FrameFits") -> "FrameFits":
        """A copy in which `frames` are replaced by those of `other`, in order."""
        at = torch.arange(frames.start, frames.stop, device=self.cost.device)
        return replace(
            self,
            state=self.state.put(at, other.state),
            cost=self.cost.index_copy(0, at, other.cost),
            start=self.start.index_copy(0, at, other.start),
            stopped=self.stopped.index_copy(0, at, other.stopped),
        )

    def restarted(self, frames: Int[Tensor, "n"], state: State, start: Start | UInt8[Tensor, "n"]) -> "FrameFits":
        """Restart some frames from other states."""
        codes = self.start.clone()
        codes[frames] = start if isinstance(start, Tensor) else int(start)
        return replace(self, state=self.state.put(frames, state), start=codes)

    def solved(self, frames: Int[Tensor, "n"], solution: Solution) -> "FrameFits":
        """Some frames with a minimisation's results, one group per frame; all others have no cost."""
        cost = solution.cost.new_full((len(self.cost),), torch.inf)
        cost[frames] = solution.cost
        stopped = self.stopped.clone()
        stopped[frames] = torch.tensor([stopped_of(r) for r in solution.reason], dtype=torch.uint8, device=cost.device)
        return replace(self, state=self.state.put(frames, solution.state), cost=cost, stopped=stopped)

    def lower(self, other: "FrameFits", by: float = 0.0) -> "tuple[FrameFits, Bool[Tensor, 'T']]":
        """For each frame the fit with the lower cost, the other only if lower by this fraction; and where."""
        better = other.cost < self.cost * (1 - by)
        return replace(
            self,
            state=self.state.put(better, other.state[better]),
            cost=torch.where(better, other.cost, self.cost),
            start=torch.where(better, other.start, self.start),
            stopped=torch.where(better, other.stopped, self.stopped),
        ), better

    def between(self, frames: Int[Tensor, "n"]) -> "FrameFits":
        """Those of these frames without a finite cost start interpolated between the nearest ones with one."""
        good = self.cost.isfinite()
        start = frames[~good[frames]]
        return self.restarted(start, filled(self.state, good)[start], Start.BETWEEN)

    def filled(self, good: Bool[Tensor, "T"]) -> "FrameFits":
        """Frames that are not good are interpolated between those around them; their cost stays."""
        bad = (~good).nonzero()[:, 0]
        fits = self.restarted(bad, filled(self.state, good)[bad], Start.FILLED)
        empty = ~good & (fits.stopped == int(Stopped.UNKNOWN))
        return replace(fits, stopped=fits.stopped.masked_fill(empty, int(Stopped.EMPTY)))


def stopped_of(reason: Ending) -> Stopped:
    """Why a minimisation stopped, from `Solution.reason`."""
    return _STOPPED[reason]


def filled(state: State, good: Bool[Tensor, "T"]) -> State:
    """States with bad frames interpolated between the nearest good ones; at the ends, the nearest good one."""
    at = good.nonzero()[:, 0]
    if not len(at) or bool(good.all()):
        return state
    bad = (~good).nonzero()[:, 0]
    after = torch.searchsorted(at, bad).clamp(max=len(at) - 1)
    before = (torch.searchsorted(at, bad) - 1).clamp(min=0)
    a, b = at[before], at[after]
    t = ((bad - a).to(state.vector) / (b - a).clamp(min=1)).clamp(0, 1)[:, None]
    t = torch.where((a == b)[:, None], 0.0, t)
    vector = (1 - t) * state.vector[a] + t * state.vector[b]
    turn = rotations.log(state.orient[b] @ state.orient[a].transpose(1, 2))
    return state.put(bad, State(rotations.exp(t * turn) @ state.orient[a], vector))
