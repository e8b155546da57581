"""What all browsers draw from: video frames, meshes and figures, computed once for all of them."""

import logging
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int

from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.camera import project as in_picture
from fitting_core.clip import Clip, OtherView, Relation
from fitting_core.errors import InputError
from fitting_core.ground.from_pictures import StraightLines, straight_lines
from fitting_core.ground.level import Level, level_of
from fitting_core.metrics import error_figures
from tcfit_app.analysis.curves import Curve, between_runs, curve
from tcfit_app.analysis.levels import LevelSpans, level_spans
from tcfit_app.analysis.meshes import Meshes
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.analysis.run_metrics import Metric, reference_metrics, run_metrics
from tcfit_app.analysis.seen import evident, seen_joints
from tcfit_app.analysis.suspicion import ReviewQueue, findings, review_queue, still_checked, worst_place
from tcfit_app.analysis.view_scale import scale_of
from tcfit_app.fitting.edit_follower import LiveWindow
from tcfit_app.fitting.fits import FitChoice, Fits, Shown, own_phases
from tcfit_app.project.glance import off_by_part
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.project.storage.opening_body import OpeningBody
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.scene.room import Room, room_around
from tcfit_app.review.session.session import Session
from tcfit_app.review.session.tasks import Value
from tcfit_app.review.shared.video_frames import VideoFrames, Videos

_SAMPLED = 120
"""Maximum number of frames whose whole bodies determine a clip's extent: 0.1 s."""
_POINTS_KEPT = 500
"""Frames whose keypoints are cached, so that playback poses each once."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameBody:
    """A fit's body in one frame, or what a drag makes of it."""

    shown: Shown
    frame: int
    live: LiveWindow | None = None

    @property
    def version(self) -> Hashable:
        """Identifies it."""
        return self.shown.version if self.live is None else ("live", self.live.revision), self.frame

    @property
    def window(self) -> tuple[BodyParams, int]:
        """Parameters of some frames, and its place among them."""
        return (
            (self.shown.params, self.frame)
            if self.live is None
            else (self.live.params, self.frame - self.live.frames.start)
        )

    @property
    def params(self) -> BodyParams:
        """Of this frame alone."""
        params, place = self.window
        return params[[place]]


