"""The result of a fit."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from fitting_core.ground.grounding import Grounding
from fitting_core.lifting.clip_lifting import LIFTED_HEIGHT
from fitting_core.results.error_bars import ErrorBars
from fitting_core.results.given_start import GivenStart
from fitting_core.results.provenance import Provenance


@dataclass(frozen=True, kw_only=True)
class PhaseResult:
    """Parameters and figures of one finished phase."""

    phase: int
    params: BodyParams
    """All frames. Phase 2: phase 1's poses with the shared betas."""
    objective: dict[str, float]
    """Mean over the phase's frames of the last stage's cost, by term, and their sum as "total"."""
    frame_cost: Float[np.ndarray, "T"]
    """E_o of each frame with the last stage's weights."""
    seconds: float
    notes: tuple[str, ...] = ()
    provenance: Provenance | None = None
    """Provenance of each frame's fit; None for imports and files of earlier versions."""
    error_bars: ErrorBars | None = None
    """How far off joints and angles may be; None where that is not known: of phases 1 and 2, of fits without the
    lifter, and of files of earlier versions."""


@dataclass(frozen=True, kw_only=True)
class FitResult:
    """All finished phases of a fit."""

    phases: tuple[PhaseResult, ...]
    camera: Camera
    config: FitConfig
    observed: Bool[np.ndarray, "T 55"]
    """Joints that a confident keypoint hangs on: where False, the joint's rotation comes from prior and neighbours."""
    warnings: tuple[str, ...] = ()
    pose_prior: str = ""
    """Its title; of a latent one with the hash of its weights."""
    grounding: Grounding | None = None
    """Gravity, contacts of the feet and the floor; None where it is not known, as for files of earlier versions."""
    start: GivenStart | None = None
    """Another system's result from which phase 1 started; fits that continue this one use the same evidence."""
    size: float | None = None
    """Of the person beside the people that the lifter knows, which fits that continue this one keep: its depths are
    scaled by it. None: not known, as of imports."""

    @property
    def last(self) -> PhaseResult:
        """The result of the last finished phase."""
        return self.phases[-1]

    def phase(self, number: int) -> PhaseResult | None:
        """The result of a phase, if it finished."""
        return next((p for p in self.phases if p.phase == number), None)

    def chosen(self, phase: int | None) -> PhaseResult:
        """The result of a phase; None: of the last. Raises InputError if the fit has no such phase."""
        found = self.last if phase is None else self.phase(phase)
        if found is None:
            there = ", ".join(str(p.phase) for p in self.phases)
            raise InputError(f"The fit has no phase {phase}; expected one of {there}.")
        return found


def stopped_note(phase: int) -> str:
    """About a fit of which this was the last phase that finished, for users."""
    return f"This fit was stopped, and is only what phase {phase} found. Fit the clip again for a finished result."


def size_from(arrays: Mapping[str, np.ndarray]) -> float | None:
    """`FitResult.size` of a stored fit; None in files of earlier versions. Raises ValueError if it is no person's."""
    if "size" not in arrays:
        return None
    if not 0.1 < (size := float(arrays["size"])) < 10:
        raise ValueError(f"its size is {size:g}, expected 0.1 to 10")
    return size


def earlier_size(config: FitConfig) -> float | None:
    """`FitResult.size` of fits of earlier versions, which took a given height from the beginning."""
    return None if config.height is None else config.height / 100 / LIFTED_HEIGHT
