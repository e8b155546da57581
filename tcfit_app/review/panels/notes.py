"""The notes on frames, a part of the Review panel."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import viser

from tcfit_app.imports.elan import ElanNotes, notes_of
from tcfit_app.imports.uploads import kept_as
from tcfit_app.project.edits.remarks import NOTE_CHARACTERS, Note, WriteNotes
from tcfit_app.project.frame_words import in_words, numbers
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.noting import FIELD, FOLD
from tcfit_app.review.panels.elements.field import for_writers
from tcfit_app.review.panels.elements.file_input import FileInput, TextRow
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import Board, Html, button, joined, line, paragraph, row, table, text

_MOST = 30
"""Number of notes listed."""
_ELAN = "Annotations of an .eaf file become notes on their frames. Duplicates are skipped."


class Notes:
    """A field for a note, the list of notes, and their import from ELAN."""

    def __init__(self, gestures: Gestures) -> None:
        self._tab, self._noting = gestures.tab, gestures.noting
        tab, gui = gestures.tab, gestures.tab.client.gui
        hint = f"About the selected frames, or the one on show. {NOTE_CHARACTERS:,} characters at most"
        self._fold = Fold(tab, FOLD)
        with self._fold:
            self._field = gui.add_text(FIELD, "", hint=hint)
            for_writers(tab, self._field)
            self._board = Board(tab)
            self._elan_fold = Fold(tab, "elan")
            with self._elan_fold:
                Board(tab).show(paragraph(_ELAN, "dim"))
                self._elan = FileInput(
                    tab,
                    "notes.elan",
                    self._read_elan,
                    path=None,
                    upload=TextRow("Upload an .eaf file", "From this browser's computer, about this project's video"),
                    more=[TextRow("Tiers", "Tier names separated by commas; empty: all except those written by tcfit")],
                )

    def _read_elan(self, file: Path | viser.UploadedFile) -> None:
        assert isinstance(file, viser.UploadedFile)
        project = self._tab.session.project
        tiers = tuple(name for part in self._elan["Tiers"].split(",") if (name := part.strip()))

        def read(report: object) -> tuple[WriteNotes | None, ElanNotes]:
            with kept_as("upload.eaf", file.content, name_of_file(file.name)) as path:
                return notes_of(path, project, tiers)

        self._elan.read("Notes from ELAN", read, self._keep_elan)

    def _keep_elan(self, found: tuple[WriteNotes | None, ElanNotes]) -> None:
        notes, counts = found
        if notes is not None:
            self._tab.session.project.append(notes, author=self._tab.author)
        self._tab.say(f"Imported: {counts.in_words()}")

    def _write(self) -> None:
        self._noting.write(self._field.value)
        self._field.value = ""

    def _change(self, note: Note | None) -> None:
        self._noting.changing = note
        self._field.value = "" if note is None else note.text
        if note is not None:
            self._noting.go(note)
            self._noting.begin()

    def draw(self) -> None:
        """Bring it to the tab's state."""
        tab, changing, notes = self._tab, self._noting.changing, self._tab.session.project.notes
        if not self._fold.draw(f"Notes ({len(notes)})" if notes else "Notes"):
            return
        self._elan_fold.draw("Notes from ELAN")
        self._elan.draw()
        where = "" if tab.state.playing else in_words(tab.chosen_frames, tab.first_frame)
        off = tab.session.project.read_only
        label = "Save the note" if changing else f"Add a note, {where}" if where else "Add a note"
        buttons = [button(label, "notes.write", do=self._write, disabled=off, enter=True)]
        if changing is not None:
            buttons.append(button("Discard changes", "notes.leave", do=partial(self._change, None)))
        self._board.show(
            row(*buttons),
            *([table(self._line(note, off=off) for note in notes[:_MOST])] if notes else []),
            *([paragraph(f"and {len(notes) - _MOST} more, in the timeline", "dim")] if len(notes) > _MOST else []),
        )

    def _line(self, note: Note, *, off: bool) -> Html:
        def mini(label: str, command: str, do: Callable[[Note], object], *, disabled: bool = off) -> Html:
            return button(label, command, str(note.id), do=lambda: do(note), kind="mini", disabled=disabled)

        return line(
            mini(numbers(note.frames, self._tab.first_frame), "notes.go", self._noting.go, disabled=False),
            note.text,
            joined(
                mini("Change", "notes.change", self._change),
                text(" "),
                mini("Delete", "notes.delete", self._noting.delete),
            ),
            numbers=(2,),
            hint=f"{note.time.astimezone():%d %b %Y, %H:%M}",
        )
