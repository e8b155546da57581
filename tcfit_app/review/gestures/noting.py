"""Notes on frames, and links to them, in one tab."""

from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.edits.remarks import Note, WriteNote
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.browser.page_states import CopyLink
from tcfit_app.review.tab.tab import Tab

PANEL = "Review"
"""The panel where notes are written."""
FIELD = "Note"
"""The label of its field."""
FOLD = "notes"
"""The fold that has them."""


class Noting:
    """Writes, changes and deletes notes; goes to frames of notes and links."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self.changing: Note | None = None
        """The note being edited."""

    def begin(self) -> None:
        """Open the field for a note on the selected frames, or the one on show."""
        self._tab.set(folds=self._tab.state.folds | {FOLD})
        self._tab.show_panel(PANEL, FIELD)

    def write(self, text: str) -> None:
        """Save a new note, or the edited one. Raises InputError as the log does."""
        tab, changed = self._tab, self.changing
        tab.refuse_read_only()
        if not text.strip():
            raise InputError("The note is empty. Type what it says first.")
        frames = tab.frames_to_change if changed is None else changed.frames
        self._save(WriteNote(frames=tuple(frames), text=text.strip(), replaces=changed and changed.id))
        self.changing = None
        tab.say(f"Note {'written' if changed is None else 'changed'}: {in_words(frames, tab.first_frame)}")

    def delete(self, note: Note) -> None:
        """Delete a note; undo restores it. Raises InputError as the log does."""
        tab = self._tab
        tab.refuse_read_only()
        self._save(WriteNote(frames=tuple(note.frames), text="", replaces=note.id))
        tab.say(f"Note deleted: {in_words(note.frames, tab.first_frame)}")

    def _save(self, note: WriteNote) -> None:
        self._tab.session.project.append(note, author=self._tab.author)

    def go(self, note: Note) -> None:
        """Go to the note's first frame, and select its frames if there are several."""
        self._tab.pause()
        self._tab.seek(note.frames[0])
        self._tab.set(frames=note.frames if len(note.frames) > 1 else None)

    # --- links ---

    def copy_link(self) -> None:
        """Have the page copy a link to the frame, fit and person on show."""
        tab, shown = self._tab, self._tab.look().b
        run, phase = (0, 0) if shown is None else (shown.run.id, shown.phase)
        frame, person = tab.state.frame + tab.first_frame, tab.someone.listed or 0
        tab.channel.ask(CopyLink(frame=frame, run=run, phase=phase, person=person))
        tab.say(f"Link to frame {frame} copied. It works in browsers signed in to tcfit")

    def open_link(self, frame: int, run: int | None, phase: int | None) -> None:
        """Follow a link. Raises InputError if there is no such frame or run in this project.

        Args:
            frame: the number shown to users.
            run: of the fit; None: keep the current one.
            phase: of that run; None: its last.
        """
        tab = self._tab
        if not 0 <= frame - tab.first_frame < tab.length:
            last = tab.first_frame + tab.length - 1
            raise InputError(f"The link leads to frame {frame}; this clip has frames {tab.first_frame} to {last}.")
        tab.pause()
        tab.seek(frame - tab.first_frame)
        if run is None:
            return
        if tab.session.fits.run(run) is None:
            raise InputError(f"The link leads to run {run}, which is not in this project or was deleted.")
        tab.set(b=FitChoice(run=run, phase=phase))
