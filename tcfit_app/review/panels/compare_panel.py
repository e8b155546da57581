"""The Compare panel: A and B in figures, and where they differ."""

import time
from collections.abc import Callable, Hashable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import viser
from jaxtyping import Float

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.measure.references.files import POINT_FILES, read_reference
from fitting_core.measure.references.reference import Reference
from tcfit_app.analysis.curves import peaks
from tcfit_app.analysis.run_metrics import COST, ComparedMetric, compare
from tcfit_app.fitting.fits import Shown
from tcfit_app.fitting.reports import Notice
from tcfit_app.imports.results import kept_as
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.field import for_writers, frame_number, upload_button
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    action,
    button,
    dot,
    heading,
    joined,
    line,
    paragraph,
    row,
    table,
    text,
    words,
)
from tcfit_app.review.panels.runs.parents import parent_of, show_beside_parent
from tcfit_app.review.scene.layers import RUN_COLORS, css
from tcfit_app.review.session.tasks import Step, Task
from tcfit_app.review.tab.tab import Tab

SETTLING = 1.0
"""Seconds that keypoints and fits must be unchanged before figures are computed, which takes all meshes."""
_MEASURING = "Measuring …"
_NO_FIT = "This panel compares two fits. There is none yet: see the panel Fit."
_BETTER = "better in green"
_SAME = "A and B are the same fit: choose another in the panel View or Runs."
_COSTS = "Mean per frame; comparable only between runs with the same weights and keypoints."


class ComparePanel:
    """See `Panel`."""

    title: ClassVar[str] = "Compare"
    icon: ClassVar[viser.IconName] = viser.Icon.SCALE

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        self._rest, tab = _Rest(), gestures.tab
        self._head, self._peaks, self._against = (Board(tab) for _ in range(3))
        self._selected = SelectedFigures(tab)
        self._figures = Board(tab)
        self._reference = ReferenceField(tab)
        with tab.client.gui.add_folder("Costs", expand_by_default=False):
            self._costs = Board(tab)
        tab.buttons.on("compare.frame", tab.seek, int)
        tab.buttons.on("compare.parent", lambda _: show_beside_parent(tab, _shown_as_b(tab)))

    def draw(self) -> None:
        """See `Panel.draw`."""
        tab, data = self._tab, self._tab.data
        a, b = tab.shown.a, tab.shown.b
        self._selected.draw(a, b)
        self._reference.draw()
        if a is None or b is None:
            self._head.show(paragraph(_NO_FIT, "dim"))
            for board in (self._peaks, self._against, self._figures, self._costs):
                board.show()
            return
        taking = row(action(self._gestures, "take_from_a"))
        self._head.show(*_heads(a, b, taking, parent=parent_of(tab, b.run)))
        if self._rest.lasts(data.key(a), data.key(b), tab.session.project.reference_version):
            self._draw_figures(a, b)
        else:
            self._figures.show(paragraph(self._reason(a, b), "dim"))
            self._costs.show()

    def _draw_figures(self, a: Shown, b: Shown) -> None:
        """The figures available so far, once keypoints and fits have settled."""
        data = self._tab.data
        apart = data.distances(a, b)
        self._draw_against(a, b)
        self._peaks.show(*([] if apart is None or a == b else self._peak_buttons(apart.values)))
        one, other = data.metrics(a), data.metrics(b)
        if one is None or other is None:
            self._figures.show(paragraph(self._reason(a, b), "dim"))
            return
        rows = compare(one, other)
        self._figures.show(heading("Whole clip", _BETTER), _table(r for r in rows if not r.name.startswith(COST)))
        self._costs.show(paragraph(_COSTS, "dim"), _table(r for r in rows if r.name.startswith(COST)))

    def _draw_against(self, a: Shown, b: Shown) -> None:
        """Figures against the project's reference, if any."""
        data, reference = self._tab.data, self._tab.session.project.reference
        if reference is None or a.result is None or b.result is None:
            self._against.show()
            return
        head = heading("Against the reference", f"{reference.name}; {_BETTER}")
        one, other = data.reference_metrics(a), data.reference_metrics(b)
        if one is None or other is None:
            problem = data.problem("reference", a) or data.problem("reference", b)
            self._against.show(head, paragraph(problem or _MEASURING, "warn" if problem else "dim"))
            return
        self._against.show(head, _table(compare(one, other)))

    def _reason(self, a: Shown, b: Shown) -> str:
        """Why there are no figures yet."""
        running = [fit.run.name for fit in (a, b) if fit.result is None]
        if running:
            return f"{running[0]} is still being fitted; its figures follow when it is done."
        return self._tab.data.problem("metrics", a) or self._tab.data.problem("metrics", b) or _MEASURING

    def _peak_buttons(self, values: Float[np.ndarray, "T"]) -> list[Html]:
        first, frames = self._tab.first_frame, peaks(values)
        if not frames:
            return []
        buttons = (
            button(joined(text(first + frame), words(f": {values[frame]:.0f} mm", "dim")), "compare.frame", str(frame))
            for frame in frames
        )
        mean = f"Distance of joints; {np.nanmean(values):.1f} mm in the clip's mean."
        return [heading("Frames that differ most"), row(*buttons, wrap=True), paragraph(mean, "dim")]


