"""The clip's other views in the Fit panel: what was found about each, and how to add and remove one."""

from functools import partial

from tcfit_app.project.other_view import ProjectView
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.viewing import FOLD
from tcfit_app.review.panels.elements.file_input import FileInput, TextRow
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    button,
    heading,
    joined,
    line,
    opener,
    paragraph,
    progress_bar,
    row,
    table,
    tag,
    words,
)

_SAID = (
    "A video of the same person at the same time, from another side: a second phone, neither calibrated nor in step."
)
_PATH = TextRow("Video", "On the computer that runs tcfit")
_UPLOAD = TextRow("Upload a video", "From this browser's computer")
_LENS = TextRow("Focal length (mm)", "35 mm equivalent of its camera, such as 26; empty: estimated")


class ViewList:
    """A part of the Fit panel."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab = gestures.tab
        self._views = Board(tab)
        self._fold = Fold(tab, FOLD)
        with self._fold:
            Board(tab).show(paragraph(_SAID, "dim"))
            self._file = FileInput(
                tab,
                "view.add",
                lambda file: gestures.views.add(file, self._file[_LENS.label]),
                path=_PATH,
                button="Add this view",
                missing="Type where the other video is first, or upload it.",
                upload=_UPLOAD,
                more=(_LENS,),
            )
            self._going = Board(tab)

    def draw(self) -> None:
        """Send what changed."""
        session = self._tab.session
        views = session.views.values()
        writable = session.project.has_detections and not session.project.read_only
        self._views.show(*([heading("Other views"), table(map(self._line, views))] if views else []))
        if self._fold.draw("Add another view of the same person", on=writable):
            self._file.draw(on=not self._gestures.views.task.busy)
            self._going.show(*self._progress())

    def _line(self, view: ProjectView) -> Html:
        shown = self._tab.view is view and self._tab.state.side
        name = opener(
            words(view.view.clip.name, "strong"), "view.show", str(view.id), partial(self._gestures.views.show, view.id)
        )
        found = [tag("div", text, class_=f"tcfit-{kind}") for text, kind in self._found(view)]
        off = self._tab.session.project.read_only
        remove = button(
            "Remove",
            "view.remove",
            str(view.id),
            do=partial(self._gestures.views.remove, view),
            disabled=off,
            kind="mini",
            hint="Undo brings it back",
        )
        return line(joined(name, *found), remove, numbers=(1,), kind="here" if shown else "", press=name)

    def _found(self, view: ProjectView) -> list[tuple[str, str]]:
        problem, name = view.media.problem, view.view.clip.name
        found = view.view.sentence().removeprefix(f"{name} is another view, ")
        return [(found, "dim"), *([(problem, "warn")] if problem else [])]

    def _progress(self) -> list[Html]:
        """How far it is, or why a video was refused."""
        task = self._gestures.views.task.last
        if task is None or task.state in ("finished", "cancelled"):
            return []
        if task.state == "failed":
            return [paragraph(task.reason, "bad")]
        doing = "Stopping …" if task.stopping else f"{task.title}: {task.words} …"
        stop = button("Cancel", "view.cancel", do=task.cancel, disabled=task.stopping, kind="danger")
        return [paragraph(doing), progress_bar(task.share or 0.0), row(stop)]
