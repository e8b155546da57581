"""The notes on frames, a part of the Review panel."""

from tcfit_app.project.edits.edit_log import NOTE_CHARACTERS, Note
from tcfit_app.project.frame_words import in_words, numbers
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.noting import FIELD
from tcfit_app.review.panels.elan_notes import ElanImport
from tcfit_app.review.panels.elements.field import for_writers
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    action,
    button,
    heading,
    joined,
    line,
    paragraph,
    row,
    table,
)
from tcfit_app.review.panels.elements.html import text as plain

_MOST = 30
"""Number of notes listed."""


class Notes:
    """A field for a note, and the list of notes. Called repeatedly, it sends only changes."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab, self._noting = gestures, gestures.tab, gestures.noting
        self._head = Board(self._tab)
        hint = f"About the selected frames, or the one on show. {NOTE_CHARACTERS:,} characters at most"
        self._field = self._tab.client.gui.add_text(FIELD, "", hint=hint)
        for_writers(self._tab, self._field)
        self._board = Board(self._tab)
        self._elan = ElanImport(self._tab)
        on = self._tab.buttons.on
        on("notes.write", lambda _: self._write())
        on("notes.leave", lambda _: self._change(None))
        on("notes.go", self._noting.go, self._note)
        on("notes.change", self._change, self._note)
        on("notes.delete", self._noting.delete, self._note)

    def _note(self, number: str) -> Note:
        found = [note for note in self._tab.session.project.notes if note.id == int(number)]
        if not found:
            raise ValueError(number)
        return found[0]

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
        self._elan.draw()
        tab, changing = self._tab, self._noting.changing
        where = "" if tab.state.playing else in_words(tab.chosen_frames, tab.first_frame)
        off, notes = tab.session.project.read_only, tab.session.project.notes
        self._head.show(heading("Notes", f"{len(notes)}" if notes else ""))
        if changing is None:
            buttons = row(
                button(f"Add a note, {where}" if where else "Add a note", "notes.write", disabled=off, enter=True)
            )
        else:
            save = button("Save the note", "notes.write", disabled=off, enter=True)
            buttons = row(save, button("Discard changes", "notes.leave"))
        self._board.show(
            buttons,
            *([table(self._line(note, off=off) for note in notes[:_MOST])] if notes else []),
            *([paragraph(f"and {len(notes) - _MOST} more, in the timeline", "dim")] if len(notes) > _MOST else []),
            row(action(self._gestures, "copy_link")),
        )

    def _line(self, note: Note, *, off: bool) -> Html:
        first, value = self._tab.first_frame, str(note.id)
        return line(
            button(numbers(note.frames, first), "notes.go", value, kind="mini", hint="Go there"),
            note.text,
            joined(
                button("Change", "notes.change", value, kind="mini", disabled=off),
                plain(" "),
                button("Delete", "notes.delete", value, kind="mini", disabled=off),
            ),
            numbers=(2,),
            hint=f"{note.time.astimezone():%d %b %Y, %H:%M}",
        )