def _shown_as_b(tab: Tab) -> Run:
    shown = tab.look().b
    if shown is None:
        raise InputError("There is no fit yet: fit everything first.")
    return shown.run


class _Rest:
    """Tells whether something has stayed unchanged for SETTLING."""

    def __init__(self) -> None:
        self._key: tuple[Hashable, ...] = ()
        self._since = 0.0

    def lasts(self, *key: Hashable) -> bool:
        """Whether the key has been the same for that long."""
        if key != self._key:
            self._key, self._since = key, time.monotonic()
        return time.monotonic() - self._since >= SETTLING


class SelectedFigures:
    """Figures of the frames selected in the timeline; this part of the panel shows only while there are any.

    The effect of re-running a few frames is lost in the means of a whole clip.
    """

    def __init__(self, tab: Tab) -> None:
        self._tab, self._board, self._rest = tab, Board(tab), _Rest()

    def draw(self, a: Shown | None, b: Shown | None) -> None:
        """Update to the selection and the fits on show."""
        data, frames = self._tab.data, self._tab.state.frames
        if frames is None or a is None or b is None:
            return self._board.show()
        rests = self._rest.lasts(frames, data.key(a), data.key(b))
        one, other = (data.metrics(fit, frames) if rests else None for fit in (a, b))
        head = heading(f"Selected {in_words(frames, self._tab.first_frame)}", "better in green")
        if one is None or other is None:
            self._board.show(head, paragraph(_MEASURING, "dim"))
        else:
            self._board.show(head, _table(compare(one, other)))


def _heads(a: Shown, b: Shown, taking: Html, *, parent: Run | None) -> list[Html]:
    named = zip("AB", RUN_COLORS, (a, b), strict=True)
    rows = [paragraph(joined(dot(css(color)), text(f"{name}: {fit.title}"))) for name, color, fit in named]
    same = (a.run.id, a.phase) == (b.run.id, b.phase)
    beside = parent is not None and a.run.id != parent.id
    more = [row(button("Compare B with its parent", "compare.parent", hint=parent.name))] if beside and parent else []
    return [heading("Fits on show", first=True), *rows, paragraph(_SAME, "dim") if same else taking, *more]


def _table(rows: Iterable[ComparedMetric]) -> Html:
    return table(map(_line, rows), ("", "A", "B", "B − A"), numbers=(1, 2, 3))


def _line(figure: ComparedMetric) -> Html:
    unit = words(f" {figure.unit}", "dim") if figure.unit else Html()
    change = "" if figure.difference is None else _number(figure.difference, sign=True)
    return line(
        joined(text(figure.title), unit),
        _marked(_number(figure.a), "good" if figure.better == "a" else ""),
        _marked(_number(figure.b), "good" if figure.better == "b" else ""),
        _marked(change, {"a": "bad", "b": "good"}.get(figure.better or "", "")),
        numbers=(1, 2, 3),
    )


def _marked(content: str, kind: str) -> Html:
    return words(content, kind) if kind else text(content)


def _number(value: float | None, *, sign: bool = False) -> str:
    """Three significant digits, without an exponent."""
    if value is None:
        return "–"
    digits = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2 if abs(value) >= 1 else 3
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    return text.replace("-", "−")


