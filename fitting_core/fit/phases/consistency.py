"""Phase 3: pose and camera, consistent over time. Sliding window, all frames at once, or a re-run of a range."""

from collections.abc import Callable, Generator
from dataclasses import replace
from functools import partial

import numpy as np
import torch

from fitting_core.body.params import BodyParams
from fitting_core.fit.events import mapped
from fitting_core.fit.grounded import grounding_of_params, holding_feet
from fitting_core.fit.phases.frame_fits import stopped_of
from fitting_core.fit.phases.progress import PhaseStep, reported, stage_label
from fitting_core.fit.solvers import Solver, make_solver
from fitting_core.fit.solvers.sequence import Sequence
from fitting_core.fit.stages import Stages
from fitting_core.fit.terms.temporal import REACH
from fitting_core.fit.variables.state import State
from fitting_core.memory import give_back
from fitting_core.results.provenance import Stopped

COUPLED = 2 * REACH
"""Frames on each side that terms over time couple to a window."""
_PART, _SEAM = 300, 40
"""Frames of a long clip that are fitted together (0.5 MB each with hands and face), and the overlap of two parts.

In parts of 60 or 80 frames with overlaps of 30 or 40, the cost equals the whole clip's: 476.53 and 476.54 for 476.52
(balancing), 2511.7 and 2513.6 for 2516.9 (signing). The depth of a person 20 m away agrees within 9 mm; with overlaps
of 10, within 94 mm.
"""

_FIRMNESS = (0.0, 0.2, 1.0)
"""Shares of the weight of held feet in one run of phase 3 after the other: held gently first, they find a place that
agrees better with the legs (evaluation/RESULTS/real_clips.md)."""
_ROUGH = 1e-2
"""`SolverSettings.sequence_tolerance` of all runs but the last, which only show where feet stand."""


class Consistency:
    """Minimises E_o + E_T over ranges of frames of one clip; betas are fixed.

    Args:
        stages: builds the objectives.
        solver: minimises them.
    """

    def __init__(self, stages: Stages, solver: Solver) -> None:
        self.stages, self.solver = stages, solver
        self.notes: list[str] = []
        """Warnings for users."""
        self.stopped = np.full(len(stages), Stopped.UNKNOWN, np.uint8)
        """For each frame why the solver stopped when it last moved it; see `Stopped`."""

    def _run(
        self, state: State, free: range, label: str, share: tuple[float, float], *, windowed: bool = False
    ) -> Generator[PhaseStep, None, State]:
        """The frames of `free` after the configured stages, others fixed; only frames coupled to them are evaluated."""
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
            solution = yield from reported(
                minimisation, label + stage_label(stage), part, self.solver.iterations, frames=len(free)
            )
            if "failed" in solution.reason:
                self.notes.append(
                    f"consistency over time, {label}{stage_label(stage)}, failed: its frames stay as they were"
                )
            around = around.put(problem.frames, solution.state)
            self.stopped[free.start : free.stop] = stopped_of(solution.reason[0])
        return around[inner.start : inner.stop]

    def all_at_once(self, state: State) -> Generator[PhaseStep, None, State]:
        """All frames free, all residuals counted. Long clips are fitted in parts, each starting from the last frames of
        the one before: time is linear in the number of frames, memory is bounded.
        """
        parts = overlapping_parts(len(state), _PART, _SEAM)
        state = _own(state)
        for k, part in enumerate(parts):
            label = f"part {k + 1} of {len(parts)}, " if len(parts) > 1 else ""
            share = (k / len(parts), (k + 1) / len(parts))
            found = yield from self._run(state, part, label, share)
            _write(state, part, found)
            give_back()
            if k + 1 < len(parts):
                final = range(part.start, parts[k + 1].start)
                yield PhaseStep("part", share[1], 0.0, self._to_look_at(state, final))
        return state

    def sliding_window(self, state: State) -> Generator[PhaseStep, None, State]:
        """The paper's windows of n frames, stride 1: no E_T for a window's last frame; the frame before it is fixed."""
        frames = len(state)
        size = min(self.stages.config.temporal.window_size, frames)
        last = frames - size
        state = _own(state)
        for first in range(last + 1):
            window = range(first, first + size)
            share = (first / (last + 1), (first + 1) / (last + 1))
            label = f"window {first + 1} of {last + 1}, "
            found = yield from self._run(state, window, label, share, windowed=True)
            _write(state, window, found)
            final = range(first, first + 1) if first < last else window
            yield PhaseStep("window", share[1], 0.0, self._to_look_at(state, final))
        return state

    def rerun(self, state: State, frames: range) -> Generator[PhaseStep, None, State]:
        """Only `frames` move; all others are fixed but coupled, so that no seam appears."""
        found = yield from self._run(state, frames, "", (0.0, 1.0))
        return state.put(torch.arange(frames.start, frames.stop, device=state.vector.device), found)

    def _to_look_at(self, state: State, frames: range) -> tuple[range, BodyParams]:
        return frames, self.stages.parametrisation.to_params(state[frames.start : frames.stop])


def overlapping_parts(frames: int, size: int, seam: int) -> list[range]:
    """Overlapping parts of a clip; two neighbouring parts share `seam` frames."""
    starts = range(0, max(frames - seam, 1), size - seam)
    return [range(start, min(start + size, frames)) for start in starts]


def _own(state: State) -> State:
    """A copy into which windows or parts write their own frames."""
    return State(state.orient.clone(), state.vector.clone())


def _write(state: State, frames: range, found: State) -> None:
    at = slice(frames.start, frames.stop)
    state.orient[at], state.vector[at] = found.orient, found.vector


def coupled(frames: range, count: int) -> range:
    """Frames of a clip of `count`, with those that terms over time couple to them."""
    return range(max(0, frames.start - COUPLED), min(count, frames.stop + COUPLED))


def ever_firmer(
    run: Callable[[State], Generator[PhaseStep, None, State]],
    consistency: Consistency,
    state: State,
    whole: Stages,
    *,
    params_of: Callable[[State], BodyParams],
    near: range,
) -> Generator[PhaseStep, None, State]:
    """Phase 3, and again with the feet held where they stand after it, if any do: gently, and firmly where they stand
    then. The result of phase 1 is too inaccurate in depth for holding.

    Args:
        run: phase 3.
        consistency: of `run`; keeps the stages with the feet held.
        state: before phase 3.
        whole: stages of all frames.
        params_of: all frames, with what `run` found.
        near: the frames of `consistency`.
    """
    config, solver, grounding = whole.config, consistency.solver, None
    if not any(config.weights.held_position):
        return (yield from run(state))
    tolerance = max(_ROUGH, config.settings.sequence_tolerance)
    rough = make_solver(config.solver, replace(config.settings, sequence_tolerance=tolerance))
    for k, firmness in enumerate(_FIRMNESS):
        if firmness:
            params = params_of(state)
            grounding = grounding or grounding_of_params(whole, params)
            held = holding_feet(whole, params, grounding, firmness=firmness)
            if held is not None:
                consistency.stages = held.within(near)
            elif firmness < 1:
                continue
        consistency.solver = rough if firmness < 1 else solver
        step = partial(PhaseStep.between, begin=k / len(_FIRMNESS), end=(k + 1) / len(_FIRMNESS))
        state = yield from mapped(run(state), step)
    return state
