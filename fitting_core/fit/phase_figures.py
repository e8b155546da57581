"""A phase's figures, for parameters from the phase itself or from elsewhere."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.grounded import holding_feet
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.terms.temporal import REACH
from fitting_core.fit.uncertainty.calibration import error_bars
from fitting_core.fit.variables.state import State
from fitting_core.results.error_bars import ErrorBars
from fitting_core.results.fit_result import PhaseResult
from fitting_core.results.given_start import GivenStart
from fitting_core.results.provenance import Provenance

_TOGETHER = 1024
"""Frames in one objective, 30 kB each."""
_AROUND = 20
"""Frames on either side of the changed ones whose error bars are recomputed."""


def evaluate_objective(
    clip: Clip,
    body: BodyModel,
    config: FitConfig,
    params: BodyParams,
    *,
    start: GivenStart | None = None,
    size: float | None = None,
) -> PhaseResult:
    """What the last phase's objective says of any parameters, without minimising anything.

    `objective` has the mean cost of a frame by term, with E_T and held feet; `frame_cost` is the sum without E_T.

    Args:
        clip: keypoints and camera, against which the costs are taken.
        body: the body model.
        config: its weights are those of the costs.
        params: all frames; they are kept unchanged.
        start: what the fit began with, `FitResult.start`.
        size: of its person, `FitResult.size`.
    """
    stages = Stages.of_clip(clip, body, config, start=start, size=size)
    stages = holding_feet(stages, params) or stages
    result = phase_result(stages, 3, stages.parametrisation.from_params(params), seconds=0.0)
    return replace(result, params=params)


def patched(
    phase: PhaseResult,
    stages: Stages,
    params: BodyParams,
    windows: Sequence[range],
    *,
    provenance: Provenance | None = None,
    note: str,
) -> PhaseResult:
    """A phase with other parameters in some windows.

    Costs are computed only there: those of a whole clip take 4 ms per frame, which would delay a drag or a re-run of
    some frames. So they are known by frame, and not by term.

    Args:
        phase: before.
        stages: of the whole clip, with the feet held that stand in `params`.
        params: all frames.
        windows: where they differ from those of `phase`.
        provenance: of all frames; None: not known for those of the windows.
        note: for the user.
    """
    cost, known = phase.frame_cost.copy(), phase.provenance or Provenance.unknown(len(params))
    bars = phase.error_bars
    for window in windows:
        part, inside = stages.within(window), slice(window.start, window.stop)
        cost[inside] = _frame_costs(part, part.parametrisation.from_params(params[inside]))
        known = known.with_frames(window, (provenance or Provenance.unknown(len(params)))[inside])
    return replace(
        phase,
        params=params,
        frame_cost=cost,
        objective={"by frame": float(cost.mean())},
        notes=(note,),
        provenance=known,
        error_bars=bars if bars is None else _new_error_bars(bars, stages, params, windows),
    )


def _new_error_bars(known: ErrorBars, whole: Stages, params: BodyParams, windows: Sequence[range]) -> ErrorBars:
    """Those of the windows recomputed, with as many frames around them as their evidence depends on."""
    for window in windows:
        near = range(max(0, window.start - _AROUND), min(len(params), window.stop + _AROUND))
        stages = whole.within(near)
        found = error_bars(stages, stages.parametrisation.from_params(params[slice(near.start, near.stop)]))
        inside = slice(window.start - near.start, window.stop - near.start)
        known = known.with_frames(window, (found or ErrorBars.unknown(len(near)))[inside])
    return known


def _frame_costs(stages: Stages, state: State) -> Float[np.ndarray, "T"]:
    """E_o of each frame with the last stage's weights."""
    objective = stages.objective(N_STAGES, state, stages.free(N_STAGES, betas=False))
    costs = objective.costs(state, stages.all_frames)
    return torch.stack(list(costs.values())).sum(0).double().cpu().numpy()


def phase_result(
    stages: Stages,
    phase: int,
    state: State,
    *,
    seconds: float,
    notes: tuple[str, ...] = (),
    sample: tuple[State, Tensor] | None = None,
) -> PhaseResult:
    """Figures of a state of all frames; the objective is the mean over these, or over a sample of them."""
    free = stages.free(N_STAGES, betas=phase < 3)
    costs, coupled = dict[str, Tensor](), dict[str, float]()
    for start in range(0, len(state), _TOGETHER):
        count = min(_TOGETHER, len(state) - start)
        near = range(start, min(start + count + 2 * REACH, len(state)))
        part, found = stages.within(near), state[near.start : near.stop]
        objective = part.objective(N_STAGES, found, free)
        for name, cost in objective.costs(found[:count], part.all_frames[:count]).items():
            costs.setdefault(name, cost.new_zeros(len(state)))[start : start + count] = cost
        for name, total in (objective.costs_over_time(found, count) if phase == 3 else {}).items():
            coupled[name] = coupled.get(name, 0.0) + total
    counted = costs
    if sample is not None:
        part = stages.picked(sample[1].cpu().numpy())
        counted = part.objective(N_STAGES, state[sample[1]], free).costs(sample[0], part.all_frames)
    terms = {name: float(cost.mean()) for name, cost in counted.items()}
    terms |= {name: cost / len(state) for name, cost in coupled.items()}
    terms["total"] = sum(terms.values())
    return PhaseResult(
        phase=phase,
        params=stages.parametrisation.to_params(state),
        objective=terms,
        frame_cost=torch.stack(list(costs.values())).sum(0).double().cpu().numpy(),
        seconds=seconds,
        notes=notes,
    )
