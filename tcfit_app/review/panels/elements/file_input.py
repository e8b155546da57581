"""The one way to name a file in a panel: by its path on the computer that runs tcfit, or by an upload."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import viser

from fitting_core.errors import InputError
from tcfit_app.review.panels.elements.field import for_writers
from tcfit_app.review.panels.elements.html import Board, Html, button, row
from tcfit_app.review.session.tasks import Work
from tcfit_app.review.tab.tab import OneTask, Tab
from tcfit_app.server.viser_bridge import put_back

Value = TypeVar("Value")


@dataclass(frozen=True)
class TextRow:
    """A text field, or with options a dropdown."""

    label: str
    hint: str
    options: tuple[str, ...] = ()


class FileInput:
    """Fields, a button and an upload, and the task that reads the file.

    Args:
        tab: the panel's tab.
        command: of the button; must be unique.
        take: receives the path or the upload, on the drawing thread.
        path: the field for the path; None: files are only uploaded.
        button: the button's label.
        missing: what to do, said if the path is empty.
        upload: the label and the hint of the upload; None: files are only named.
        more: further fields, for how to read the file.
        hint: the button's.
    """

    def __init__(
        self,
        tab: Tab,
        command: str,
        take: Callable[[Path | viser.UploadedFile], object],
        *,
        path: TextRow | None,
        button: str = "",
        missing: str = "",
        upload: TextRow | None = None,
        more: Sequence[TextRow] = (),
        hint: str = "",
    ) -> None:
        self._tab, self._command, self._take, self._missing = tab, command, take, missing
        self._label, self._hint, self._path, self._reading, gui = button, hint, path, OneTask(tab), tab.client.gui
        self._fields: dict[str, Any] = {
            one.label: gui.add_dropdown(one.label, one.options, hint=one.hint)
            if one.options
            else gui.add_text(one.label, "", hint=one.hint)
            for one in (*([path] if path else []), *more)
        }
        for_writers(tab, *self._fields.values())
        self._board = Board(tab)
        self._upload = None if upload is None else self._add_upload(upload)

    def _add_upload(self, text: TextRow) -> viser.GuiUploadButtonHandle:
        handle = self._tab.client.gui.add_upload_button(text.label, hint=text.hint, icon=viser.Icon.UPLOAD)

        async def uploaded(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            file = event.target.value  # now: another upload may take its place
            put_back(handle, viser.UploadedFile(name="", content=b""))  # viser would keep it
            self._tab.do(lambda: self._begin(file))

        handle.on_upload(uploaded)
        return handle

    def __getitem__(self, label: str) -> str:
        """What a field holds, without spaces around it."""
        return self._fields[label].value.strip()

    def _named(self) -> None:
        assert self._path is not None
        if not self[self._path.label]:
            raise InputError(self._missing)
        self._begin(self._tab.files.path(self[self._path.label]))

    def _begin(self, file: Path | viser.UploadedFile) -> None:
        self._tab.refuse_read_only()
        self._reading.refuse()
        self._take(file)

    def read(self, title: str, work: Work[Value], then: Callable[[Value], None], *, writes: bool = False) -> None:
        """Read the file in a task; arguments as in `Tab.begin`."""
        self._reading.begin(title, work, then, writes=writes)

    @property
    def busy(self) -> bool:
        """Whether a file is being read."""
        return self._reading.busy

    def draw(self, *others: Html, on: bool = True) -> None:
        """Update it.

        Args:
            others: Buttons beside its own.
            on: Whether it is shown.
        """
        off = self.busy or self._tab.session.project.read_only
        for handle in self._fields.values():
            handle.visible = on
        if self._path is not None:
            label = "Reading …" if self.busy else self._label
            own = button(label, self._command, do=self._named, disabled=off, hint=self._hint, enter=True)
            self._board.show(*([row(own, *others)] if on else []))
        if self._upload is not None:
            self._upload.disabled, self._upload.visible = off, on
