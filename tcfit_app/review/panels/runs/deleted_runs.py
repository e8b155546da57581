"""Runs that can be brought back, until they are removed for good."""

from typing import Any

from tcfit_app.project.storage.runs import Run
from tcfit_app.review.panels.elements.html import Board, button, paragraph, row
from tcfit_app.review.panels.runs.run_texts import option
from tcfit_app.review.tab.tab import Tab

_BUTTONS = row(button("Restore", "deleted.restore"), button("Remove all for good …", "deleted.ask", kind="danger"))


class DeletedRuns:
    """A part of a panel, there only while there are such runs."""

    def __init__(self, tab: Tab) -> None:
        self._tab, gui = tab, tab.client.gui
        self._runs: tuple[Run, ...] = ()
        self._window: Any = None
        """The window that asks, if it was ever open."""
        self._question: Board | None = None
        """What it shows."""
        self._folder = gui.add_folder("Deleted runs", expand_by_default=False, visible=False)
        with self._folder:
            self._choice: Any = gui.add_dropdown("Deleted", ("",))
            self._buttons = Board(tab)
        tab.buttons.on("deleted.restore", lambda _: self._restore())
        tab.buttons.on("deleted.ask", lambda _: self._ask())
        tab.buttons.on("deleted.remove", lambda _: self._remove())
        tab.buttons.on("deleted.keep", lambda _: self._close())

    def _restore(self) -> None:
        run = next((run for run in self._runs if option(run) == self._choice.value), None)
        if run is not None:
            self._tab.session.restore(run.id)
            self._tab.say(f"Restored: {run.name}")

    def _ask(self) -> None:
        """Remove them if the user confirms it in a window."""
        what = f"{len(self._runs)} deleted run{'s' if len(self._runs) != 1 else ''}"
        self._close()
        self._window = self._tab.client.gui.add_modal(f"Remove {what} for good?")
        with self._window:
            self._question = Board(self._tab)
        self._question.show(
            *(paragraph(run.name) for run in self._runs),
            paragraph("Their results cannot be brought back.", "warn"),
            row(button(f"Remove {what}", "deleted.remove", kind="danger")),
            button("Keep them", "deleted.keep", kind="close"),
        )

    def _remove(self) -> None:
        self._close()
        gone = self._tab.session.purge()
        self._tab.say(f"Removed: {gone} run{'s' if gone != 1 else ''}")

    def _close(self) -> None:
        if self._question is not None and not self._window.closed:
            self._question.show()
            self._window.close()

    def draw(self) -> None:
        """Send what changed."""
        session = self._tab.session
        if not self._tab.sent.differs("deleted runs", session.fits.changes):
            return
        self._runs = tuple(session.project.runs.all(deleted=True))
        if self._folder.visible != bool(self._runs):
            self._folder.visible = bool(self._runs)
        self._buttons.show(*([_BUTTONS] if self._runs else []))
        options = tuple(option(run) for run in reversed(self._runs)) or ("",)
        if options != self._choice.options:
            self._choice.options = options
