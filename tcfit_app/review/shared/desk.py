"""What all browsers draw from: frames of the video, meshes and figures, made once for all of them."""

import logging
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float32

from fitting_core.errors import InputError
from tcfit_app.analysis.curves import Curve, between_runs, curve
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.run_metrics import MeasuredRun, Metric, reference_metrics, run_metrics
from tcfit_app.analysis.suspicion import Suspect, review_queue, still_checked
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.fitting.following import LiveWindow
from tcfit_app.project.storage.runs import Run
from tcfit_app.review.session.session import Session
from tcfit_app.review.session.tasks import Value
from tcfit_app.review.shared.video_frames import VideoFrames

_GROUND_PERCENTILE = 95.0
"""Of the lowest joint's height over the frames: a foot that the fit pushes through the floor now and then is none."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A body in one frame."""

    vertices: Float32[np.ndarray, "V 3"]
    version: Hashable
    """Stands for the vertices."""


class Desk:
    """For the one thread that draws.

    Args:
        session: the project.
        wake: called when something is there that was asked for.
    """

    def __init__(self, session: Session, wake: Callable[[], None]) -> None:
        self.session = session
        clip = session.project.clip
        self.length = len(clip)
        self.tasks, self._wake = session.tasks, wake
        self._meshes: dict[str, Meshes] = {}
        self.warming = False
        """Whether the first body is still being read (a second): nothing on the drawing thread waits for it."""
        self.video = self._opened()

    def _opened(self) -> VideoFrames:
        clip = self.session.project.clip
        return VideoFrames(
            clip.source, first_frame=clip.first_frame, count=len(clip), size=clip.camera.size, arrived=self._wake
        )

    def warm_up(self) -> None:
        """Read what the first picture of a fitted project needs, before anybody asks for it."""
        self.warming = True
        self.video.get(0)
        self.tasks.get("warm", self._first_body)

    def _first_body(self) -> None:
        try:
            shown = self.session.fits.show(FitChoice())
            if shown is not None:
                self.body(shown, 0)
        except InputError as error:  # who looks at it is told then
            _log.info("Nothing to show yet: %s", error)
        finally:
            self.warming = False

    def reopen_video(self) -> None:
        """The project's media lie elsewhere now."""
        self.video.close()
        self.video = self._opened()

    def close(self) -> None:
        """End its thread."""
        self.video.close()

    def meshes(self, shown: Shown) -> Meshes:
        """Of the run's body. Raises InputError if that is not there."""
        body = self.session.bodies.of(shown.run.body)
        if body.hash not in self._meshes:
            self._meshes[body.hash] = Meshes(body)
        return self._meshes[body.hash]

    def body(self, shown: Shown, frame: int, live: LiveWindow | None = None) -> Drawn:
        """A run's body, as a live correction has it if one is given. Raises InputError without its body model."""
        meshes = self.meshes(shown)
        if live is not None:
            version, place = ("live", live.revision), frame - live.frames.start
            return Drawn(vertices=meshes.vertices(version, live.params, place), version=(version, frame))
        version = (shown.run.id, shown.phase, shown.revision)
        return Drawn(vertices=meshes.vertices(version, shown.params, frame), version=(version, frame))

    def posed(self, shown: Shown) -> Callable[[], PosedFit]:
        """What poses a run beside the keypoints as they are now, for another thread.

        Raises:
            InputError: Its body model is not there.
        """
        project, meshes = self.session.project, self.meshes(shown)
        clip, fit, bad = project.clip, self.session.fits.fit(shown.run), project.corrected.bad

        def posed() -> PosedFit:
            if shown.result is None:
                return PosedFit.posed(replace(clip, camera=fit.camera), shown.params, meshes, bad=bad)
            made = PosedFit.of(clip, fit, meshes, phase=shown.result, bad=bad)
            # What another program found has no costs here.
            return replace(made, frame_cost=None) if shown.run.kind == "imported" else made

        return posed

    def key(self, shown: Shown) -> Hashable:
        """Stands for everything that `posed` is made of."""
        return shown.run.id, shown.phase, shown.revision, self.session.edits

    def curve(self, name: str, shown: Shown) -> Curve | None:
        """A curve of the timeline; None while it is made."""
        return self._made(("curve", name, self.key(shown)), shown, lambda posed: curve(name, posed))

    def between(self, a: Shown, b: Shown) -> Curve | None:
        """How far two runs lie apart along the clip; None while it is made."""
        one, other = self._ready(a), self._ready(b)
        if one is None or other is None:
            return None
        return self.tasks.get(("between", self.key(a), self.key(b)), lambda: between_runs(one(), other()))

    def ground(self, shown: Shown) -> float | None:
        """Height of the floor under a run's person (y in camera space, metres); None while it is made."""

        def lowest(posed: PosedFit) -> float:
            return float(np.percentile(posed.joints[..., 1].max(1), _GROUND_PERCENTILE))

        return self._made(("ground", shown.run.id, shown.phase, shown.revision), shown, lowest)

    def metrics(self, shown: Shown) -> tuple[Metric, ...] | None:
        """Figures of a run; None while they are taken."""
        result = shown.result
        if result is None:
            return None
        seconds = sum(p.seconds for p in self.session.fits.fit(shown.run).phases if p.phase <= shown.phase)
        key = self._metrics_key(shown)
        return self._made(key, shown, lambda posed: run_metrics(MeasuredRun(fit=posed, phase=result, seconds=seconds)))

    def reference_metrics(self, shown: Shown) -> tuple[Metric, ...] | None:
        """Figures of a run against the project's reference, empty without one; None while they are taken."""
        reference, bodies = self.session.project.reference, self.session.bodies
        if reference is None or shown.result is None:
            return ()

        def measured(posed: PosedFit) -> tuple[Metric, ...]:
            return reference_metrics(posed, reference, lambda: bodies.of_reference(reference))

        return self._made(self._reference_key(shown), shown, measured)

    def _metrics_key(self, shown: Shown) -> Hashable:
        return "metrics", self.key(shown)

    def _reference_key(self, shown: Shown) -> Hashable:
        return "reference", shown.run.id, shown.phase, shown.revision, self.session.referenced

    def distances(self, a: Shown, b: Shown) -> Curve | None:
        """How far two runs lie apart, by frame; None while that is made."""
        one = self._ready(a)
        if one is None:
            return None
        key = ("distances", a.run.id, a.phase, a.revision, b.run.id, b.phase, b.revision)
        return self._made(key, b, lambda other: between_runs(one(), other))

    def suspects(self, shown: Shown) -> tuple[Suspect, ...] | None:
        """The review queue of a run; None while it is made."""
        project = self.session.project

        def queue(posed: PosedFit) -> tuple[Suspect, ...]:
            checked = still_checked(project.marks.all(), project.log, refitted=self._refitted(shown.run))
            return review_queue(posed, checked=checked)

        return self._made(self._suspects_key(shown), shown, queue)

    def _refitted(self, run: Run) -> list[tuple[int, range]]:
        """When which frames were fitted again, as `Run.moment`. Of corrections the edits tell that."""
        if run.kind in ("imported", "corrections"):
            return []
        return [(run.moment, run.frames or range(self.length))]

    def _suspects_key(self, shown: Shown) -> Hashable:
        return "suspects", self.key(shown), self.session.marked

    def _made(self, key: Hashable, shown: Shown, make: Callable[[PosedFit], Value]) -> Value | None:
        posed = self._ready(shown)
        return None if posed is None else self.tasks.get(key, lambda: make(posed()))

    def _ready(self, shown: Shown) -> Callable[[], PosedFit] | None:
        """`posed` of a run, if its body model is there by now."""
        try:
            return None if self.warming else self.posed(shown)
        except InputError:
            return None

    def problem(self, what: Literal["metrics", "reference", "suspects"], shown: Shown) -> str:
        """Why a run will get no figures, none against the reference, or no review queue; empty if nothing is wrong."""
        try:
            if not self.warming:
                self.meshes(shown)
        except InputError as error:
            return str(error)
        keys = {"metrics": self._metrics_key, "reference": self._reference_key, "suspects": self._suspects_key}
        return self.tasks.problem(keys[what](shown))
