"""Where the user says what the clip was filmed with: a calibration file, and which of its cameras."""

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import viser

from fitting_core.camera import Camera
from fitting_core.config.choices import Up
from fitting_core.errors import InputError
from fitting_core.io.cameras.reading import CameraFile
from tcfit_app.fitting.reports import Notice
from tcfit_app.imports.results import kept_as
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.review.panels.elements.field import Number, for_writers, upload_button
from tcfit_app.review.panels.elements.html import Board, button, paragraph, row
from tcfit_app.review.session.tasks import Step, Task
from tcfit_app.review.tab.tab import Tab

_AS_FILE = "as the file has it"
_UNIT = Number(label="Unit", low=1e-6, high=1e6, of="metres")
_FORMS = "npz, TOML of Pose2Sim or caliscope, OpenCV's YAML, XML or JSON"
_HINT = "For the whole project: new fits use it, existing ones keep theirs"
_SUFFIXES = (".npz", ".toml", ".yaml", ".yml", ".xml", ".json")


class CameraInput:
    """A part of a panel: the project's camera, and a calibration to replace it.

    Args:
        tab: the panel's tab.
        command: of its button; must be unique.
    """

    def __init__(self, tab: Tab, command: str) -> None:
        self._tab, self._command, gui = tab, command, tab.client.gui
        self._reading: Task[Camera] | None = None
        """The file requested last."""
        self._known = Board(tab)
        hint = f"On the computer that runs tcfit: {_FORMS}, or a folder with COLMAP's cameras.txt and images.txt"
        self._path = gui.add_text("Camera file", "", hint=hint)
        self._name = gui.add_text("Camera name", "", hint="Which camera of the file; empty: the only one")
        hint = f"Metres per unit of the file's world: 0.001 for millimetres; empty: 1. {_UNIT.range.capitalize()}."
        self._unit = gui.add_text(_UNIT.label, "", hint=hint)
        hint = "The axis that points up in the file's world"
        self._up: Any = gui.add_dropdown("Up", (_AS_FILE, *get_args(Up)), hint=hint)
        for_writers(tab, self._path, self._name, self._unit, self._up)
        self._buttons = Board(tab)
        hint = f"From this browser's computer: {_FORMS}"
        self._upload = upload_button(tab, "Upload a camera file", self._take_upload, hint=hint)
        tab.buttons.on(command, lambda _: self._take_path())

    def _file(self, path: Path) -> CameraFile:
        unit = self._unit.value.strip()
        return CameraFile(
            path=path,
            name=self._name.value.strip() or None,
            unit=_UNIT.read(unit) if unit else None,
            up=None if self._up.value == _AS_FILE else self._up.value,
        )

    def _take_path(self) -> None:
        if not self._path.value.strip():
            raise InputError(f"Type where the camera file is; expected {_FORMS}, or a folder of COLMAP.")
        self._read(self._file(self._tab.files.path(self._path.value)))

    def _take_upload(self, sent: viser.UploadedFile) -> None:
        shown = name_of_file(sent.name)
        if (suffix := Path(shown).suffix.lower()) not in _SUFFIXES:
            raise InputError(f"{shown}: not a camera file, judging by its name; expected {_FORMS}.")
        self._read(self._file(Path(f"camera{suffix}")), sent.content, shown)

    def _read(self, file: CameraFile, content: bytes | None = None, shown: str = "") -> None:
        """Off the drawing thread: keypoints of a long clip are undistorted and written."""
        tab = self._tab
        tab.refuse_read_only()
        if self._busy:
            raise InputError("Another camera file is still being read: wait for it.")

        def work(report: Step) -> Camera:
            if content is None:
                return tab.session.set_camera(file)
            with kept_as(file.path.name, content, shown) as path:
                return tab.session.set_camera(replace(file, path=path), sent_as=shown)

        self._reading = tab.begin("Reading the camera file", work, self._taken, writes=True)

    @property
    def _busy(self) -> bool:
        return self._reading is not None and self._reading.state == "running"

    def _taken(self, camera: Camera) -> None:
        self._tab.session.tell(Notice(title="Camera replaced", text=camera.source, kind="done"))

    def draw(self) -> None:
        """Send what changed."""
        project = self._tab.session.project
        camera, off = project.footage.camera, project.read_only or self._busy
        self._known.show(paragraph(described(camera), "dim"))
        label = "Reading …" if self._busy else "Use this camera"
        self._buttons.show(row(button(label, self._command, disabled=off, hint=_HINT)))
        self._upload.disabled = off


def described(camera: Camera) -> str:
    """The project's camera in words: its source, its lens, its position."""
    focal = f"The project's camera: {camera.focal[0]:.1f} px, {camera.source}"
    lens = "lens distortion unknown" if camera.lens is None else "lens distortion is corrected"
    if camera.world is None:
        return f"{focal}; {lens}."
    up = "up direction unknown" if camera.world.up is None else f"{camera.world.up} is up"
    place = ", ".join(f"{at:.2f}" for at in camera.world.place)
    return f"{focal}; {lens}; position ({place}) m, {up}."
