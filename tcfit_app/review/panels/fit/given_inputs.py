"""Inputs for what a fit is given besides its clip: the result it starts from, and the person's shape."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from msgspec import structs

from fitting_core.config.settings import changed
from fitting_core.errors import InputError
from tcfit_app.project.storage.run_record import Source
from tcfit_app.review.panels.elements.field import Dropdown, Field, Number, for_writers, frame_number
from tcfit_app.review.panels.elements.html import Board, paragraph
from tcfit_app.review.tab.state import FitSettings
from tcfit_app.review.tab.tab import Tab

Attempt = Callable[[str, Callable[[], None]], None]
"""Applies the value of a setting; remembers why it is invalid."""
FILE = "a file …"
HELD = Number(label="Held near (m)", low=0.001, high=10.0)
_NAMES = ("start", "person", "first_frame", "held", "shape")
"""Of what can be wrong here."""
_PERSON, _FIRST = "Person in it", "Its first frame"


@dataclass(frozen=True, kw_only=True)
class _Part:
    name: Literal["start", "shape"]
    label: str
    hint: str
    none: str
    """The choice of neither run nor file."""
    path: str
    """The label of its path."""
    path_hint: str


START = _Part(
    name="start",
    label="Start from",
    hint="The result that phase 1 of a whole fit starts from: a run of this project, or another program's",
    none="nothing: only the clip",
    path="Path of the result",
    path_hint="On the computer that runs tcfit: any result that the panel Runs can import, also for part of the clip",
)
SHAPE = _Part(
    name="shape",
    label="Same person as",
    hint="Use this run's or file's body shape, for whole fits and for Re-run shape",
    none="nobody: estimate from the clip",
    path="Path of the shape",
    path_hint="On the computer that runs tcfit: a project, a result's folder, or an npz or JSON file with betas",
)


class GivenInputs:
    """A part of a panel.

    Args:
        tab: the tab whose settings these are.
        attempt: applies values.
    """

    def __init__(self, tab: Tab, attempt: Attempt) -> None:
        self._tab, self._attempt, gui = tab, attempt, tab.client.gui
        self._start = _SourceInput(tab, attempt, START)
        hint = "If it has several people; empty: the one who matches the keypoints"
        self._person = gui.add_text(_PERSON, "", hint=hint, visible=False)
        hint = "Video frame number of the result's first frame; empty: as stored in it"
        self._first = gui.add_text(_FIRST, "", hint=hint, visible=False)
        self._person_field = self._number(self._person, _PERSON, "person")
        self._first_field = self._number(self._first, _FIRST, "first_frame")
        hint = f"How close the fit stays to its start; empty: it only starts there. {HELD.range.capitalize()}."
        handle = gui.add_text(HELD.label, _shown_held(tab.state.settings), hint=hint)
        for_writers(tab, self._person, self._first, handle)
        self._held = Field(tab, handle, lambda typed: attempt("held", lambda: self._take_held(typed)))
        self._shape = _SourceInput(tab, attempt, SHAPE)
        self._problems = Board(tab)

    def _number(self, handle: Any, label: str, name: str) -> Field[str]:
        def take(typed: str) -> None:
            source = self._tab.state.settings.given.start or Source()
            self._start.set(structs.replace(source, **{name: frame_number(label, typed)}))

        return Field(self._tab, handle, lambda typed: self._attempt(name, lambda: take(typed)))

    def _take_held(self, typed: str) -> None:
        now = self._tab.state.settings
        metres = HELD.read(typed) if typed.strip() else "none"
        config = changed(now.config, {"start_deviation": metres}, origin="Fit settings")
        self._tab.set(settings=replace(now, config=config))

    def draw(self) -> None:
        """Send what changed."""
        now = self._tab.state.settings
        wrong, source = dict(now.problems), now.given.start
        for part in (self._start, self._shape):
            part.draw(now)
        for handle in (self._person, self._first):
            handle.visible = source is not None and source.run is None
        for field, name in ((self._person_field, "person"), (self._first_field, "first_frame")):
            number = None if source is None else getattr(source, name)
            field.show("" if number is None else str(number), wrong=name in wrong)
        self._held.show(_shown_held(now), wrong="held" in wrong)
        self._problems.show(*(paragraph(wrong[name], "bad") for name in _NAMES if name in wrong))


def _shown_held(now: FitSettings) -> str:
    metres = now.config.start_deviation
    return "" if metres is None else HELD.shown(metres)


class _SourceInput:
    """A choice among the project's runs, or a file's path."""

    def __init__(self, tab: Tab, attempt: Attempt, part: _Part) -> None:
        self._tab, self._part, gui = tab, part, tab.client.gui
        handle = gui.add_dropdown(part.label, (part.none, FILE), hint=part.hint)
        self._choice = Dropdown(tab, handle, lambda chosen: attempt(part.name, lambda: self._choose(chosen)))
        self._path: Any = gui.add_text(part.path, "", hint=part.path_hint, visible=False)
        for_writers(tab, handle, self._path)
        self._path_field = Field(tab, self._path, lambda typed: attempt(part.name, lambda: self._take_path(typed)))

    def _choose(self, chosen: str) -> None:
        runs = {run.option: run.id for run in self._tab.session.fits.runs}
        if chosen in runs:
            self.set(Source(run=runs[chosen]))
        elif chosen == self._part.none:
            self.set(None)
        elif chosen == FILE:
            self.set(Source())
            raise InputError(f"{self._part.path} is empty; expected the path of a file or folder.")

    def _take_path(self, typed: str) -> None:
        path = self._tab.files.path(typed)
        if not path.exists():
            raise InputError(f"{path}: does not exist; expected a file or folder on the computer that runs tcfit.")
        before = self._source(self._tab.state.settings) or Source()
        self.set(structs.replace(before, run=None, path=str(path)))

    def set(self, source: Source | None) -> None:
        now = self._tab.state.settings
        given = structs.replace(now.given, **{self._part.name: source})
        self._tab.set(settings=replace(now, given=given))

    def _source(self, now: FitSettings) -> Source | None:
        return getattr(now.given, self._part.name)

    def draw(self, now: FitSettings) -> None:
        source, wrong = self._source(now), self._part.name in dict(now.problems)
        of_file = source is not None and source.run is None
        known = {run.id: run.option for run in reversed(self._tab.session.fits.runs) if run.stored}
        chosen = self._part.none
        if source is not None:
            chosen = FILE if source.run is None else known.setdefault(source.run, f"{source.run} · a deleted run")
        self._choice.offer((self._part.none, *known.values(), FILE), chosen)
        self._path.visible = of_file
        self._path_field.show(source.path if source is not None else "", wrong=wrong)
