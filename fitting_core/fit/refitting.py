"""Fitting frames of a finished fit again, as after a correction of their keypoints; all others stay as they are."""

import time
from collections.abc import Generator, Sequence
from dataclasses import replace

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from fitting_core.fit.events import FitEvent, FramesFitted, Iteration, drained, mapped
from fitting_core.fit.fitting import Refit, rerun_events
from fitting_core.fit.grounded import grounding_of_params, holding_feet
from fitting_core.fit.phase_figures import patched
from fitting_core.fit.stages import Stages
from fitting_core.results.fit_result import FitResult, PhaseResult
from fitting_core.results.provenance import Provenance


def refit(clip: Clip, body: BodyModel, fit: FitResult, *windows: range, config: FitConfig | None = None) -> FitResult:
    """A fit with some of its frames fitted again, under the same shape; every other frame stays bit for bit.

    Args:
        clip: What was fitted, with its current keypoints: see `Clip.corrected`.
        body: The one it was fitted with.
        fit: The fit, all of its phases.
        windows: Frames, counted from the clip's first as 0; include the neighbours of a correction.
        config: Settings to use instead of the fit's; None: the same.

    Raises:
        InputError: No windows are given, or the clip lacks some of these frames, or the fit is of another clip, or
            ended after phase 1.
    """
    if not windows:
        raise InputError("No frames to fit again are given; expected ranges such as range(20, 40).")
    if len(fit.last.params) != len(clip):
        raise InputError(
            f"The fit has {len(fit.last.params)} frames and the clip {len(clip)}: give the clip that was fitted."
        )
    return drained(refit_events(clip, body, fit, windows, config=config or fit.config))


def refit_events(
    clip: Clip, body: BodyModel, fit: FitResult, windows: Sequence[range], *, config: FitConfig, title: str = "Re-run"
) -> Generator[FitEvent, None, FitResult]:
    """Like `refit`, with its events; each window is reported when it is finished. Raises InputError as `refit` does.

    Args:
        clip: As for `refit`, like all others.
        title: Of what is done, for the note in the result.
    """
    if fit.last.phase < 2:
        raise InputError(
            "The fit ended after phase 1, in which each frame has a shape of its own; frames are fitted again under "
            "one that all share. Find that first: run phase 2."
        )
    begin, params = time.perf_counter(), fit.last.params
    provenance = Provenance.unknown(len(clip))
    for i, window in enumerate(windows):
        events = rerun_events(clip, body, config, params, window, start=fit.start, size=fit.size)
        found = yield from _as_part(events, i, len(windows))
        inside = slice(window.start, window.stop)
        params, provenance = found.params, provenance.with_frames(window, found.provenance[inside])
        yield FramesFitted(phase=3, frames=window, params=params[inside])
    note = f"{title}: window of phase 3, the rest as in the run before"
    before = fit if fit.last.phase == 3 else replace(fit, phases=(*fit.phases, replace(fit.last, phase=3)))
    found = with_windows(before, clip, body, params, windows, config=config, provenance=provenance, note=note)
    phase = replace(found.last, seconds=time.perf_counter() - begin)
    return replace(found, phases=(*found.phases[:-1], phase))


def with_windows(
    fit: FitResult,
    clip: Clip,
    body: BodyModel,
    params: BodyParams,
    windows: Sequence[range],
    *,
    config: FitConfig,
    provenance: Provenance,
    note: str,
) -> FitResult:
    """A fit with other parameters in some windows of its last phase, and their costs, error bars and grounding.

    Args:
        fit: The fit.
        clip: What was fitted, with its current keypoints.
        body: The one it was fitted with.
        params: All frames.
        windows: Frames in which they differ from the fit's, counted from the clip's first as 0.
        config: The new fit's settings.
        provenance: Of all frames; only that of the windows is used.
        note: For the user.
    """
    stages = Stages.of_clip(clip, body, config, start=fit.start, size=fit.size)
    grounding = grounding_of_params(stages, params)
    held = holding_feet(stages, params, grounding) or stages
    phase = patched(fit.last, held, params, windows, provenance=provenance, note=note)
    return replace(with_phases(fit, (phase,), config), grounding=grounding)


def with_phases(fit: FitResult, phases: tuple[PhaseResult, ...], config: FitConfig) -> FitResult:
    """A fit with new later phases, replacing its own from the first of them on."""
    kept = tuple(p for p in fit.phases if p.phase < phases[0].phase)
    return replace(fit, phases=(*kept, *phases), config=config)


def _as_part(events: Generator[FitEvent, None, Refit], part: int, parts: int) -> Generator[FitEvent, None, Refit]:
    """The same events, as one of several equal parts of a phase."""

    def of_part(event: FitEvent) -> FitEvent:
        return replace(event, share=(part + event.share) / parts) if isinstance(event, Iteration) else event

    return (yield from mapped(events, of_part))
