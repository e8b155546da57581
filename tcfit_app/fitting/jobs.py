"""The worker's jobs, as generators of the fitter's events; some produce a run."""

import time
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import body_keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from fitting_core.fit.events import FitEvent, FramesFitted, Iteration, PhaseFinished, drained
from fitting_core.fit.fitting import KnownFrames, fit_events, shape_events
from fitting_core.fit.refitting import refit_events
from fitting_core.keypoints import BODY, COUNT, Keypoints
from fitting_core.results.fit_result import FitResult
from fitting_core.results.given_start import GivenStart, KnownShape
from tcfit_app.project.frame_words import in_words


class Job(Protocol):
    """Work for the worker thread."""

    @property
    def title(self) -> str:
        """For users."""
        ...

    @property
    def phases(self) -> tuple[int, ...]:
        """The phases it runs, in order."""
        ...

    def run(self) -> Generator[FitEvent | None, None, FitResult]:
        """Do it and return all phases; closing the generator cancels it. None: it is waiting."""
        ...


Fresh = tuple[range, Keypoints] | Clip | None
"""Keypoints of some frames, from the clip's first; at the end the whole clip; None: nothing new."""
_AWAY = 4.0
"""Metres, of a person visible from head to foot."""
_NAP = 0.1
"""Seconds between polls for keypoints being detected."""


@dataclass(kw_only=True)
class FitEverything:
    """All phases of a fit; while keypoints are being detected, first a preview of each stretch."""

    clip: Clip
    """Without keypoints while they are being detected."""
    body: BodyModel
    config: FitConfig
    begun_with: GivenStart | None = None
    """Another system's result."""
    shape: KnownShape | None = None
    fresh: Callable[[], Fresh] | None = None
    """What has arrived since the last call during detection, while frames are only previewed. Raises InputError if
    there will be no more."""
    known: KnownFrames | None = None
    """The frames of an interrupted fit that this one continues."""

    @property
    def title(self) -> str:
        """For the user."""
        return f"Fit {self.clip.name}"

    @property
    def phases(self) -> tuple[int, ...]:
        """Up to the configured last one."""
        return tuple(range(1, self.config.last_phase + 1))

    def run(self) -> Generator[FitEvent | None, None, FitResult]:
        """Preview frames, then the events of `fitting.fit_events`; None while it waits."""
        if self.fresh is not None:
            while not isinstance(fresh := self.fresh(), Clip):
                if fresh is None:
                    time.sleep(_NAP)
                    yield None
                else:
                    yield from self.first_look(*fresh)
            self.clip, self.fresh = fresh, None
        events = fit_events(
            self.clip, self.body, self.config, start=self.begun_with, shape=self.shape, known=self.known
        )
        return (yield from events)

    def first_look(self, frames: range, keypoints: Keypoints) -> Generator[FitEvent, None, None]:
        """Preview: each frame by itself, in a twentieth of the time of phase 1."""
        label = f"preview of {in_words(frames, self.clip.first_frame)}"
        settings = replace(self.config.settings, final_tolerance=self.config.settings.stage_tolerance)
        quick = replace(
            self.config, last_phase=1, relay_rounds=0, limb_flips=False, yaws="side_view", settings=settings
        )
        part = replace(self.clip, keypoints=keypoints, camera=self.clip.camera[frames.start : frames.stop], views=())
        try:
            for event in fit_events(part, self.body, quick):
                if isinstance(event, PhaseFinished):
                    yield FramesFitted(phase=1, frames=frames, params=event.result.params)
                elif isinstance(event, Iteration):
                    yield replace(event, label=label, share=0.0)
        except InputError:
            return  # too few keypoints: the whole fit uses the frames around


def warm_up(body: BodyModel, config: FitConfig) -> None:
    """Load what fits need, which takes a second: a body is fitted that stands in front of a camera."""
    camera = Camera(focal=(550.0, 550.0), center=(320.0, 240.0), size=(640, 480))
    clip = Clip(keypoints=_standing(body, camera), camera=camera, frame_rate=25.0, name="warm-up")
    drained(FitEverything(clip=clip, body=body, config=config).first_look(range(1), clip.keypoints))


