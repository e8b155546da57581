"""The three phases as a generator of events, and as one call."""

import threading
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip, OtherView
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from fitting_core.fit.events import (
    Finished,
    FitEvent,
    FramesFitted,
    Iteration,
    PhaseFinished,
    PhaseStarted,
    drained,
    mapped,
)
from fitting_core.fit.fused.ready import prepare_for
from fitting_core.fit.grounded import grounding_of_params
from fitting_core.fit.phase_figures import phase_result
from fitting_core.fit.phases.consistency import Consistency, coupled, ever_firmer
from fitting_core.fit.phases.frame_fits import FrameFits
from fitting_core.fit.phases.independent import fit_frames
from fitting_core.fit.phases.limb_flips import mirrored_as_told
from fitting_core.fit.phases.progress import PhaseStep, TermSampling
from fitting_core.fit.phases.shared_shape import Sight, fit_shape
from fitting_core.fit.plausibility import doubts, feet_let_go, other_height, small_adult, unswapped_limbs
from fitting_core.fit.size import height_of, likely_height, resized, with_shape
from fitting_core.fit.solvers import make_solver
from fitting_core.fit.stages import Stages
from fitting_core.fit.uncertainty.calibration import error_bars
from fitting_core.fit.variables.state import State
from fitting_core.fit.views.relating import related
from fitting_core.keypoints import SEEN
from fitting_core.memory import give_back
from fitting_core.results.fit_result import FitResult, PhaseResult
from fitting_core.results.given_start import GivenStart, KnownShape
from fitting_core.results.provenance import Provenance, Start

P = ParamSpec("P")
Outcome = TypeVar("Outcome")
"""The result of a phase."""
PHASE_TITLES = {1: "every frame on its own", 2: "one shape", 3: "consistency over time"}


KnownFrames = tuple[BodyParams, Bool[np.ndarray, "T"]]
"""Bodies of all frames, and which of them are known."""


class _OneThread:
    """Torch on one thread inside; outside on as many as before any of several fits, which may overlap.

    Its operations are small here: two threads waiting for each other took six times the processor time. The kernels
    distribute frames over threads.
    """

    def __init__(self) -> None:
        self._lock, self._inside, self._before = threading.Lock(), 0, 1

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._before = torch.get_num_threads()
            self._inside += 1
            torch.set_num_threads(1)

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._inside -= 1
            # Of this thread, and of those that start later: in fits of other threads it stays 1.
            torch.set_num_threads(self._before)


_one_thread = _OneThread()


def _on_one_thread(
    function: Callable[Concatenate[Clip, BodyModel, FitConfig, P], Generator[FitEvent, None, Outcome]],
) -> Callable[Concatenate[Clip, BodyModel, FitConfig, P], Generator[FitEvent, None, Outcome]]:
    """Torch uses one thread while the generator runs, and as many as before between its values."""

    @wraps(function)
    def run(
        clip: Clip, body: BodyModel, config: FitConfig, *args: P.args, **kwargs: P.kwargs
    ) -> Generator[FitEvent, None, Outcome]:
        prepare_for(config)
        events = function(clip, body, config, *args, **kwargs)
        try:
            while True:
                with _one_thread:
                    try:
                        event = next(events)
                    except StopIteration as stop:
                        return stop.value
                yield event
        finally:
            events.close()

    return run


@_on_one_thread
def fit_events(
    clip: Clip,
    body: BodyModel,
    config: FitConfig,
    *,
    start: GivenStart | None = None,
    shape: KnownShape | None = None,
    known: KnownFrames | None = None,
) -> Generator[FitEvent, None, FitResult]:
    """Fits a clip, yielding events; closing the generator cancels, and finished phases stay valid.

    Args:
        clip: keypoints and camera.
        body: the body model.
        config: everything else; see `config.PRESETS`.
        start: another system's result for this clip, to begin phase 1 with (`starts.reading.read_start`); frames that
            it lacks are fitted as without it.
        shape: a known one, which phase 2 takes in place of the one that it finds.
        known: first fits of frames, from an interrupted fit that this one continues.

    Raises:
        InputError: no frame of the clip shows enough of a person.
    """
    return (yield from _Fit(related(clip), body, config, start=start, shape=shape, known=known).run())


