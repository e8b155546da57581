"""Other views of the person, added and removed from one browser tab."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import viser

from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.errors import InputError
from tcfit_app.fitting.reports import Notice
from tcfit_app.imports.uploads import kept_as
from tcfit_app.project.other_view import ProjectView
from tcfit_app.project.storage.names import file_name, name_of_file
from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.session.tasks import Step
from tcfit_app.review.tab.tab import OneTask, Tab

FOLD = "fit.view"
"""In `TabState.folds` while a view can be named or uploaded."""


class OtherViews:
    """The other views of one tab's clip, added one at a time. Methods raise InputError for what cannot be done."""

    def __init__(self, tab: Tab, correcting: Correcting) -> None:
        self._tab, self._correcting = tab, correcting
        self.task = OneTask(tab)
        """Finds keypoints in a video, and relates it to the clip."""

    def add(self, file: Path | viser.UploadedFile, millimetres: str = "") -> None:
        """Start finding the person in another video, which becomes a view if it shows the same motion.

        Args:
            file: The video.
            millimetres: Its camera's 35 mm equivalent focal length, as typed; empty: estimated.
        """
        tab, session, name = self._tab, self._tab.session, name_of_file(file.name)
        camera = CameraOptions(focal_length_35mm=_length(millimetres) if millimetres else None)
        tab.refuse_read_only()
        session.refuse_without_keypoints()
        clip = session.project.clip

        def work(report: Step) -> int:
            from fitting_core.clips.other_views import read_view
            from fitting_core.detect.detectors import DEFAULT, DETECTORS

            report("opening the detector", None)
            options = ClipOptions(detector=clip.detector if clip.detector in DETECTORS else DEFAULT)
            with _on_disk(file) as path:
                view = read_view(
                    clip,
                    path,
                    clip=options,
                    camera=camera,
                    tell=lambda now: report(f"{now.done} of {now.total} frames", now.share),
                )
                return session.project.add_view(view, copy_media=path is not file, author=tab.author).id

        self.task.begin(f"Adding {name}", work, partial(self._added, name), writes=True)

    def _added(self, name: str, number: int) -> None:
        self._tab.set(folds=self._tab.state.folds - {FOLD})
        self.show(number)
        self._tab.session.tell(Notice(title=f"Adding {name}: done", text="The next fit uses it.", kind="done"))

    def show(self, number: int) -> None:
        """Show a view beside the picture."""
        self._tab.set(
            side=True, side_from=number, mode="edit" if self._tab.state.mode == "space" else self._tab.state.mode
        )

    def remove(self, view: ProjectView) -> None:
        """Remove a view; that can be undone."""
        self._correcting.make(self._tab.session.project.removal_of_view(view.id))


def _length(text: str) -> float:
    try:
        length = float(text)
    except ValueError:
        length = math.nan
    if not 0 < length < math.inf:
        raise InputError(f"Focal length: {text}; expected millimetres (35 mm equivalent) such as 26, or nothing.")
    return length


@contextmanager
def _on_disk(file: Path | viser.UploadedFile) -> Iterator[Path]:
    """A file of this computer, or an uploaded one for the `with` block."""
    if isinstance(file, Path):
        yield file
        return
    shown = name_of_file(file.name)
    own = file_name(shown.lstrip(". ") or "view", "")  # which the view is called by
    with kept_as(own, file.content, shown) as path:
        yield path