class DrawingData:
    """What is drawn and measured of a project, requested until it is ready. For the drawing thread only.

    Args:
        session: the project.
        wake: called when something requested is ready.
        videos: shared with the clip's other people, if any.
    """

    def __init__(self, session: Session, wake: Callable[[], None], videos: Videos | None = None) -> None:
        self.session = session
        clip = session.project.footage
        self.length = len(clip)
        self.tasks = session.tasks
        self._videos = videos or Videos([clip], wake)
        self._meshes: dict[str, Meshes] = {}
        self._points: dict[Hashable, np.ndarray] = {}
        self.warming = False
        """Whether the first body is still being read (a second); the drawing thread does not wait for it."""
        self._video = self._opened()
        self._beside: tuple[Clip, VideoFrames] | None = None
        """Another view's video, once it was shown."""
        self._view_scales: dict[Relation | None, float] = {}
        """Those shown last: another one for a moment would move the body in the view's picture."""

    def _opened(self) -> VideoFrames:
        self._of_video = self.session.project.video_version
        return self._videos.of(self.session.project.footage)

    @property
    def video(self) -> VideoFrames:
        """The frames of the project's media, by their numbers there: a new object when the media change."""
        if self._of_video != self.session.project.video_version:
            self._videos.leave(self._video)
            self._video = self._opened()
        return self._video

    def video_of(self, clip: Clip) -> VideoFrames:
        """The frames of another view; of one view at a time."""
        if self._beside is not None and self._beside[0].source != clip.source:
            self._videos.leave(self._beside[1])
            self._beside = None
        if self._beside is None:
            self._beside = clip, self._videos.of(clip)
        return self._beside[1]

    def leave(self, reader: Hashable) -> None:
        """Forget the frames that a reader was about to play."""
        for video in (self._video, *([] if self._beside is None else [self._beside[1]])):
            video.leave(reader)

    def warm_up(self) -> None:
        """Read what the first picture of a fitted project needs, before it is requested, or what the first fit does."""
        self.warming = True
        self.video.get(self.session.project.footage.first_frame)
        self.tasks.get("warm", self._first_body)
        self.tasks.get("warm fit", self.session.warm_up)

    def _first_body(self) -> None:
        try:
            shown = self.session.fits.show(FitChoice())
            if shown is not None:
                self.vertices(FrameBody(shown=shown, frame=0))
        except InputError as error:  # reported when it is shown
            _log.info("Nothing to show yet: %s", error)
        finally:
            self.warming = False

    def close(self) -> None:
        """End the videos' threads."""
        self._videos.leave(self._video)
        if self._beside is not None:
            self._videos.leave(self._beside[1])

    def meshes(self, shown: Shown) -> Meshes:
        """Of the run's body. Raises InputError if its model is missing."""
        body = self.session.bodies.of(shown.run.body)
        if body.hash not in self._meshes:
            self._meshes[body.hash] = Meshes(body)
        return self._meshes[body.hash]

    def vertices(self, body: FrameBody) -> Float32[np.ndarray, "V 3"]:
        """Camera space, metres; the same array for the same body. Raises InputError without its body model."""
        return self.meshes(body.shown).vertices(body.version, *body.window)

    def opening_body(self) -> OpeningBody | None:
        """What the project opens with the next time, if nothing changes any more; None without a fit on show. Raises
        InputError if the fit or its body model cannot be read."""
        project, fits = self.session.project, Fits(self.session.project)
        run = fits.meant(FitChoice())
        shown = fits.show(FitChoice()) if run is not None and self.session.fits.held(run) else None
        if shown is None or shown.result is None or not shown.has(0):
            return None
        present, meshes = self.present(0), self.meshes(shown)
        return OpeningBody(
            run=shown.run.id,
            vertices=meshes.batch(shown.params[[0]])[0],
            faces=meshes.faces,
            opacities=None if present is None else meshes.opacities(seen_joints(present)),
            camera=project.footage.camera,
            fit_camera=shown.camera,
        )

    def posed(self, shown: Shown) -> Callable[[], PosedFit]:
        """A function that poses a run together with the current keypoints, for another thread. Raises InputError if the
        body model is missing."""
        project, meshes = self.session.project, self.meshes(shown)
        fit = self.session.fits.fit(shown.run)

        def posed() -> PosedFit:
            clip, bad = project.clip, project.bad
            if shown.result is None:
                return PosedFit.posed(replace(clip, camera=fit.camera), shown.params, meshes, bad=bad)
            made = PosedFit.of(clip, fit, meshes, phase=shown.result, bad=bad, there=shown.there)
            # Another program's result has no costs here.
            return replace(made, frame_cost=None) if shown.run.kind == "imported" else made

        return posed

    def key(self, shown: Shown) -> Hashable:
        """Identifies everything that `posed` depends on."""
        return *shown.version, self.session.project.keypoints_version

    def curves(self, names: tuple[str, ...], shown: Shown) -> tuple[Curve, ...] | None:
        """Curves of the timeline, computed together; None while they are."""
        key = "curves", names, self.key(shown)
        return self._made(key, shown, lambda posed: tuple(curve(name, posed) for name in names))

    def levels(self, name: str, shown: Shown) -> LevelSpans | None:
        """One of LEVELS for the timeline; None while it is computed."""
        return self._made(("levels", name, self.key(shown)), shown, lambda posed: level_spans(name, posed))

    def level(self, shown: Shown) -> Level | None:
        """The camera's tilt and the floor according to a run; None if unknown, or not computed yet."""
        return None if shown.result is None else level_of(self.session.fits.fit(shown.run).grounding)

    def room(self, shown: Shown, held: Shown) -> Room | None:
        """The space in which a run's person moves; None while it is computed, or if there is no body yet.

        Args:
            shown: The run.
            held: The run that determines the camera's tilt, possibly another one.
        """
        meshes = self.meshes(shown)
        if shown.there is not None and not shown.there.any():
            return None

        def made() -> Room:
            sample = _sample(shown).tolist()
            return room_around(shown.camera[sample].to_still(meshes.batch(shown.params[sample])), level)

        level = self.level(held)
        return self.tasks.get(("room", _stage(shown), _stage(held)), made)

    def view_scale(self, view: OtherView, shown: Shown) -> float:
        """See `view_scale.scale_of`; while it is computed, the view's last one, or 1."""
        meshes, rate = self.meshes(shown), self.session.project.footage.frame_rate

        def made() -> float:
            sample = _sample(shown)
            return scale_of(view, meshes.body_points(shown.params[sample.tolist()]), sample / rate)

        if shown.there is None or shown.there.any():
            found = self.tasks.get(("view scale", view.relation, _stage(shown)), made)
            if found is not None:
                self._view_scales[view.relation] = found
        return self._view_scales.get(view.relation, 1.0)

    @property
    def straight_lines(self) -> StraightLines | None:
        """Those in the clip's pictures; None while they are detected, or if there is no video."""
        clip = self.session.project.footage
        video, frames = clip.source, range(clip.first_frame, clip.first_frame + len(clip))
        if video is None:
            return None
        key = "straight lines", clip.camera, self.session.project.video_version
        return self.tasks.get(key, lambda: straight_lines(clip.camera, video, frames))

    def body_points(self, body: FrameBody) -> Float[np.ndarray, "25 3"]:
        """A body's BODY_25 keypoints in camera space, metres, NaN for missing ones."""
        return self.meshes(body.shown).body_points(body.params)[0]

    def pelvis_depth(self, body: FrameBody) -> float:
        """z of a body's pelvis in camera space, metres, from which depths of edits count."""
        return float(joints_in_space(self.meshes(body.shown).body, body.params)[0, JOINT["pelvis"], 2])

    def present(self, frame: int) -> Bool[np.ndarray, "137"] | None:
        """The `evident` keypoints of a frame; None if the project has none, so that fits do not depend on them."""
        project = self.session.project
        return evident(project.corrected[[frame]].keypoints())[0] if project.has_detections else None

    def keypoints(self, body: FrameBody) -> Float[np.ndarray, "137 3"]:
        """A body's keypoints in camera space, metres, NaN for missing ones."""
        if body.version not in self._points:
            if len(self._points) > _POINTS_KEPT:
                self._points.clear()
            self._points[body.version] = self.meshes(body.shown).points(body.params)[0]
        return self._points[body.version]

    def gaps(self, body: FrameBody, joints: Sequence[int]) -> Float[np.ndarray, "n"]:
        """Distances in pixels of keypoints from a body in its frame, NaN for those that the body lacks."""
        points = torch.as_tensor(self.keypoints(body)[list(joints)])
        there = self.session.project.corrected.xy[body.frame, list(joints)]
        return np.linalg.norm(in_picture(body.shown.camera, points).numpy() - there, axis=-1)

    def metrics(self, shown: Shown) -> tuple[Metric, ...] | None:
        """Figures of a run; None while they are computed."""
        if shown.result is None:
            return None
        own, phases = own_phases(shown.run), self.session.fits.fit(shown.run).phases
        seconds = sum(p.seconds for p in phases if p.phase in own and p.phase <= shown.phase)
        return self._made(self._metrics_key(shown), shown, lambda posed: run_metrics(posed, seconds))

    def reference_metrics(self, shown: Shown) -> tuple[Metric, ...] | None:
        """Figures of a run against the project's reference, empty without one; None while they are computed."""
        reference, bodies = self.session.project.reference, self.session.bodies
        if reference is None or shown.result is None:
            return ()

        def measured(posed: PosedFit) -> tuple[Metric, ...]:
            return reference_metrics(posed, reference, lambda: bodies.of_reference(reference))

        return self._made(self._reference_key(shown), shown, measured)

    def _metrics_key(self, shown: Shown) -> tuple[Hashable, ...]:
        return "metrics", self.key(shown)

    def _reference_key(self, shown: Shown) -> Hashable:
        return "reference", *shown.version

    def between(self, a: Shown, b: Shown) -> Curve | None:
        """The distance between two runs, by frame; None while it is computed."""
        one = self._ready(a)
        if one is None:
            return None
        key = "between", a.version, b.version
        return self._made(key, b, lambda other: between_runs(one(), other))

    def queue(self, shown: Shown) -> ReviewQueue | None:
        """The review queue of a run; None while it is computed."""
        project = self.session.project
        found = self._made(self._findings_key(shown), shown, findings)  # not again for every mark
        if found is None:
            return None

        def queue() -> ReviewQueue:
            edited, refitted = project.frames_changed_after(0, views=False), self._refitted(shown.run)
            limbs = project.marks.of_limbs()
            checked, *of_limbs = (
                still_checked(marks, edited, refitted=refitted) for marks in (project.marks.all(), *limbs.values())
            )
            return review_queue(found, checked=checked, limbs=dict(zip(limbs, of_limbs, strict=True)))

        return self.tasks.get(self._suspects_key(shown), queue)

    def worst(self, shown: Shown) -> Worst | None:
        """The worst place of a run's queue, and how far it is off; None while they are computed."""
        found = self.queue(shown)
        if found is None:
            return None
        key = "worst", self._suspects_key(shown)
        return self._made(
            key, shown, lambda posed: worst_place(shown.run.id, found.left, off_by_part(error_figures(posed.errors)))
        )

    def _refitted(self, run: Run) -> list[tuple[int, range]]:
        """When which frames were refitted, as `Run.moment`; for corrections, according to the edits."""
        if run.kind in ("imported", "corrections"):
            return []
        return [(run.moment, run.frames or range(self.length))]

    def _suspects_key(self, shown: Shown) -> Hashable:
        return "suspects", self.key(shown), self.session.project.marks_version

    def _findings_key(self, shown: Shown) -> Hashable:
        return "findings", self.key(shown)

    def _made(self, key: Hashable, shown: Shown, make: Callable[[PosedFit], Value]) -> Value | None:
        posed = self._ready(shown)
        return None if posed is None else self.tasks.get(key, lambda: make(posed()))

    def _ready(self, shown: Shown) -> Callable[[], PosedFit] | None:
        """`posed` of a run, if its body model is loaded."""
        try:
            return None if self.warming else self.posed(shown)
        except InputError:
            return None

    def problem(self, what: Literal["metrics", "reference", "suspects"], shown: Shown) -> str:
        """Why a run has no figures, none against the reference, or no review queue; empty if nothing is wrong."""
        try:
            if not self.warming:
                self.meshes(shown)
                if shown.run.partial:
                    self.session.fits.fit(shown.run)
        except InputError as error:
            return str(error)
        keys = {
            "metrics": (self._metrics_key,),
            "reference": (self._reference_key,),
            "suspects": (self._findings_key, self._suspects_key),
        }
        return next((why for key in keys[what] if (why := self.tasks.problem(key(shown)))), "")


def _sample(shown: Shown) -> Int[np.ndarray, "n"]:
    """Some frames that have a pose."""
    there = np.arange(len(shown.params)) if shown.there is None else np.flatnonzero(shown.there)
    return there[:: -(-len(there) // _SAMPLED)]


def _stage(shown: Shown) -> Hashable:
    """Identifies a run; while it is running, also its progress, and how far away the person is thought to be."""
    if shown.result is not None:
        return shown.version
    there = np.ones(len(shown.params), bool) if shown.there is None else shown.there
    depths = shown.params.camera_translation[there, 2].numpy()
    far = round(4 * np.log2(max(float(np.median(depths)), 0.1))) if len(depths) else 0  # in steps of a fifth
    return shown.run.id, shown.phase, "all" if shown.there is None else int(there.sum()).bit_length(), far
