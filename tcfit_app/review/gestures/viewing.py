"""Other views of the person, added and removed from one browser tab."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import viser

from fitting_core.clips.options import ClipOptions
from fitting_core.errors import InputError
from tcfit_app.fitting.reports import Notice
from tcfit_app.imports.uploads import kept_as
from tcfit_app.project.other_view import ProjectView
from tcfit_app.project.storage.names import file_name, name_of_file
from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.session.tasks import Step, Task
from tcfit_app.review.tab.tab import Tab

FOLD = "fit.view"
"""In `TabState.folds` while a view can be named or uploaded."""


class OtherViews:
    """The other views of one tab's clip, added one at a time. Methods raise InputError for what cannot be done."""

    def __init__(self, tab: Tab, correcting: Correcting) -> None:
        self._tab, self._correcting = tab, correcting
        self.going: Task[int] | None = None
        """The view that was begun last: finding keypoints in its video, and relating it to the clip."""

    def add(self, file: Path | viser.UploadedFile) -> None:
        """Start finding the person in another video, which becomes a view if it shows the same motion."""
        tab, session, name = self._tab, self._tab.session, name_of_file(file.name)
        tab.refuse_read_only()
        session.refuse_without_keypoints()
        if self.going is not None and self.going.state == "running":
            raise InputError(f"{self.going.title}: wait for it, or cancel it.")
        clip = session.project.clip

        def work(report: Step) -> int:
            from fitting_core.clips.other_views import read_view
            from fitting_core.detect.detectors import DEFAULT, DETECTORS

            report("opening the detector", None)
            options = ClipOptions(detector=clip.detector if clip.detector in DETECTORS else DEFAULT)
            with _on_disk(file) as path:
                view = read_view(
                    clip, path, clip=options, tell=lambda now: report(f"{now.done} of {now.total} frames", now.share)
                )
                return session.project.add_view(view, copy_media=path is not file, author=tab.author).id

        then = lambda task: tab.guarded(lambda: self._take_end(task))()  # noqa: E731
        self.going = session.tasks.submit(f"Adding {name}", work, then=then)

    def cancel(self) -> None:
        """Stop adding; nothing has changed."""
        if self.going is not None:
            self.going.cancel()

    def _take_end(self, task: Task[int]) -> None:
        tab = self._tab
        if task.state == "cancelled":
            self.going = None
            return tab.say(f"{task.title}: cancelled")
        if task.state == "failed":
            return tab.notify(Notice(title=f"{task.title}: not possible", text=task.reason, kind="error"))
        self.going = None
        tab.set(folds=tab.state.folds - {FOLD})
        self.show(task.result())
        tab.session.tell(Notice(title=f"{task.title}: done", text="The next fit uses it.", kind="done"))

    def show(self, number: int) -> None:
        """Show a view beside the picture."""
        self._tab.set(
            side=True, side_from=number, mode="edit" if self._tab.state.mode == "space" else self._tab.state.mode
        )

    def remove(self, view: ProjectView) -> None:
        """Remove a view; that can be undone."""
        self._correcting.make(self._tab.session.project.removal_of_view(view.id))


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
