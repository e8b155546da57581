"""The panel of a project without keypoints: import or detect them."""

from typing import TYPE_CHECKING, ClassVar

import viser

from fitting_core.errors import InputError
from tcfit_app.imports.keypoint_jobs import Download, ImportFiles, ImportUpload
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.camera_input import CameraInput
from tcfit_app.review.panels.elements.field import Dropdown, take_uploads
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    action,
    button,
    facts,
    heading,
    paragraph,
    progress_bar,
    row,
    words,
)
from tcfit_app.review.session.keypoint_source import Going
from tcfit_app.review.tab.tab import Tab

if TYPE_CHECKING:
    from fitting_core.detect.known_models import KnownModel

_FILE = "An ONNX file of yours"
_NONE = "None: follow from frame to frame"
_TO_FETCH = "download"
_RECOMMENDED = "dwpose-l"
"""What is offered where no whole-body model has been downloaded."""
_IMPORT = row(button("Import from this path", "start.import", kind="main", enter=True))


class StartPanel:
    """See `Panel`. Shown by pages that open on a project without keypoints."""

    title: ClassVar[str] = "Start"
    icon: ClassVar[viser.IconName] = viser.Icon.USER_PLUS

    def __init__(self, gestures: Gestures) -> None:
        self._tab = gestures.tab
        tab, gui = gestures.tab, gestures.tab.client.gui
        self._intro = Board(tab)
        self._folder = gui.add_folder("Import keypoints")
        with self._folder:
            self._add_import()
        self._camera_folder = gui.add_folder("How it was filmed", expand_by_default=False)
        with self._camera_folder:
            self._camera = CameraInput(tab, "start.camera")
        self._detection = gui.add_folder("Detect keypoints")
        with self._detection:
            self._pose, self._pose_file = self._add_model("points", "Model", "Finds 133 points of the whole body")
            self._boxes, self._boxes_file = self._add_model("boxes", "People", "Finds people before the model does")
            self._choice = Board(tab)
        self._said = Board(tab)
        tab.buttons.on("start.import", lambda _: self._import_path())
        tab.buttons.on("start.detect", lambda _: self._detect())
        tab.buttons.on("start.download", lambda name: tab.session.source.begin(Download(name=name)), _known_model)
        tab.buttons.on("start.cancel", lambda _: tab.session.source.cancel())

    def _add_import(self) -> None:
        tab, gui = self._tab, self._tab.client.gui
        hint = "On the computer that runs tcfit: a folder of OpenPose JSON, a COCO-WholeBody JSON, or a .pose file"
        self._path = gui.add_text("Path", "", hint=hint)
        self._import = Board(tab)
        hint = "From this computer: one JSON or .pose file, or a ZIP archive of a folder of JSON files"
        upload = gui.add_upload_button("Upload a file or ZIP", hint=hint, icon=viser.Icon.UPLOAD, color="dark")
        take_uploads(tab, upload, self._import_upload)

    def _import_upload(self, file: viser.UploadedFile) -> None:
        self._tab.session.source.begin(ImportUpload(name=file.name, content=file.content))

    def _import_path(self) -> None:
        if not self._path.value.strip():
            raise InputError(
                "No path is given; expected a folder or file of keypoints on the computer that runs tcfit."
            )
        self._tab.session.source.begin(ImportFiles(path=self._tab.files.path(self._path.value)))

    def _add_model(self, finds: str, label: str, hint: str) -> tuple["_ModelChoice", viser.GuiInputHandle[str]]:
        gui = self._tab.client.gui
        choice = _ModelChoice(self._tab, finds, label, hint)
        file = gui.add_text(f"{label} file", "", hint="Path on the computer that runs tcfit")
        return choice, file

    def _detect(self) -> None:
        pose, boxes = self._pose.given(self._pose_file.value), self._boxes.given(self._boxes_file.value)
        self._tab.session.source.detect(pose, boxes)

    def draw(self) -> None:
        """See `Panel.draw`."""
        tab, session = self._tab, self._tab.session
        self._camera.draw()
        going, done = session.source.going, session.project.has_detections
        if tab.sent.differs("start", going, session.source.busy, done, self._pose.chosen, self._boxes.chosen):
            self._draw_choices(done)
        said = (
            None if going is None else (going, going.state, going.stopping, going.text, round(200 * (going.share or 0)))
        )
        if tab.sent.differs("start going", said, done):
            self._said.show(*([] if going is None or done else _said(going)))

    def _draw_choices(self, done: bool) -> None:
        tab = self._tab
        self._intro.show(*(_finished(tab) if done else _introduction(tab)))
        open_for_it = not (done or tab.session.project.read_only or tab.session.source.busy)
        for folder in (self._folder, self._camera_folder, self._detection):
            folder.visible = open_for_it
        self._import.show(*([_IMPORT] if open_for_it else []))
        for choice, file in ((self._pose, self._pose_file), (self._boxes, self._boxes_file)):
            choice.offer()
            file.visible = choice.chosen == _FILE
        missing = next((known for choice in (self._pose, self._boxes) if (known := choice.to_fetch())), None)
        offered = _fetchable(missing) if missing else _detectable()
        self._choice.show(*(offered if open_for_it else []))


