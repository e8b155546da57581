"""Where the user says what the clip was filmed with: a calibration file, and which of its cameras."""

from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

import viser

from fitting_core.camera import Camera
from fitting_core.config.choices import Up
from fitting_core.errors import InputError
from fitting_core.io.cameras.reading import CameraFile
from tcfit_app.fitting.reports import Notice
from tcfit_app.imports.uploads import kept_as
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.review.panels.elements.field import Number
from tcfit_app.review.panels.elements.file_input import FileInput, TextRow
from tcfit_app.review.panels.elements.html import Board, paragraph
from tcfit_app.review.session.tasks import Step
from tcfit_app.review.tab.tab import Tab

_AS_FILE = "as the file has it"
_UNIT = Number(label="Unit", low=1e-6, high=1e6, of="metres")
_FORMS = "npz, TOML of Pose2Sim or caliscope, OpenCV's YAML, XML or JSON"
_SUFFIXES = (".npz", ".toml", ".yaml", ".yml", ".xml", ".json")


class CameraInput:
    """A part of a panel: the project's camera, and a calibration to replace it.

    Args:
        tab: the panel's tab.
        command: of its button; must be unique.
    """

    def __init__(self, tab: Tab, command: str) -> None:
        self._tab, self._known = tab, Board(tab)
        unit = f"Metres per unit of the file's world: 0.001 for millimetres; empty: 1. {_UNIT.range.capitalize()}."
        self._file = FileInput(
            tab,
            command,
            self._take,
            path=TextRow("Camera file", f"On the computer that runs tcfit: {_FORMS}, or a folder of COLMAP"),
            more=(
                TextRow("Camera name", "Which camera of the file; empty: the only one"),
                TextRow(_UNIT.label, unit),
                TextRow("Up", "The axis that points up in the file's world", (_AS_FILE, *get_args(Up))),
            ),
            button="Use this camera",
            missing=f"Type where the camera file is; expected {_FORMS}, or a folder of COLMAP.",
            upload=TextRow("Upload a camera file", f"From this browser's computer: {_FORMS}"),
            hint="For the whole project: new fits use it, existing ones keep theirs",
        )

    def _take(self, file: Path | viser.UploadedFile) -> None:
        session = self._tab.session
        name, unit, up = (self._file[label] for label in ("Camera name", _UNIT.label, "Up"))
        chosen = CameraFile(
            path=Path(),
            name=name or None,
            unit=_UNIT.read(unit) if unit else None,
            up=None if up == _AS_FILE else cast(Up, up),
        )
        shown = "" if isinstance(file, Path) else name_of_file(file.name)
        suffix = Path(shown).suffix.lower()
        if shown and suffix not in _SUFFIXES:
            raise InputError(f"{shown}: not a camera file, judging by its name; expected {_FORMS}.")

        def work(report: Step) -> Camera:  # keypoints of a long clip are undistorted and written
            if isinstance(file, Path):
                return session.set_camera(replace(chosen, path=file))
            with kept_as(f"camera{suffix}", file.content, shown) as path:
                return session.set_camera(replace(chosen, path=path), sent_as=shown)

        self._file.read("Reading the camera file", work, self._tell, writes=True)

    def _tell(self, camera: Camera) -> None:
        self._tab.session.tell(Notice(title="Camera replaced", text=camera.source, kind="done"))

    def draw(self) -> None:
        """Send what changed."""
        self._known.show(paragraph(described(self._tab.session.project.footage.camera), "dim"))
        self._file.draw()


def described(camera: Camera) -> str:
    """The project's camera in words: its source, its lens, its position."""
    focal = f"The project's camera: {camera.focal[0]:.1f} px, {camera.source}"
    lens = "lens distortion unknown" if camera.lens is None else "lens distortion is corrected"
    if camera.world is None:
        return f"{focal}; {lens}{'' if camera.vertical is None else f'; {camera.vertical}'}."
    up = "up direction unknown" if camera.world.up is None else f"{camera.world.up} is up"
    place = ", ".join(f"{at:.2f}" for at in camera.world.place)
    return f"{focal}; {lens}; position ({place}) m, {up}."
