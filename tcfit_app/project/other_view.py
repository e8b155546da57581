"""Another view of a project's person, as it is now."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera
from fitting_core.clip import Clip, OtherView
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.other_views import StandingView
from tcfit_app.project.storage.media import Media


@dataclass(frozen=True, kw_only=True, eq=False)
class ProjectView:
    """A view; another object whenever its keypoints or its video change."""

    standing: StandingView
    media: Media
    """Where its video was found, and what is wrong with it."""

    @property
    def id(self) -> int:
        """Of the log entry that added it."""
        return self.standing.id

    @property
    def corrected(self) -> Corrected:
        """Its keypoints, with which were edited and which are bad."""
        return self.standing.corrected

    @cached_property
    def view(self) -> OtherView:
        """With its corrections."""
        added = self.standing.added
        clip = Clip(
            keypoints=self.corrected.keypoints(),
            camera=added.camera,
            frame_rate=added.frame_rate,
            name=added.name,
            source=self.media.path,
            first_frame=added.first_frame,
            detector=added.detector,
        )
        times = None if added.times is None else np.array(added.times)
        return OtherView(clip=clip, times=times, relation=added.relation)

    def seen_by(self, camera: Camera) -> OtherView:
        """The same for a clip of another camera; its relation is to be found again if that changes the viewing rays."""
        return self._unrelated if camera.path else self._related.get(camera.focal, self._unrelated)

    def remember(self, camera: Camera, view: OtherView) -> None:
        """Keep how it was related to a clip of another camera."""
        self._related[camera.focal] = view

    @cached_property
    def _related(self) -> dict[tuple[float, float], OtherView]:
        return {self.standing.added.focal: self.view}

    @cached_property
    def _unrelated(self) -> OtherView:
        return replace(self.view, relation=None)

    @cached_property
    def _times(self) -> Float[np.ndarray, "T"]:
        """Of its frames, seconds from the clip's first frame."""
        view = self.view
        times = np.arange(len(view.clip)) / view.clip.frame_rate if view.times is None else view.times - view.times[0]
        return times - self.standing.added.relation.offset

    def frame_at(self, frame: int, frame_rate: float) -> int | None:
        """Its frame, from its first (0), that is nearest in time to one of the clip; None if it does not show that
        time."""
        time, times = frame / frame_rate, self._times
        half = max(float(np.median(np.diff(times))), 1 / frame_rate) / 2
        shown = times[0] - half < time < times[-1] + half
        return int(np.abs(times - time).argmin()) if shown else None

    def frames_beside(self, frames: tuple[int, ...], count: int, frame_rate: float) -> tuple[int, ...]:
        """The clip's frames, of `count`, whose fit depends on some frames of the view; at least one."""
        own, ends = np.arange(count), np.pad(self._times, 1, mode="reflect", reflect_type="odd")
        found = set[int]()
        for frame in frames:
            before, after = ends[frame] * frame_rate, ends[frame + 2] * frame_rate
            found.update(own[(own > before) & (own < after)].tolist())
        nearest = round(float(self._times[frames[0]] * frame_rate))
        return tuple(sorted(found)) or (min(max(nearest, 0), count - 1),)