class _ModelChoice:
    """A dropdown of models: none, those that are known, and a file."""

    def __init__(self, tab: Tab, finds: str, label: str, hint: str) -> None:
        self._tab, self._finds = tab, finds
        self._none = (_NONE,) if finds == "boxes" else ()
        self.chosen = self._none[0] if self._none else _FILE
        known = {model.name: title for title, model in self._options().items() if model is not None}
        here = [title for title in known.values() if not title.endswith(f"({_TO_FETCH})")]
        if here:
            self.chosen = here[0]
        elif finds == "points":
            self.chosen = known[_RECOMMENDED]
        handle = tab.client.gui.add_dropdown(label, tuple(self._options()), initial_value=self.chosen, hint=hint)
        self._dropdown = Dropdown(tab, handle, self._choose)

    def _choose(self, title: str) -> None:
        self.chosen = title

    def _options(self) -> "dict[str, KnownModel | None]":
        from fitting_core.detect.known_models import KNOWN_MODELS, installed

        here = {known.name for known in installed(self._finds)}
        models = [known for known in KNOWN_MODELS.values() if known.finds == self._finds]
        titles = {known.title if known.name in here else f"{known.title} ({_TO_FETCH})": known for known in models}
        return {**dict.fromkeys(self._none), **titles, _FILE: None}

    def offer(self) -> None:
        """Bring the dropdown to the models that are here now."""
        options = self._options()
        if self.chosen not in options:  # it has been downloaded
            self.chosen = self.chosen.removesuffix(f" ({_TO_FETCH})")
        self._dropdown.offer(tuple(options), self.chosen)

    def to_fetch(self) -> "KnownModel | None":
        """The known model that is chosen, if it is not on this computer."""
        return self._options().get(self.chosen) if self.chosen.endswith(f"({_TO_FETCH})") else None

    def given(self, file: str) -> str:
        """What is chosen, as `KeypointSource.detect` takes it."""
        if self.chosen == _FILE:
            return str(self._tab.files.path(file)) if file.strip() else ""
        known = self._options().get(self.chosen)
        return known.name if known is not None else ""


def _known_model(name: str) -> str:
    from fitting_core.detect.known_models import KNOWN_MODELS

    return KNOWN_MODELS[name].name


def _introduction(tab: Tab) -> list[Html]:
    session = tab.session
    if session.project.read_only:
        text = "This project is open read-only: keypoints can be imported or detected where it is open for writing."
    elif session.source.busy:
        text = "The video can be watched meanwhile."
    else:
        text = "This project has a video and nothing to fit. Import keypoints that you have, or detect them here."
    begun = session.source.begun and not session.source.busy
    goes_on = "A detection was started and stopped: with the same models it goes on where it stopped."
    return [
        heading("No keypoints yet", first=True),
        paragraph(text),
        *([paragraph(goes_on, "warn")] if begun else []),
    ]


def _finished(tab: Tab) -> list[Html]:
    project = tab.session.project
    found = int((project.detections.confidence > 0).any(1).sum())
    return [
        heading("Keypoints", first=True),
        paragraph(words(f"Found in {found} of {tab.length} frames.", "good")),
        *(paragraph(note, "dim") for note in project.clip.notes),
        paragraph("Next: fit the body. Keypoints that are wrong can be corrected before or after."),
        row(action("fit", "Fit everything", kind="main")),
    ]


def _detectable() -> list[Html]:
    return [
        row(button("Detect", "start.detect", kind="main")),
        paragraph("One person: with a box model the most prominent, else who fills most of the first frame.", "dim"),
    ]


def _fetchable(model: "KnownModel") -> list[Html]:
    checksum = model.sha256 or "none is known; the first download's is remembered"
    return [
        paragraph(f"{model.title} is not on this computer. It can be fetched from its publisher:"),
        facts([("From", model.url), ("Size", model.size), ("Licence", model.licence), ("SHA-256", checksum)]),
        row(button("Agree and download", "start.download", model.name, kind="main")),
    ]


def _said(going: Going) -> list[Html]:
    """How far a job is, or how it ended."""
    title = heading(going.title)
    if going.state == "failed":
        return [title, paragraph(going.reason, "bad")]
    if going.state == "cancelled":
        return [title, paragraph("Cancelled. What has been done stays, and the next start goes on there.")]
    if going.state == "finished":
        return [title, paragraph("Done.", "good")]
    doing = "Is being stopped …" if going.stopping else f"{going.text} …"
    return [
        title,
        paragraph(doing),
        progress_bar(going.share or 0.0),
        row(button("Cancel", "start.cancel", disabled=going.stopping, kind="danger")),
    ]
