"""Phase 2: one shape, from a sample of frames."""

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.config.schema import ShapeSample
from fitting_core.errors import InputError
from fitting_core.fit.phases.outlines import outlined_shape, sample_of
from fitting_core.fit.phases.progress import PhaseStep, reported, stage_label
from fitting_core.fit.solvers import Solver
from fitting_core.fit.solvers.problem import SharedShape
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.state import State
from fitting_core.results.fit_result import FitResult


def _random(confidence: np.ndarray, sample: ShapeSample, count: int) -> np.ndarray:
    return np.random.default_rng(sample.seed).choice(len(confidence), count, replace=False)


def _confident(confidence: np.ndarray, sample: ShapeSample, count: int) -> np.ndarray:
    return np.argsort(-confidence.mean(1), kind="stable")[:count]


def _coverage(confidence: np.ndarray, sample: ShapeSample, count: int) -> np.ndarray:
    """Greedily the frame that adds most to the sum over keypoints of sqrt(accumulated confidence)."""
    apart = len(confidence) // (2 * count)
    gathered = np.zeros(confidence.shape[1])
    open_frames = np.ones(len(confidence), bool)
    chosen: list[int] = []
    for _ in range(count):
        gain = np.sqrt(gathered + confidence).sum(1) - np.sqrt(gathered).sum()
        best = int(np.argmax(np.where(open_frames, gain, -np.inf)))
        chosen.append(best)
        gathered += confidence[best]
        open_frames[max(0, best - apart) : best + apart + 1] = False
        if not open_frames.any():
            open_frames[:] = True
            open_frames[chosen] = False
    return np.array(chosen)


STRATEGIES: dict[str, Callable[[np.ndarray, ShapeSample, int], np.ndarray]] = {
    "random": _random,
    "confident": _confident,
    "coverage": _coverage,
}


def sample_frames(confidence: Float[np.ndarray, "T K"], sample: ShapeSample) -> Int[np.ndarray, "n"]:
    """The frames that determine the shape, ascending.

    Args:
        confidence: of the frames to choose from.
        sample: size (all frames if there are fewer), strategy and seed.
    """
    count = min(sample.size, len(confidence))
    return np.sort(STRATEGIES[sample.strategy](confidence, sample, count))


@dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """A clip after phase 1."""

    stages: Stages
    """Builds the objectives."""
    state: State
    """Phase 1, all frames."""
    usable: Int[Tensor, "n"]
    """Frames that may be sampled."""

    @staticmethod
    def after_first_phase(stages: Stages, fit: FitResult) -> "Sight":
        """A clip with a fit. Frames are sampled from those fitted in phase 1, or from all. Raises InputError if the fit
        has no phase 1."""
        first = fit.phase(1)
        if first is None:
            raise InputError("There is no phase 1 to find a shape from: run everything.")
        found = torch.as_tensor(first.frame_cost).isfinite()
        return Sight.of(stages, stages.parametrisation.from_params(first.params), found)

    @staticmethod
    def of(stages: Stages, state: State, found: Bool[Tensor, "T"]) -> "Sight":
        """As `after_first_phase`, from its state and the fitted frames."""
        good = stages.observations.usable & found.to(stages.observations.usable.device)
        usable = good.nonzero()[:, 0] if bool(good.any()) else stages.all_frames
        return Sight(stages=stages, state=state, usable=usable)


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledShape:
    """A shape, and the frames that determined it."""

    state: State
    """Of these frames: their betas are the shape."""
    frames: Int[Tensor, "n"]
    notes: tuple[str, ...] = ()
    """For users."""


def fit_shape(sight: Sight, solver: Solver, sample: ShapeSample) -> Generator[PhaseStep, None, SampledShape]:
    """Minimises E_beta' + mean of E_o over sampled frames with shared beta'; then with silhouettes, if enough are good.

    Args:
        sight: a clip after phase 1.
        solver: minimises.
        sample: how many frames, and in which stages.
    """
    stages = sight.stages
    confidence = stages.keypoints.confidence[sight.usable.cpu().numpy()][:, kp.BODY]
    frames = sight.usable[torch.as_tensor(sample_frames(confidence, sample), device=sight.usable.device)]
    betas, sampled = stages.parametrisation.columns.betas, sight.state[frames]
    sampled = sampled.with_columns(betas, sampled.vector[:, betas].mean(0).expand(len(sampled), -1))
    for i, stage in enumerate(sample.stages):
        problem = SharedShape(sample_of(stages, frames, sampled, stage, stages.free(stage, betas=True)))
        minimisation = solver.minimise(problem, sampled, final=i == len(sample.stages) - 1)
        share = (i / len(sample.stages), (i + 1) / len(sample.stages))
        solution = yield from reported(minimisation, stage_label(stage), share, solver.iterations)
        sampled = solution.state
    outlined = outlined_shape(stages, frames, sampled)
    if outlined is not None:
        return SampledShape(state=outlined.state, frames=frames, notes=(outlined.note(),))
    return SampledShape(state=sampled, frames=frames)
