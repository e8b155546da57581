"""Phase 2: one shape, from a sample of frames of a clip, or of several clips of one person."""

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.config.schema import ShapeSample
from fitting_core.errors import InputError
from fitting_core.fit.phases.outlines import outlined_shape, samples_of
from fitting_core.fit.phases.progress import PhaseStep, reported, stage_label
from fitting_core.fit.solvers import Solver
from fitting_core.fit.solvers.problem import SharedShape
from fitting_core.fit.stages import Stages
from fitting_core.fit.variables.state import Free, State
from fitting_core.results.fit_result import FitResult, PhaseResult


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
    """A clip after phase 1, one of those that show a person."""

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
        first = _first(fit)
        found = torch.as_tensor(first.frame_cost).isfinite()
        return Sight.of(stages, stages.parametrisation.from_params(first.params), found)

    @staticmethod
    def candidates(stages: Stages, fit: FitResult, sample: ShapeSample) -> "tuple[Sight, Int[np.ndarray, 'n']]":
        """The same of a sample of its frames alone, all of them usable; and which frames these are."""
        first = _first(fit)
        usable = _usable(stages, torch.as_tensor(first.frame_cost).isfinite()).cpu().numpy()
        frames = usable[sample_frames(stages.keypoints.confidence[usable][:, kp.BODY], sample)]
        picked = stages.picked(frames)
        state = picked.parametrisation.from_params(first.params[torch.as_tensor(frames)])
        return Sight(stages=picked, state=state, usable=picked.all_frames), frames

    @staticmethod
    def of(stages: Stages, state: State, found: Bool[Tensor, "T"]) -> "Sight":
        """As `after_first_phase`, from its state and the fitted frames."""
        return Sight(stages=stages, state=state, usable=_usable(stages, found))


def _first(fit: FitResult) -> PhaseResult:
    first = fit.phase(1)
    if first is None:
        raise InputError("There is no phase 1 to find a shape from: run everything.")
    return first


def _usable(stages: Stages, found: Bool[Tensor, "T"]) -> Int[Tensor, "n"]:
    good = stages.observations.usable & found.to(stages.observations.usable.device)
    return good.nonzero()[:, 0] if bool(good.any()) else stages.all_frames


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledShape:
    """A shape, and the frames that determined it."""

    state: State
    """Of these frames, clip by clip: their betas are the shape."""
    frames: tuple[Int[Tensor, "n"], ...]
    """For each clip."""
    notes: tuple[str, ...] = ()
    """For users."""


def fit_shape(sights: Sequence[Sight], solver: Solver, sample: ShapeSample) -> Generator[PhaseStep, None, SampledShape]:
    """Minimises E_beta' + mean of E_o over frames of a clip, or of several clips of one person, with shared beta'; then
    with silhouettes, if enough are good.

    Frames are sampled as if the clips were one: a strategy based on visibility takes more from a clip that shows more.

    Args:
        sights: at least one, all of the same body and pose prior.
        solver: minimises.
        sample: how many frames, of all clips together, and in which stages.
    """
    seen = [sight.stages.keypoints.confidence[sight.usable.cpu().numpy()][:, kp.BODY] for sight in sights]
    chosen = torch.as_tensor(sample_frames(np.concatenate(seen), sample), device=sights[0].usable.device)
    whose = torch.cat([torch.full_like(sight.usable, i) for i, sight in enumerate(sights)])[chosen]
    which = torch.cat([sight.usable for sight in sights])[chosen]
    frames = [which[whose == i] for i in range(len(sights))]
    used = [(sight.stages, own) for sight, own in zip(sights, frames, strict=True) if len(own)]
    betas = used[0][0].parametrisation.columns.betas
    sampled = State.cat([sight.state[own] for sight, own in zip(sights, frames, strict=True)])
    sampled = sampled.with_columns(betas, sampled.vector[:, betas].mean(0).expand(len(sampled), -1))
    for i, stage in enumerate(sample.stages):
        problem = SharedShape(*samples_of(used, sampled, stage, _free((stages for stages, _ in used), stage)))
        minimisation = solver.minimise(problem, sampled, final=i == len(sample.stages) - 1)
        share = (i / len(sample.stages), (i + 1) / len(sample.stages))
        solution = yield from reported(minimisation, stage_label(stage), share, solver.iterations)
        sampled = solution.state
    outlined = outlined_shape(used, sampled)
    if outlined is not None:
        return SampledShape(state=outlined.state, frames=tuple(frames), notes=(outlined.note(),))
    return SampledShape(state=sampled, frames=tuple(frames))


def _free(clips: Iterable[Stages], stage: int) -> Free:
    """What moves in a stage: groups visible in any of the clips are free in all."""
    frees = [stages.free(stage, betas=True) for stages in clips]
    return replace(frees[0], hands=any(f.hands for f in frees), face=any(f.face for f in frees))