_HINT = "npz of 3D points, TRC, C3D, AMASS-style npz, truth.npz or fit.npz, on the computer where tcfit runs"
_CAMERA_HINT = "npz with R and t of the clip's camera in the reference's world; empty: use the calibration"
_FIRST_HINT = "Video frame number of the reference's first frame; empty: as stored in it, or 0"
_NONE = "Without a reference, fits can only be compared with each other."
_READING = "Reading the reference …"


class ReferenceField:
    """Shows the project's reference, and accepts another: from a path, or uploaded by the browser."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._reading: Task[Reference] | None = None
        """The reference requested last."""
        gui = tab.client.gui
        with gui.add_folder("Reference", expand_by_default=False):
            self._told = Board(tab)
            self._path = gui.add_text("File", "", hint=_HINT)
            self._camera = gui.add_text("Camera", "", hint=_CAMERA_HINT)
            self._first = gui.add_text("Begins at frame", "", hint=_FIRST_HINT)
            for_writers(tab, self._path, self._camera, self._first)
            self._buttons = Board(tab)
            hint = "The same, from this browser's computer"
            self._upload = upload_button(tab, "Upload a reference", self._uploaded, hint=hint)
        tab.buttons.on("compare.reference", lambda _: self._from_path())
        tab.buttons.on("compare.forget", lambda _: self._forget())

    def draw(self) -> None:
        """Update from the project's state."""
        project, reading = self._tab.session.project, self._busy
        self._told.show(paragraph(_READING if reading else _described(project.reference), "dim"))
        self._buttons.show(row(*self._choices(project.reference, off=reading or project.read_only)))

    def _choices(self, reference: Reference | None, *, off: bool) -> list[Html]:
        take = button("Compare with this", "compare.reference", disabled=off)
        forget = button("Remove the reference", "compare.forget", disabled=off)
        return [take] if reference is None else [take, forget]

    def _from_path(self) -> None:
        if not self._path.value.strip():
            raise InputError("Type where the reference is: a file, or a folder with a truth.npz or fit.npz.")
        path = self._tab.files.path(self._path.value)
        camera, placed, seen_by = self._camera_given(), self._start_given(), self._clip_camera
        self._read(lambda: placed(read_reference(path, camera=camera, seen_by=seen_by)))

    def _uploaded(self, file: viser.UploadedFile) -> None:
        shown, camera, placed = name_of_file(file.name), self._camera_given(), self._start_given()
        seen_by = self._clip_camera

        def read() -> Reference:
            # The uploaded name never becomes part of a path; only its suffix counts.
            ending = Path(shown.lower()).suffix
            name = f"upload{ending if ending in POINT_FILES else '.npz'}"
            with kept_as(name, file.content, shown) as path:
                return replace(placed(read_reference(path, camera=camera, seen_by=seen_by)), name=shown)

        self._read(read)

    def _camera_given(self) -> Path | None:
        self._tab.refuse_read_only()
        return self._tab.files.path(self._camera.value) if self._camera.value.strip() else None

    @property
    def _clip_camera(self) -> Camera:
        return self._tab.session.project.footage.camera

    def _start_given(self) -> Callable[[Reference], Reference]:
        """What shifts a reference to the start frame that the user gave."""
        first, rate = frame_number("Begins at frame", self._first.value), self._tab.session.project.footage.frame_rate
        return lambda found: found if first is None else found.starting_at(first, rate)

    def _read(self, read: Callable[[], Reference]) -> None:
        """Read it in a task: a body's joints over a clip take seconds."""
        session = self._tab.session
        if self._busy:
            raise InputError("Another reference is still being read: wait for it.")

        def work(report: Step) -> Reference:
            reference = read()
            session.bodies.of_reference(reference)
            report("Saving it", None)
            session.project.set_reference(reference)
            return reference

        self._reading = self._tab.begin("Reading the reference", work, self._take, writes=True)

    @property
    def _busy(self) -> bool:
        return self._reading is not None and self._reading.state == "running"

    def _take(self, reference: Reference) -> None:
        self._tab.session.tell(Notice(title="Reference set", text=_described(reference), kind="done"))

    def _forget(self) -> None:
        self._tab.refuse_read_only()
        self._tab.session.project.set_reference(None)


def _described(reference: Reference | None) -> str:
    if reference is None:
        return _NONE
    placed = "in the camera's space" if reference.in_camera else "in its own world: only pose is compared"
    return "\n".join([f"{reference.name}: {reference.kind}, {len(reference)} frames, {placed}", *reference.notes])
