"""The Start panel of a project without keypoints: detect them in the video, or import them."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import viser

from tcfit_app.imports.keypoint_jobs import Download, FetchNetworks, ImportFiles, ImportUpload
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.camera_input import CameraInput
from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.panels.elements.file_input import FileInput, TextRow
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import Board, Html, button, facts, heading, paragraph, progress_bar, row
from tcfit_app.review.session.keypoint_source import Going
from tcfit_app.review.tab.tab import Tab

if TYPE_CHECKING:
    from fitting_core.detect.known_models import KnownModel

_PATH_HINT = "On the computer that runs tcfit: a folder of OpenPose JSON, a COCO-WholeBody JSON, or a .pose file"
_UPLOAD_HINT = "From this computer: one JSON or .pose file"


class StartPanel:
    """See `Panel`. Alone while a project has no keypoints."""

    title: ClassVar[str] = "Start"
    icon: ClassVar[viser.IconName] = viser.Icon.USER_PLUS

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab = gestures.tab
        self._intro = Board(tab)
        self._said = Board(tab)
        self._folds = {title: Fold(tab, f"start.{title}") for title in ("Detector", "Camera", "Import keypoints")}
        with self._folds["Detector"]:
            self._detector = _DetectorChoice(tab)
        with self._folds["Camera"]:
            self._camera = CameraInput(tab, "start.camera")
        with self._folds["Import keypoints"]:
            self._import = FileInput(
                tab,
                "start.import",
                self._begin_import,
                path=TextRow("Path", _PATH_HINT),
                button="Import from this path",
                missing="The path is empty; expected a folder or file of keypoints on the computer that runs tcfit.",
                upload=TextRow("Upload a file", _UPLOAD_HINT),
            )

    def _begin_import(self, file: Path | viser.UploadedFile) -> None:
        job = ImportFiles(path=file) if isinstance(file, Path) else ImportUpload(name=file.name, content=file.content)
        self._tab.session.source.begin(job)

    def _fetch(self) -> None:
        """Fetch what the chosen detector needs."""
        models = self._detector.known_models()
        self._tab.session.source.begin(Download(name=models[0].name) if models else FetchNetworks())

    def draw(self) -> None:
        """See `Panel.draw`."""
        tab, session = self._tab, self._tab.session
        self._camera.draw()
        source = session.source
        tab.once("detector", (source.going, source.busy), self._detector.look)  # a job may have fetched what it needs
        offered = not (session.project.has_detections or session.project.read_only or source.busy)
        self._intro.show(*_introduction(tab), *(self._offered() if offered else []))
        for title, fold in self._folds.items():
            fold.draw(title, on=offered)
        self._import.draw(on=offered)
        self._detector.draw()
        count = 0 if source.people is None else source.people.count
        self._said.show(*([] if source.going is None else _said(source.going, count, source.cancel)))

    def _offered(self) -> list[Html]:
        session, detector = self._tab.session, self._detector
        if not detector.is_here:
            return [
                *_fetchable(detector),
                row(button("Agree and download", "start.fetch", do=self._fetch, kind="main")),
            ]
        fit, find = (lambda: session.find_and_fit(detector.name)), (lambda: session.source.detect(detector.name))
        return [
            row(button("Find keypoints and fit", "start.find", "fit", do=fit, kind="main")),
            row(button("Find keypoints only", "start.find", "keypoints", do=find)),
        ]


class _DetectorChoice:
    """A dropdown of the known detectors."""

    def __init__(self, tab: Tab) -> None:
        from fitting_core.detect.detectors import DEFAULT, DETECTORS

        self._detectors = {known.title: name for name, known in DETECTORS.items()}
        self.name = DEFAULT
        hint = "What finds people, bodies, hands and face in the video"
        default = DETECTORS[DEFAULT].title
        handle = tab.client.gui.add_dropdown("Detector", tuple(self._detectors), initial_value=default, hint=hint)
        Dropdown(tab, handle, self._choose)
        self._details = Board(tab)
        self.is_here = True
        """Whether everything the choice needs was on this computer at the last check."""

    def _choose(self, title: str) -> None:
        self.name = self._detectors[title]
        self.look()

    def look(self) -> None:
        """Check whether the chosen one is here; reads files, so not for every draw."""
        from fitting_core.detect.detectors import DETECTORS

        self.is_here = DETECTORS[self.name].is_here()

    def draw(self) -> None:
        """Show the checksum of what is missing."""
        models = [] if self.is_here else self.known_models()
        sums = [known.sha256 or "unknown; the first download's is remembered" for known in models[:1]]
        self._details.show(*(facts([("SHA-256", checksum)]) for checksum in sums))

    def known_models(self) -> "list[KnownModel]":
        """Models that the choice lacks and that can be downloaded one by one."""
        from fitting_core.detect.detectors import DETECTORS

        return DETECTORS[self.name].lacking()


def _fetchable(detector: _DetectorChoice) -> list[Html]:
    """What must be fetched before the chosen detector can be used."""
    models = detector.known_models()
    if models:
        known = models[0]
        return [
            paragraph(f"{known.title} is not on this computer. Its publisher offers it:"),
            facts([("From", known.url), ("Size", known.size), ("Licence", known.licence)]),
        ]
    from fitting_core.detect.mediapipe.fetching import fetch_notice

    announcement = fetch_notice().splitlines()
    return [
        paragraph("The detector's networks are not on this computer. They are downloaded once:"),
        *(paragraph(line.strip(), "dim") for line in announcement),
    ]


def _introduction(tab: Tab) -> list[Html]:
    session = tab.session
    if session.project.read_only:
        text = "This project is open read-only. Detect or import keypoints where it is open for writing."
    elif session.source.busy:
        text = "You can watch the video meanwhile; keypoints appear as they are found."
    else:
        text = "tcfit finds the person's body, hands and face in the video, and fits the body model to them."
    return [heading("Keypoints" if session.source.busy else "No keypoints yet", first=True), paragraph(text)]


def _said(going: Going, people: int, cancel: Callable[[], object]) -> list[Html]:
    """The progress of a job, or how it ended."""
    title = heading(going.title)
    if going.state == "failed":
        return [title, paragraph(going.reason, "bad")]
    if going.state == "cancelled":
        return [title, paragraph("Cancelled. Keypoints found so far are kept; starting again continues from there.")]
    if going.state == "finished":
        return [title, paragraph("Done.", "good")]
    doing = "Stopping …" if going.stopping else f"{going.words} …"
    several = f"{people} people found. To choose someone other than the one in colour, click on them in the picture."
    return [
        title,
        paragraph(doing),
        progress_bar(going.share or 0.0),
        *([paragraph(several)] if people > 1 else []),
        row(button("Cancel", "start.cancel", do=cancel, disabled=going.stopping, kind="danger")),
    ]
