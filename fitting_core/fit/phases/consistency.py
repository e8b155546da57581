"""Phase 3: pose and camera, consistent over time. Sliding window, all at once, or a re-run of a range."""

from collections.abc import Generator

import numpy as np
import torch

from fitting_core.fit.phases.frame_fits import stopped_of
from fitting_core.fit.phases.progress import Step, reported
from fitting_core.fit.provenance import Stopped
from fitting_core.fit.solvers import Solver
from fitting_core.fit.solvers.sequence import Sequence
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.table import REACH
from fitting_core.fit.variables.state import State

COUPLED = 2 * REACH
"""Frames on each side that terms over time couple to a window."""


class Consistency:
    """Minimises E_o + E_T over ranges of frames of one clip; betas are those of the state and stay.

    Args:
        stages: builds the objectives.
        solver: minimises them.
    """

    def __init__(self, stages: Stages, solver: Solver) -> None:
        self.stages, self.solver = stages, solver
        self.notes: list[str] = []
        """What went wrong, for the user."""
        self.stopped = np.full(len(stages), Stopped.UNKNOWN, np.uint8)
        """Of each frame why the solver stopped when it last moved it; see `Stopped`."""

    def _run(
        self, state: State, free: range, label: str, share: tuple[float, float], *, windowed: bool = False
    ) -> Generator[Step, None, State]:
        """The frames of `free` after the configured stages, all others held; only what these touch is looked at."""
        near = coupled(free, len(state))
        stages, around = self.stages.within(near), state[near.start : near.stop]
        inner = range(free.start - near.start, free.stop - near.start)
        chosen = stages.config.temporal.stages
        for i, stage in enumerate(chosen):
            objective = stages.objective(stage, around, stages.free(stage, betas=False))
            problem = Sequence(objective, around, inner, windowed=windowed)
            begin, end = share
            part = (begin + (end - begin) * i / len(chosen), begin + (end - begin) * (i + 1) / len(chosen))
            minimisation = self.solver.minimise(problem, around[problem.frames], final=i == len(chosen) - 1)
            solution = yield from reported(minimisation, f"{label}stage {stage}", part, self.solver.iterations)
            if "failed" in solution.reason:
                self.notes.append(
                    f"{label}stage {stage} of phase 3 failed (no finite cost): its frames stay as they were"
                )
            around = around.put(problem.frames, solution.state)
            self.stopped[free.start : free.stop] = stopped_of(solution.reason[0])
        return around[inner.start : inner.stop]

    def all_at_once(self, state: State) -> Generator[Step, None, State]:
        """Every frame free, every residual counted; cost linear in the number of frames."""
        return (yield from self._run(state, range(len(state)), "", (0.0, 1.0)))

    def sliding_window(self, state: State) -> Generator[Step, None, State]:
        """The paper's windows of n frames, stride 1: no E_T for a window's last frame, the one before it constant."""
        frames = len(state)
        size = min(self.stages.config.temporal.window_size, frames)
        last = frames - size
        state = State(state.orient.clone(), state.vector.clone())  # that each window writes its own frames into
        for first in range(last + 1):
            window = slice(first, first + size)
            share = (first / (last + 1), (first + 1) / (last + 1))
            label = f"window {first + 1} of {last + 1}, "
            found = yield from self._run(state, range(first, first + size), label, share, windowed=True)
            state.orient[window], state.vector[window] = found.orient, found.vector
            done = range(first, first + 1) if first < last else range(first, frames)
            final = self.stages.parametrisation.to_params(state[done.start : done.stop])
            yield Step("window", share[1], 0.0, (done, final))
        return state

    def rerun(self, state: State, frames: range) -> Generator[Step, None, State]:
        """Only `frames` move; all others are held and coupled, so that no seam appears."""
        found = yield from self._run(state, frames, "", (0.0, 1.0))
        return state.put(torch.arange(frames.start, frames.stop, device=state.vector.device), found)


def coupled(frames: range, count: int) -> range:
    """Frames of a clip of `count`, and those that terms over time couple to them."""
    return range(max(0, frames.start - COUPLED), min(count, frames.stop + COUPLED))
