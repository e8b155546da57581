"""The shape of a subject: a person who is seen in several clips."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import clip_stages
from fitting_core.fit.phases.shared_shape import Sight, fit_shape
from fitting_core.fit.solvers import make_solver
from fitting_core.results.fit_result import FitResult


@dataclass(frozen=True, kw_only=True)
class SubjectShape:
    """The shape of a person seen in several clips."""

    betas: Float[np.ndarray, "10"]
    frames: tuple[tuple[int, ...], ...]
    """Numbers of the frames of each clip that it was found from."""


_MOST_SAMPLED = 240
"""Frames over all clips that a shape is estimated from; their normal matrices take 30 MB."""
_CANDIDATES = 4
"""Times the frames that are sampled of a clip on average: this many of each are kept in memory until all clips are
known."""


def subject_shape(clips: Iterable[tuple[Clip, FitResult]], body: BodyModel, config: FitConfig) -> SubjectShape:
    """Phase 2 over frames of several clips of one person: on average `config.shape_sample` of each. Raises InputError
    if a fit has no first phase, or no frame of a clip shows a person.

    Args:
        clips: each with its fit by this configuration, of which the first phase is used, and what that began with. They
            are taken one after the other, and nothing of them is kept but the frames that may be sampled.
        body: the body model.
        config: everything else.
    """
    own = config.shape_sample
    sights: list[Sight] = []
    numbers: list[np.ndarray] = []
    for clip, fit in clips:
        stages = clip_stages(clip, body, config, start=fit.start)
        sight, frames = Sight.candidates(stages, fit, replace(own, size=_CANDIDATES * own.size))
        sights.append(sight)
        numbers.append(clip.first_frame + frames)
    sample = replace(own, size=min(_MOST_SAMPLED, own.size * len(sights)))
    found = drained(fit_shape(sights, make_solver(config.solver, config.settings), sample))
    betas = found.state.vector[0, sights[0].stages.parametrisation.columns.betas].double().cpu().numpy()
    chosen = (known[frames.cpu().numpy()] for known, frames in zip(numbers, found.frames, strict=True))
    return SubjectShape(betas=betas, frames=tuple(tuple(frames.tolist()) for frames in chosen))