def fit_clip(
    clip: Clip,
    body: BodyModel,
    config: FitConfig,
    *,
    start: GivenStart | None = None,
    shape: KnownShape | None = None,
    views: Sequence[OtherView] = (),
    tell: Callable[[FitEvent], object] = lambda event: None,
) -> FitResult:
    """Fit a clip to its end. Arguments and errors as of `fit_events`, and:

    Args:
        views: Other clips of the person at the same time, in addition to `clip.views`.
        tell: receives each event; what it raises cancels the fit.
    """
    clip = replace(clip, views=(*clip.views, *views))
    return drained(mapped(fit_events(clip, body, config, start=start, shape=shape), tell))


@dataclass(frozen=True, kw_only=True)
class Refit:
    """The result of fitting some frames again."""

    params: BodyParams
    """All frames."""
    provenance: Provenance
    """Of all frames; only valid for those that were fitted again."""


@_on_one_thread
def rerun_events(
    clip: Clip,
    body: BodyModel,
    config: FitConfig,
    params: BodyParams,
    frames: range,
    *,
    start: GivenStart | None = None,
    size: float | None = None,
) -> Generator[FitEvent, None, Refit]:
    """Phase 3 again on `frames` only, starting from `params`; all other frames are returned bit for bit.

    Args:
        clip: keypoints and camera.
        body: the body model.
        config: everything else.
        params: a result for this clip, all frames.
        frames: the ones to fit again, counted from the first of the clip as 0.
        start: what that result's fit began with, `FitResult.start`: these frames have the same evidence.
        size: of its person, `FitResult.size`.
    """
    first = clip.first_frame
    asked = f"{first + frames.start} to {first + frames.stop - 1}"
    if not (0 <= frames.start < frames.stop <= len(clip)):
        raise InputError(
            f"Frames {asked} cannot be fitted again: the clip has frames {first} to {first + len(clip) - 1}."
        )
    near = coupled(frames, len(clip))
    whole = Stages.of_clip(clip, body, config, start=start, size=size)
    stages = whole.within(near)
    consistency = Consistency(stages, make_solver(config.solver, config.settings))
    yield PhaseStarted(phase=3, title=f"frames {asked} again")
    moving = range(frames.start - near.start, frames.stop - near.start)
    inner, before = slice(moving.start, moving.stop), params.to(dtype=torch.float64)

    def with_fresh(state: State) -> BodyParams:
        return before.with_frames(frames, stages.parametrisation.to_params(state[inner]))

    state = stages.parametrisation.from_params(params[slice(near.start, near.stop)])
    state = mirrored_as_told(stages, state, stages.all_frames[inner])
    again = ever_firmer(
        lambda state: consistency.rerun(state, moving), consistency, state, whole, params_of=with_fresh, near=near
    )
    state = yield from _events(again, 3)
    known = Provenance(np.full(len(frames), Start.AGAIN, np.uint8), consistency.stopped[inner])
    return Refit(params=with_fresh(state), provenance=Provenance.unknown(len(clip)).with_frames(frames, known))


@_on_one_thread
def shape_events(
    clip: Clip, body: BodyModel, config: FitConfig, start: FitResult, *, shape: KnownShape | None = None
) -> Generator[FitEvent, None, FitResult]:
    """Phase 2 again after a fit's first phase, and phase 3 under the new shape if `config.last_phase` includes it.
    Raises InputError if it has no first phase, or no frame of the clip shows a person.

    Args:
        clip: keypoints and camera.
        body: the body model.
        config: everything else.
        start: its first phase is kept, and what that began with.
        shape: as in `fit_events`.
    """
    again = _Fit(related(clip), body, config, start=start.start, shape=shape)
    return (yield from again.run_again(start))


def clip_stages(clip: Clip, body: BodyModel, config: FitConfig, *, start: GivenStart | None = None) -> Stages:
    """The stages of a clip. Raises InputError if no frame of the clip shows enough of a person.

    Args:
        clip: keypoints and camera.
        body: the body model.
        config: everything else.
        start: as in `fit_events`.
    """
    stages = Stages.of_clip(clip, body, config, start=start)
    if not bool(stages.observations.usable.any()):
        raise InputError(
            f"No frame of {clip.name} shows a person: a frame needs at least 4 body keypoints with a confidence "
            f"above {SEEN}. Check the keypoint files, or --person."
        )
    return stages


