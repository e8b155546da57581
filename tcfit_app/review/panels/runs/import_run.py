"""Imports another program's result into the project, from a path on tcfit's computer or an upload."""

from collections.abc import Callable
from typing import Any

import viser

from fitting_core.body.files.forms import KINDS
from fitting_core.errors import InputError
from tcfit_app.imports.results import ImportChoices
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.panels.elements.field import for_writers, frame_number, upload_button
from tcfit_app.review.panels.elements.html import Board, button, paragraph, row
from tcfit_app.review.session.tasks import Task, Work
from tcfit_app.review.tab.tab import Tab

_OWN = "the result's body"
_SAID = (
    "SMPLify-X's output folder, an npz of SMPL-X or AMASS, a fit.npz, or a result of GVHMR, GEM, WHAM, PromptHMR, "
    "4D-Humans or SAM 3D Body, as a run to compare. It must match this clip's frames."
)


class ImportRun:
    """A part of a panel.

    Args:
        tab: the panel's tab.
        imported: receives the new run.
    """

    def __init__(self, tab: Tab, imported: Callable[[Run], None]) -> None:
        self._tab, self._imported = tab, imported
        self._reading: Task[Run] | None = None
        """The import started last."""
        gui = tab.client.gui
        with gui.add_folder("Import a result", expand_by_default=False):
            Board(tab).show(paragraph(_SAID, "dim"))
            hint = "Folder or file on the computer where tcfit runs"
            self._path = gui.add_text("Path", "", hint=hint)
            hint = "Video frame number of the result's first frame; empty: as its files are named"
            self._first = gui.add_text("First frame", "", hint=hint)
            hint = "Another body keeps the joint angles but drops the shape"
            self._body: Any = gui.add_dropdown("Posed on", (_OWN, *KINDS), hint=hint)
            for_writers(tab, self._path, self._first, self._body)
            self._buttons = Board(tab)
            hint = "An npz, a zip of SMPLify-X's results, or a learned system's file, from this browser's computer"
            self._upload = upload_button(tab, "Upload a file", self._import_upload, hint=hint)
        tab.buttons.on("import.path", lambda _: self._import_path())

    def _choices(self) -> ImportChoices:
        body = None if self._body.value == _OWN else self._body.value
        return ImportChoices(first_frame=frame_number("First frame", self._first.value), body_model=body)

    def _import_path(self) -> None:
        if not self._path.value.strip():
            raise InputError(
                "Type the path of a result first; expected a folder or a file of one of the programs above."
            )
        self._tab.refuse_read_only()
        path, choices, session = self._tab.files.path(self._path.value), self._choices(), self._tab.session
        self._begin(lambda report: session.import_run(path, choices, report))

    def _import_upload(self, file: viser.UploadedFile) -> None:
        self._tab.refuse_read_only()
        choices, session = self._choices(), self._tab.session
        self._begin(lambda report: session.import_upload(file.name, file.content, choices, report))

    def _begin(self, work: Work[Run]) -> None:
        if self._busy:
            raise InputError("Another result is still being read: wait for it.")
        self._reading = self._tab.begin("Importing a result", work, self._done)

    @property
    def _busy(self) -> bool:
        return self._reading is not None and self._reading.state == "running"

    def _done(self, run: Run) -> None:
        self._imported(run)
        self._tab.say(f"Imported: {run.name}; show it as A or B")

    def draw(self) -> None:
        """Send what changed."""
        off, busy = self._tab.session.project.read_only, self._busy
        self._buttons.show(
            row(button("Importing …" if busy else "Import", "import.path", disabled=off or busy, kind="main"))
        )
        self._upload.disabled = off or busy