def _standing(body: BodyModel, camera: Camera) -> Keypoints:
    points = body_keypoints_in_space(body, BodyParams.neutral(1)) * (1, -1, -1) + (0, 0, _AWAY)
    known = np.isfinite(points).all(-1)
    xy, confidence = np.zeros((1, COUNT, 2)), np.zeros((1, COUNT))
    xy[:, BODY][known] = project(camera, torch.as_tensor(points[known])).numpy()
    confidence[:, BODY] = known
    return Keypoints(xy=xy, confidence=confidence)


@dataclass(frozen=True, kw_only=True)
class RerunFrames:
    """Phase 3 again on some ranges of frames, one after the other, starting from a fit."""

    clip: Clip
    body: BodyModel
    config: FitConfig
    start: FitResult
    windows: tuple[range, ...]

    @property
    def title(self) -> str:
        """For the user."""
        frames = sorted({i for window in self.windows for i in window})
        return f"Re-run {in_words(frames, self.clip.first_frame)}"

    @property
    def phases(self) -> tuple[int, ...]:
        """Phase 3 only."""
        return (3,)

    def run(self) -> Generator[FitEvent, None, FitResult]:
        """See `refitting.refit_events`."""
        return refit_events(self.clip, self.body, self.start, self.windows, config=self.config, title=self.title)


@dataclass(frozen=True, kw_only=True)
class FitShape:
    """The shape again, and then phase 3 if configured."""

    clip: Clip
    body: BodyModel
    config: FitConfig
    start: FitResult
    shape: KnownShape | None = None

    @property
    def title(self) -> str:
        """For the user."""
        return "Re-run shape"

    @property
    def phases(self) -> tuple[int, ...]:
        """Phases 2 and 3."""
        return (2, 3) if self.config.last_phase >= 3 else (2,)

    def run(self) -> Generator[FitEvent, None, FitResult]:
        """See `fitting.shape_events`; starts from the poses of phase 1."""
        return shape_events(self.clip, self.body, self.config, self.start, shape=self.shape)


@dataclass(kw_only=True)
class RunJob:
    """A job that produces a run."""

    run_id: int
    job: FitEverything | RerunFrames | FitShape
    start: Callable[[], FitResult] | None = None
    """Returns the fit to refit, if it does not exist yet: called when the job starts."""

    @property
    def title(self) -> str:
        """As the job's."""
        return self.job.title

    @property
    def phases(self) -> tuple[int, ...]:
        """As the job's."""
        return self.job.phases

    @property
    def clip(self) -> Clip:
        """As the job's."""
        return self.job.clip

    def run(self) -> Generator[FitEvent | None, None, FitResult]:
        """As the job's. Raises InputError if the fit to start from never came."""
        if self.start is not None:
            assert isinstance(self.job, RerunFrames)
            self.job = replace(self.job, start=self.start())
        return self.job.run()


@dataclass(kw_only=True)
class CorrectionJob:
    """A re-run around some edits, whose windows go into the run's corrections."""

    origin: int
    edits: dict[int, bool]
    """The edits it follows, by id, and whether they stand: an undo is followed too."""
    title: str
    """For the user."""
    renewed: "Callable[[CorrectionJob], tuple[RerunFrames, dict[int, bool], int]]"
    """The re-run, the edits still to be followed, and the id of the last log entry in its keypoints, as of now: drags
    and undos go first. Reads from disk, so only for the worker's thread."""
    keep: "Callable[[CorrectionJob, FitResult], None]"
    """Stores the result. Only for the worker's thread."""
    job: RerunFrames | None = None
    """None until it starts."""
    edits_seen: int = 0
    phases: tuple[int, ...] = (3,)

    def run(self) -> Generator[FitEvent, None, FitResult]:
        """The re-run, from the current state; nothing if everything to follow was undone."""
        self.job, self.edits, self.edits_seen = self.renewed(self)
        return (yield from self.job.run()) if self.edits else self.job.start


def around(frames: Iterable[int], reach: int, length: int) -> tuple[range, ...]:
    """Frames with their neighbours, as disjoint ranges."""
    merged: list[range] = []
    for frame in sorted(frames):
        window = range(max(0, frame - reach), min(length, frame + reach + 1))
        if merged and window.start <= merged[-1].stop:
            merged[-1] = range(merged[-1].start, window.stop)
        else:
            merged.append(window)
    return tuple(merged)
