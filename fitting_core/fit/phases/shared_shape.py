"""Phase 2: one shape, from a sample of frames."""

from collections.abc import Callable, Generator

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.config.schema import ShapeSample
from fitting_core.fit.phases.progress import Step, reported, stage_label
from fitting_core.fit.solvers import Solver
from fitting_core.fit.solvers.problem import SharedShape
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.state import State


def _random(confidence: np.ndarray, sample: ShapeSample, count: int) -> np.ndarray:
    return np.random.default_rng(sample.seed).choice(len(confidence), count, replace=False)


def _confident(confidence: np.ndarray, sample: ShapeSample, count: int) -> np.ndarray:
    return np.argsort(-confidence.mean(1), kind="stable")[:count]


def _coverage(confidence: np.ndarray, sample: ShapeSample, count: int) -> np.ndarray:
    """Greedily the frame that adds most to sum over keypoints of sqrt(confidence gathered), spread over the clip."""
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
    """The frames that find the shape, ascending.

    Args:
        confidence: of the frames to choose from.
        sample: size (all frames if there are fewer), strategy and seed.
    """
    count = min(sample.size, len(confidence))
    return np.sort(STRATEGIES[sample.strategy](confidence, sample, count))


def fit_shape(
    stages: Stages, solver: Solver, state: State, usable: Tensor
) -> Generator[Step, None, tuple[State, Tensor]]:
    """Minimises E_beta' + mean of E_o over the sample, beta' shared.

    Args:
        stages: builds the objectives.
        solver: minimises them.
        state: phase 1, all frames.
        usable: indices of frames that may be sampled.

    Returns:
        The sampled frames' state (their betas are beta'), and which frames they are.
    """
    confidence = stages.keypoints.confidence[usable.cpu().numpy()][:, kp.BODY]
    frames = usable[torch.as_tensor(sample_frames(confidence, stages.config.shape_sample), device=usable.device)]
    betas = stages.parametrisation.columns.betas
    sampled = state[frames]
    sampled = sampled.with_columns(betas, sampled.vector[:, betas].mean(0).expand(len(frames), -1))
    chosen = stages.config.shape_sample.stages
    for i, stage in enumerate(chosen):
        whole = state.put(frames, sampled)
        objective = stages.objective(stage, whole, stages.free(stage, betas=True))
        minimisation = solver.minimise(SharedShape(objective, frames), sampled, final=i == len(chosen) - 1)
        share = (i / len(chosen), (i + 1) / len(chosen))
        solution = yield from reported(minimisation, stage_label(stage), share, solver.iterations)
        sampled = solution.state
    return sampled, frames
