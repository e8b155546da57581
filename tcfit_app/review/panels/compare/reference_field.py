"""Where a user says what fits are compared with: a part of the panel Compare."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import viser

from fitting_core.errors import InputError
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.references.reference import Reference
from tcfit_app.fitting.notices import Notice
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.review.panels.elements.html import Board, Html, button, paragraph, row
from tcfit_app.review.tab.tab import Tab
from tcfit_app.review.tasks import Step, Task

_HINT = "npz of 3D points, TRC, AMASS-style npz, truth.npz or fit.npz, on the computer where tcfit runs"
_CAMERA_HINT = "npz with R and t of the clip's camera in the reference's world; empty: only form is compared"
_FIRST_HINT = "Number in the video of the reference's first frame; empty: as it says, or 0"
_NONE = "Without a reference fits can only be compared with each other."
_READING = "The reference is being read …"


class ReferenceField:
    """Shows the project's reference, and takes another one: from a path, or as a file from the browser."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._reading: Task[Reference] | None = None
        """The reference that was asked for last."""
        gui = tab.client.gui
        with gui.add_folder("Reference", expand_by_default=False):
            self._told = Board(tab)
            self._path = gui.add_text("File", "", hint=_HINT)
            self._camera = gui.add_text("Camera", "", hint=_CAMERA_HINT)
            self._first = gui.add_text("Begins at frame", "", hint=_FIRST_HINT)
            self._buttons = Board(tab)
            self._upload = gui.add_upload_button("Upload a reference", hint="The same, from this computer")
        self._upload.on_upload(self._upload_came)
        tab.buttons.on("compare.reference", lambda _: self._from_path())
        tab.buttons.on("compare.forget", lambda _: self._forget())

    def draw(self) -> None:
        """Bring it to the project's state."""
        session = self._tab.session
        reading = self._reading is not None and self._reading.state == "running"
        if self._tab.sent.differs("reference field", session.referenced, reading):
            reference = session.project.reference
            self._told.show(paragraph(_READING if reading else _described(reference), "dim"))
            self._buttons.show(row(*self._choices(reference, off=reading or session.project.read_only)))

    def _choices(self, reference: Reference | None, *, off: bool) -> list[Html]:
        take = button("Compare with it", "compare.reference", disabled=off)
        forget = button("Forget the reference", "compare.forget", disabled=off)
        return [take] if reference is None else [take, forget]

    def _from_path(self) -> None:
        if not self._path.value.strip():
            raise InputError("Type where the reference is: a file, or a folder with a truth.npz or fit.npz.")
        path = self._tab.files.path(self._path.value)
        camera, placed = self._camera_given(), self._start_given()
        self._read(lambda: placed(read_reference(path, camera=camera)))

    async def _upload_came(self, event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
        file = event.target.value  # now: another upload may take its place
        self._tab.do(lambda: self._uploaded(file))

    def _uploaded(self, file: viser.UploadedFile) -> None:
        shown, camera, placed = name_of_file(file.name), self._camera_given(), self._start_given()

        def read() -> Reference:
            with tempfile.TemporaryDirectory(prefix="tcfit-") as folder:
                # Its name never becomes part of a path; of it only the form counts that its end tells.
                path = Path(folder) / ("upload.trc" if shown.lower().endswith(".trc") else "upload.npz")
                path.write_bytes(file.content)
                try:
                    return replace(placed(read_reference(path, camera=camera)), name=shown)
                except InputError as error:
                    raise InputError(str(error).replace(str(path), shown).replace(path.name, shown)) from error

        self._read(read)

    def _camera_given(self) -> Path | None:
        self._tab.refuse_read_only()
        return self._tab.files.path(self._camera.value) if self._camera.value.strip() else None

    def _start_given(self) -> Callable[[Reference], Reference]:
        """What puts a reference where the user says that it begins."""
        first, rate = self._first.value.strip(), self._tab.session.project.clip.frame_rate
        if first and not (first.isdecimal() and len(first) < 12):
            raise InputError(f"Begins at frame is {first[:20]!r}; expected a whole number, or nothing.")
        return lambda found: found.starting_at(int(first), rate) if first else found

    def _read(self, read: Callable[[], Reference]) -> None:
        """Read it: a body's joints over a clip take seconds."""
        session = self._tab.session

        def work(report: Step) -> Reference:
            reference = read()
            session.bodies.of_reference(reference)
            report("Keeping it", None)
            session.project.set_reference(reference)
            return reference

        self._reading = self._tab.begin("Reading the reference", work, self._take)

    def _take(self, reference: Reference) -> None:
        self._tab.session.referenced += 1
        self._tab.notify(Notice(title="Fits are compared with it", text=_described(reference), kind="done"))

    def _forget(self) -> None:
        self._tab.refuse_read_only()
        self._tab.session.set_reference(None)


def _described(reference: Reference | None) -> str:
    if reference is None:
        return _NONE
    placed = "in the camera's space" if reference.in_camera else "in a world of its own: only form is compared"
    return "\n".join([f"{reference.name}: {reference.kind}, {len(reference)} frames, {placed}", *reference.notes])
