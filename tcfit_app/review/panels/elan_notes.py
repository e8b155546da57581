"""Notes from ELAN: an .eaf file from the browser, whose annotations become notes on their frames."""

import viser

from fitting_core.errors import InputError
from tcfit_app.imports.elan import ElanNotes
from tcfit_app.project.edits.edit_log import WriteNotes
from tcfit_app.review.panels.elements.field import for_writers, upload_button
from tcfit_app.review.panels.elements.html import Board, paragraph
from tcfit_app.review.session.tasks import Task
from tcfit_app.review.tab.tab import Tab

_SAID = "Annotations of an .eaf file become notes on their frames. Duplicates are skipped."
_Found = tuple[WriteNotes | None, ElanNotes]


class ElanImport:
    """A part of a panel."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._reading: Task[_Found] | None = None
        """The import started last."""
        gui = tab.client.gui
        with gui.add_folder("Notes from ELAN", expand_by_default=False):
            Board(tab).show(paragraph(_SAID, "dim"))
            hint = "Tier names separated by commas; empty: all except those written by tcfit"
            self._tiers = gui.add_text("Tiers", "", hint=hint)
            for_writers(tab, self._tiers)
            hint = "An .eaf file from this browser's computer, about this project's video"
            self._upload = upload_button(tab, "Upload an .eaf file", self._begin, hint=hint)

    def _begin(self, file: viser.UploadedFile) -> None:
        tab, session = self._tab, self._tab.session
        tab.refuse_read_only()
        if self._reading is not None and self._reading.state == "running":
            raise InputError("Another file is still being read: wait for it.")
        tiers = tuple(name for part in self._tiers.value.split(",") if (name := part.strip()))
        name, content = file.name, file.content
        self._reading = tab.begin("Notes from ELAN", lambda report: session.read_elan(name, content, tiers), self._keep)

    def _keep(self, found: _Found) -> None:
        notes, counts = found
        if notes is not None:
            self._tab.session.keep_notes(notes, author=self._tab.author)
        self._tab.say(f"Imported: {counts.in_words()}")

    def draw(self) -> None:
        """Send what changed."""
        self._upload.disabled = self._tab.session.project.read_only