class _Fit:
    """One fit: its constants, and the phases finished so far."""

    def __init__(
        self,
        clip: Clip,
        body: BodyModel,
        config: FitConfig,
        *,
        start: GivenStart | None = None,
        shape: KnownShape | None = None,
        known: KnownFrames | None = None,
    ) -> None:
        self.clip, self.body, self.config, self.start, self.shape = clip, body, config, start, shape
        self.known = known
        self.stages = clip_stages(clip, body, config, start=start)
        self.solver = make_solver(config.solver, config.settings)
        self.phases: list[PhaseResult] = []
        self.provenance: Provenance | None = None
        """The frames' current state."""
        self.size: float | None = None
        """Of the person, once phase 2 has found a shape."""
        self.result: FitResult | None = None
        """Of the phases so far."""

    def run(self) -> Generator[FitEvent, None, FitResult]:
        """All phases up to the configured last one."""
        sight = yield from self._first()
        state = sight.state
        if self.config.last_phase >= 2:
            state = yield from self._second(sight)
        del sight  # with the stages of phase 1
        return (yield from self._last(state))

    def run_again(self, start: FitResult) -> Generator[FitEvent, None, FitResult]:
        """The phases after the first, from another fit's first phase."""
        sight, first = Sight.after_first_phase(self.stages, start), start.phase(1)
        assert first is not None
        self.phases.append(first)
        self.provenance = first.provenance
        # Poses unchanged: a latent prior does not reproduce them exactly.
        state = yield from self._second(sight, poses=first.params)
        del sight
        return (yield from self._last(state))

    def _last(self, state: State) -> Generator[FitEvent, None, FitResult]:
        """Phase 3, if it is the configured last one, and the end."""
        if self.config.last_phase >= 3:
            yield from self._third(state)
        assert self.result is not None, "phase 1 has finished"
        yield Finished(result=self.result)
        return self.result

    def _first(self) -> Generator[FitEvent, None, Sight]:
        yield PhaseStarted(phase=1, title=PHASE_TITLES[1])
        start, first = time.perf_counter(), self.clip.first_frame
        fits = yield from _events(fit_frames(self.stages, self.solver, first_frame=first, known=self._known), 1)
        self.provenance, params = fits.provenance, self.stages.parametrisation.to_params(fits.state)
        if self.config.last_phase == 1:
            betas = [self._betas(own) for own in params.betas.numpy()]
            params = with_shape(self.body, params, np.stack(betas))
        yield self._finish(1, fits.state, start, fits.notes, params=params)
        return Sight.of(self.stages, fits.state, fits.cost.isfinite())

    @property
    def _known(self) -> FrameFits | None:
        """The known frames, at a cost that no other fit is below: the relay computes their own."""
        if self.known is None:
            return None
        params, there = self.known
        fits = FrameFits.at(self.stages.parametrisation.from_params(params), Start.AGAIN)
        return replace(fits, cost=fits.cost.masked_fill(torch.as_tensor(there).to(fits.cost.device), 0.0))

    def _second(self, sight: Sight, *, poses: BodyParams | None = None) -> Generator[FitEvent, None, State]:
        yield PhaseStarted(phase=2, title=PHASE_TITLES[2])
        start, state, columns = time.perf_counter(), sight.state, self.stages.parametrisation.columns
        found = yield from _events(fit_shape(sight, self.solver, self.config.shape_sample), 2)
        found_betas = found.state.vector[0, columns.betas]
        one_shape = state.with_columns(columns.betas, found_betas.expand(len(state), -1))
        own = found_betas.double().cpu().numpy()
        betas = self._betas(own)
        frames = ", ".join(map(str, (self.clip.first_frame + found.frames).tolist()))
        notes = (f"shape from frames {frames}", *found.notes) if self.shape is None else (self.shape.sentence(),)
        before = poses or self.stages.parametrisation.to_params(state)
        params = with_shape(self.body, before, np.tile(betas, (len(before), 1)))
        self.size = self.stages.fitted.size * float(height_of(self.body, betas) / height_of(self.body, own))
        yield self._finish(2, one_shape, start, notes, sample=(found.state, found.frames), params=params)
        for where, values in ((columns.betas, params.betas), (columns.translation, params.camera_translation)):
            state = state.with_columns(where, values.to(state.vector))
        return state

    def _betas(self, found: Float[np.ndarray, "10"]) -> Float[np.ndarray, "10"]:
        """The shape of the result: the known one, or the found one at the given or the likely height."""
        height = self.config.height
        if self.shape is not None:
            return self.shape.betas
        if height is None and not any(self.config.weights.relative_position):
            return found
        return resized(self.body, found, likely_height(self.body, found) if height is None else height / 100)

    def _third(self, state: State) -> Generator[FitEvent, None, None]:
        yield PhaseStarted(phase=3, title=PHASE_TITLES[3])
        start, lifter = time.perf_counter(), self.stages.lifter
        del self.stages  # as large as the next ones
        give_back()
        self.stages = Stages.of_clip(self.clip, self.body, self.config, start=self.start, size=self.size, lifter=lifter)
        consistency = Consistency(self.stages, self.solver)
        mode = {"global": consistency.all_at_once, "sliding_window": consistency.sliding_window}
        run, to_params = mode[self.config.temporal.mode], self.stages.parametrisation.to_params
        held = ever_firmer(run, consistency, state, self.stages, params_of=to_params, near=range(len(state)))
        state = yield from _events(held, 3)
        before = self.provenance or Provenance.unknown(len(state))
        self.provenance = replace(before, stopped=consistency.stopped)
        yield self._finish(3, state, start, tuple(consistency.notes), stages=consistency.stages)
        assert self.result is not None
        # The result is shown meanwhile.
        last = replace(self.result.last, error_bars=error_bars(consistency.stages, state))
        self.result = replace(self.result, phases=(*self.result.phases[:-1], last))

    def _finish(
        self,
        phase: int,
        state: State,
        start: float,
        notes: tuple[str, ...],
        *,
        sample: tuple[State, Tensor] | None = None,
        params: BodyParams | None = None,
        stages: Stages | None = None,
    ) -> PhaseFinished:
        result = phase_result(
            stages or self.stages, phase, state, seconds=time.perf_counter() - start, notes=notes, sample=sample
        )
        if params is not None:
            result = replace(result, params=params)
        result = replace(result, provenance=self.provenance)
        self.phases.append(result)
        self.result = self._result()
        give_back()
        return PhaseFinished(phase=phase, result=result, so_far=self.result)

    def _result(self) -> FitResult:
        result = FitResult(
            phases=tuple(self.phases),
            camera=self.clip.camera,
            config=self.config,
            observed=self.stages.observed,
            pose_prior=self.stages.parametrisation.prior.title,
            start=self.start,
            size=self.size,
            warnings=(
                *self.clip.notes,
                *(view.sentence() for view in self.clip.views),
                *self._unused_views(),
                *self._start_notes(),
                *unswapped_limbs(self.stages.observations, self.clip.first_frame),
                *(note for p in self.phases for note in p.notes),
                *doubts(self.clip, self.phases[-1].params),
                *small_adult(self.body, self.config.height),
                *other_height(self.body, self.shape, self.config.height),
            ),
        )
        grounding = grounding_of_params(self.stages, result.last.params)
        warnings = (*result.warnings, *feet_let_go(grounding, self.clip.first_frame))
        return replace(result, grounding=grounding, warnings=warnings)

    def _unused_views(self) -> tuple[str, ...]:
        if not self.clip.views or any(self.config.weights.relative_position):
            return ()
        return ("Other views do not count in this fit, because its weights.relative_position are 0.",)

    def _start_notes(self) -> tuple[str, ...]:
        if self.start is None:
            return ()
        near = self.config.start_deviation
        hold = "not held near it" if near is None else f"held near it (start_deviation {near:g} m)"
        return (*self.start.about.notes, f"{self.start.about.sentence()} The fit is {hold}.")


def _events(steps: Generator[PhaseStep, None, Outcome], phase: int) -> Generator[FitEvent, None, Outcome]:
    """A phase's steps as events. Progress never decreases: an alternative that is tried begins where the one before it
    did, as with the four yaws, and torch reports every iteration."""
    sampling, done = TermSampling(), 0.0

    def event(step: PhaseStep) -> FitEvent:
        nonlocal done
        if step.fitted is not None:
            return FramesFitted(phase=phase, frames=step.fitted[0], params=step.fitted[1])
        done = max(done, step.share)
        return Iteration(phase=phase, label=step.label, share=done, cost=step.cost, terms=sampling.terms(step))

    return (yield from mapped(steps, event))
