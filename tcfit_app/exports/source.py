"""The source of an export: the motion of a fit, and its project."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.markers.marker_set import STANDARD, MarkerSet
from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.ground.grounding import Grounding
from fitting_core.ground.level import level_of
from fitting_core.motion import Motion
from fitting_core.priors.latent import LatentPrior
from fitting_core.priors.pose import make_prior
from fitting_core.render.overlay import ViewName
from fitting_core.results.fit_result import FitResult, PhaseResult
from fitting_core.video.images import image_files
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.fitting.fits import Shown


@dataclass(frozen=True, kw_only=True)
class ExportedFit:
    """One phase of a project's run that is exported."""

    shown: Shown
    fit: FitResult
    meshes: Meshes

    @property
    def body(self) -> BodyModel:
        """The fitted body model."""
        return self.meshes.body

    def motion(self, clip: Clip) -> Motion:
        """The motion of all frames, in camera space."""
        return Motion(
            body=self.body,
            params=self.shown.params,
            camera=self.shown.camera,
            frame_rate=clip.frame_rate,
            name=clip.name,
            first_frame=clip.first_frame,
            contacts=None if self.fit.grounding is None else self.fit.grounding.contacts,
            error_bars=None if self.shown.result is None else self.shown.result.error_bars,
            level=level_of(self.fit.grounding, self.shown.camera.world),
        )

    @property
    def embedding(self) -> Float[Tensor, "T 32"] | None:
        """The body poses as coefficients of the latent prior of the fit; None without one."""
        if not self.fit.pose_prior:
            return None
        prior = make_prior(self.fit.config.pose_prior, dtype=torch.float64, device="cpu")
        same = isinstance(prior, LatentPrior) and prior.title == self.fit.pose_prior
        return prior.encode(self.shown.params.body_pose.double()) if same else None

    def posed(self, clip: Clip) -> PosedFit:
        """The fit, posed for figures. Raises InputError while the phase is still being fitted."""
        if self.shown.result is None:
            raise InputError(f"{self.shown.run.name} is still being fitted: export its figures when it is done.")
        phase = self.fit.phase(self.shown.phase)
        return PosedFit.of(clip, self.fit, self.meshes, phase=phase, there=self.shown.there)

    def __getitem__(self, frames: slice) -> "ExportedFit":
        """A part: consecutive frames."""
        whole, observed = len(self.fit.observed), self.fit.observed[frames]
        if len(observed) == whole:
            return self
        note = f"A part of a fit of {whole} frames: seconds and the other warnings are those of the whole."
        phases = tuple(_part(phase, frames) for phase in self.fit.phases)
        grounding = None if self.fit.grounding is None else self.fit.grounding[frames]
        warnings = (*self.fit.warnings, note)
        camera = self.fit.camera[frames]
        fit = replace(self.fit, phases=phases, observed=observed, warnings=warnings, grounding=grounding, camera=camera)
        there = None if self.shown.there is None else self.shown.there[frames]
        result = None if self.shown.result is None else _part(self.shown.result, frames)
        shown = replace(
            self.shown, params=self.shown.params[frames], camera=self.shown.camera[frames], there=there, result=result
        )
        return replace(self, fit=fit, shown=shown)


def _part(phase: PhaseResult, frames: slice) -> PhaseResult:
    """Consecutive frames of a phase. Costs are stored by frame, not by term."""
    cost, known, bars = phase.frame_cost[frames], phase.provenance, phase.error_bars
    return replace(
        phase,
        params=phase.params[frames],
        frame_cost=cost,
        objective={"by frame": float(cost.mean())},
        provenance=None if known is None else known[frames],
        error_bars=None if bars is None else bars[frames],
    )


@dataclass(frozen=True, kw_only=True)
class ExportSource:
    """A snapshot of the exported data at the time of the request."""

    name: str
    """The clip's."""
    chosen: ExportedFit | None = None
    """The exported run."""
    compared: Sequence[ExportedFit] = ()
    """A and B, for formats that show two, as far as they exist."""
    known_clip: Clip | None = None
    """With the current keypoints."""
    known_motion: Motion | None = None
    """The motion of a result of `tcfit fit`, which has no project."""
    known_grounding: Grounding | None = None
    """The grounding of such a result."""
    project: Path | None = None
    axes: str | None = None
    """A name of AXES, or OWN_WORLD; None: as the format's readers expect."""
    known_video: Path | None = None
    """The video or images of a result."""
    views: tuple[ViewName, ...] = ("camera",)
    """Views of pictures and videos, drawn beside each other."""
    markers: MarkerSet = STANDARD
    """The set of markers."""
    notes: tuple[str, ...] = ()
    """Notes for users, such as that the fit was stopped."""

    @property
    def clip(self) -> Clip:
        """The project's."""
        assert self.known_clip is not None, "formats that need a clip are not offered for a result"
        return self.known_clip

    @property
    def video(self) -> Path | None:
        """The video or images, if any."""
        return self.known_video if self.known_clip is None else self.known_clip.source

    @property
    def images(self) -> tuple[Path, ...]:
        """The clip's images, if their names are unique: exports are named after them."""
        clip = self.known_clip
        if clip is None:  # a result alone
            return ()
        images = image_files(clip.source)[clip.first_frame : clip.first_frame + len(clip)]
        return images if len({image.stem for image in images}) == len(clip) else ()

    @property
    def fit(self) -> ExportedFit:
        """The exported run. Raises InputError without a run."""
        if self.chosen is None:
            raise InputError("There is no fit to export yet: fit everything first.")
        return self.chosen

    @property
    def grounding(self) -> Grounding | None:
        """The fit's grounding; None if not computed."""
        return self.known_grounding if self.known_motion is not None else self.fit.fit.grounding

    @property
    def folder(self) -> Path:
        """The project's."""
        assert self.project is not None, "formats that need a project are not offered for a result"
        return self.project

    @property
    def span(self) -> tuple[int, int]:
        """Numbers in the video of its first and last frame."""
        motion = self.known_motion
        first = motion.first_frame if motion is not None else self.clip.first_frame
        count = len(motion) if motion is not None else len(self.clip)
        return first, first + count - 1

    def between(self, begin: int | None, end: int | None) -> "ExportSource | None":
        """Its part between two frame numbers of the video, both included (None: no bound); None if it is empty."""
        first, last = self.span
        start, stop = max(first, first if begin is None else begin), min(last, last if end is None else end)
        return self[start - first : stop - first + 1] if start <= stop else None

    def motion(self, axes: str) -> Motion:
        """The motion in the requested axes, or in these by default."""
        motion = self.known_motion or self.fit.motion(self.clip)
        return motion.in_axes(self.axes or axes)

    def __getitem__(self, frames: slice) -> "ExportSource":
        """A part: consecutive frames of everything except the project."""
        return replace(
            self,
            chosen=None if self.chosen is None else self.chosen[frames],
            compared=[fit[frames] for fit in self.compared],
            known_clip=None if self.known_clip is None else part_of(self.known_clip, frames),
            known_motion=None if self.known_motion is None else self.known_motion[frames],
        )


def part_of(clip: Clip, frames: slice) -> Clip:
    """Consecutive frames of a clip."""
    start, _, _ = frames.indices(len(clip))
    return replace(
        clip, keypoints=clip.keypoints[frames], camera=clip.camera[frames], first_frame=clip.first_frame + start
    )
