"""The Fit panel: the fits, the two that are compared, and the settings of the next one."""

from typing import ClassVar

import viser

from fitting_core.keypoint_noise import DETECTOR_TITLES
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.storage.run_record import Source
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import Board, Html, action, heading, paragraph, row
from tcfit_app.review.panels.fit.compare import Compared
from tcfit_app.review.panels.fit.fit_list import FitList
from tcfit_app.review.panels.fit.fit_settings import FitInputs
from tcfit_app.review.panels.fit.other_views import ViewList


class FitPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Fit"
    icon: ClassVar[viser.IconName] = viser.Icon.RUN

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab = gestures.tab
        self._list, self._compared = FitList(gestures), Compared(tab)
        self._inputs = inputs = FitInputs(tab)
        self._head = Board(tab)
        with inputs.shown(self._again):
            inputs.add_preset()
            inputs.add("temporal.weight")
        with inputs.shown(lambda: self._again() and self._frames is None):
            inputs.add("shape_sample.size")
        with inputs.shown(lambda: self._writable and self._frames is None):
            inputs.add_height()
        self._main = Board(tab)
        inputs.add_changed()
        self._views = ViewList(gestures)
        self._camera, self._every = Fold(tab, "fit.camera"), Fold(tab, "fit.all")
        with self._camera:
            inputs.add_focal()
            self._lines = Board(tab)
            inputs.add_calibration()
        with self._every:
            self._part("Method", first=True)
            with inputs.shown(lambda: not self._again()):
                inputs.add_preset()
                inputs.add("temporal.weight", "shape_sample.size")
            inputs.add("temporal.mode", "temporal.window_size", "shape_sample.strategy")
            inputs.add("pose_prior", "solver", "silhouettes")
            self._part("Start")
            inputs.add_given()
            self._part("Body")
            inputs.add_body()
            self._part("Files")
            self._files = Board(tab)
            self._part("As text")
            inputs.add_source()
        self._list.add_import()

    def _part(self, title: str, *, first: bool = False) -> None:
        Board(self._tab).show(heading(title, first=first))

    # --- what is shown when ---

    @property
    def _writable(self) -> bool:
        return not self._tab.session.project.read_only

    def _again(self) -> bool:
        return self._writable and bool(self._tab.session.fits.runs)

    @property
    def _frames(self) -> range | None:
        """The frames that are fitted again; None: a whole fit."""
        return self._tab.state.frames if self._tab.shown.b is not None else None

    # --- drawing ---

    def draw(self) -> None:
        """See `Panel.draw`."""
        self._inputs.draw()
        self._list.draw()
        self._compared.draw()
        self._views.draw()
        self._camera.draw("Camera", on=self._writable)
        self._lines.show(row(action(self._gestures, "straight_lines")), *self._of_lines())
        self._every.draw("All settings", on=self._writable)
        self._head.show(*self._heading())
        self._main.show(*self._button(after=True))
        detector = self._tab.session.project.footage.detector
        by = f"detected by {DETECTOR_TITLES.get(detector, detector)}" if detector else "of an unknown detector"
        notes = self._tab.session.project.footage.notes
        self._files.show(paragraph(f"Keypoints: {by}."), *(paragraph(note, "dim") for note in notes))

    def _heading(self) -> list[Html]:
        frames, first = self._frames, self._tab.first_frame
        if not self._writable:
            return [] if self._tab.session.fits.runs else [paragraph("Open read-only; there is no fit.")]
        if not self._again():
            return [heading("No fit yet", first=True), *self._found(), *self._button(after=False)]
        return [heading("Fit again" if frames is None else f"Fit again: {in_words(frames, first)}", first=True)]

    def _found(self) -> list[Html]:
        """Where keypoints were found, and how to choose another person."""
        tab, session = self._tab, self._tab.session
        confidence = session.project.detections.confidence
        count = tab.once("found", session.project.keypoints_version, lambda: int((confidence > 0).any(1).sum()))
        found = paragraph(f"Keypoints were found in {count} of {tab.length} frames. Fit the body to them.")
        if not session.can_choose_person or session.source.people is None:
            return [found]
        people = f"{session.source.people.count} people were found. To choose another person, click on them."
        return [found, paragraph(people)]

    def _of_lines(self) -> list[Html]:
        """How many straight lines there are, while they are shown."""
        if not self._tab.state.straight_lines:
            return []
        if self._tab.session.project.footage.source is None:
            return [paragraph("No straight lines: the project has no video.", "dim")]
        if (found := self._tab.data.straight_lines) is None:
            return []
        if not len(found.edges):
            return [paragraph("No straight lines: the camera or most of the picture moves.", "dim")]
        along = f"{found.along.sum()} of {len(found.edges)} straight lines (thick)"
        return [paragraph(f"{along} are vertical or along one of two horizontal directions at right angles.", "dim")]

    def _button(self, *, after: bool) -> list[Html]:
        """The one main button, and what its fit is given; below the inputs once there is a fit."""
        if after != self._again() or not self._writable:
            return []
        name, frames = "fit" if self._frames is None else "rerun", self._frames
        label = "Fit everything" if frames is None else f"Fit {in_words(frames, self._tab.first_frame)}"
        alone = [paragraph(f"Fits {self._tab.someone.name} only.", "dim")] if self._tab.someone.others else []
        return [row(action(self._gestures, name, label, kind="main")), *alone, *self._given()]

    def _given(self) -> list[Html]:
        """What the next whole fit is given besides the clip."""
        now, parts = self._tab.state.settings, []
        if now.given.start is not None:
            held = now.config.start_deviation
            near = "" if held is None else f", held within about {100 * held:g} cm of it"
            parts.append(f"starts from {self._named(now.given.start)}{near}")
        if now.given.shape is not None:
            parts.append(f"uses the shape of {self._named(now.given.shape)}")
        return [paragraph(f"The next fit {' and '.join(parts)}.", "dim")] if parts else []

    def _named(self, source: Source) -> str:
        return self._tab.session.fits.named(source)
