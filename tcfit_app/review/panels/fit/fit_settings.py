"""The settings of the next fit: inputs for those changed most often, and all others as TOML."""

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, Literal, get_args

from msgspec import structs

from fitting_core.body.files.forms import KINDS
from fitting_core.body.files.registry import GENDERS
from fitting_core.camera import FULL_FRAME_DIAGONAL_MM, Camera
from fitting_core.config.schema import POSE_PRIORS, PRESETS, FitConfig
from fitting_core.config.settings import RANGES, Range, changed, settings, value_of, without_effect
from fitting_core.config.toml import as_toml, parsed
from fitting_core.errors import InputError
from fitting_core.files.regular import parsed_toml
from fitting_core.priors.files.registry import list_priors
from tcfit_app.project.storage.run_record import Source, by_name
from tcfit_app.review.gestures.fitting import camera_of
from tcfit_app.review.panels.elements.camera_input import CameraInput
from tcfit_app.review.panels.elements.field import Dropdown, Field, Number, NumberField, When, always, for_writers
from tcfit_app.review.panels.elements.html import Board, button, paragraph, row
from tcfit_app.review.tab.state import FitSettings
from tcfit_app.review.tab.tab import Tab

ORIGIN = "Fit settings"
"""What messages call the source of wrong values."""


@dataclass(frozen=True)
class _Row:
    """A setting with an input of its own."""

    label: str
    hint: str
    most: float = math.inf
    """A bound where the setting has none, beyond which nothing improves; infinite: the clip's number of frames."""


ROWS = {
    "temporal.weight": _Row(
        "Smoothness (w_T)", "Weight of consistency over time, E_T in the method: the higher, the smoother", 1e5
    ),
    "temporal.mode": _Row(
        "Mode", "How consistency over time is solved: a sliding window as in the paper, or all frames at once"
    ),
    "temporal.window_size": _Row("Window", "Frames per sliding window"),
    "shape_sample.size": _Row("Frames for body shape", "Number of frames that determine the shared shape"),
    "shape_sample.strategy": _Row(
        "Frames selected by", "How they are selected: at random, the most confident, or so that all parts are visible"
    ),
    "pose_prior": _Row("Pose prior", "What counts as a likely pose"),
    "silhouettes": _Row("Silhouettes", "Also fit the shape to the person's silhouette (Shift+U shows it)"),
    "solver": _Row("Solver", "How costs are minimised; the paper uses L-BFGS"),
    "height": _Row("Height (cm)", "The person's height without shoes; it determines the distance"),
}
"""By dotted name. All others are in the text of all settings."""
_CHOICES: dict[str, Any] = {
    "sliding window": "sliding_window",
    "all frames at once": "global",
    "at random": "random",
    "highest confidence": "confident",
    "all parts visible": "coverage",
    "around the T-pose": "axis_angle",
    "standing at ease": "relaxed",
    "learned (tcfit)": "tcfit",
    "learned (VPoser)": "vposer",
    "Levenberg-Marquardt": "lm",
    "L-BFGS": "lbfgs",
    "on": True,
    "off": False,
}
"""Choices by their names."""
CHOICE_WORDS = {str(choice): word for word, choice in _CHOICES.items()}
"""The name of each choice, by its text."""
PRESET_LINES = {
    "tcfit": "Most accurate.",
    "paper": "As published: a sliding window over time.",
    "smplifyx": "The first pass as in SMPLify-X, then as published.",
}
"""What the presets are for."""
_FOCAL = Number(label="Focal length", low=1.0, high=1e6, of="pixels")
_HELD = Number(label="Held near (m)", low=0.001, high=10.0)
_BODY = frozenset(("kind", "gender"))
"""Inputs whose values are valid or invalid together: a right one settles the problem of the other."""
_SOURCE = "All settings"
_FILE = "a file …"
_PATH = "Path of the shape"
_Read = Callable[[FitSettings], Any]
_Take = Callable[[Any], None]
_Options = Callable[[], Sequence[str]]


@lru_cache(256)
def differences(config: FitConfig, preset: str, frames: int = 2) -> tuple[str, ...]:
    """Dotted names of the settings that differ from the preset's and have an effect on a clip of that many frames; not
    the height, which belongs to the person."""
    base, idle = replace(PRESETS[preset], height=config.height), without_effect(config, frames)
    return tuple(name for name in settings() if name not in idle and value_of(config, name) != value_of(base, name))


def _changed(config: FitConfig, preset: str) -> list[str]:
    """All that differ, with an effect or not."""
    return [name for name in settings() if value_of(config, name) != value_of(PRESETS[preset], name)]


@lru_cache(256)
def nearest_preset(config: FitConfig) -> str:
    """The preset that differs least from a configuration."""
    return min(PRESETS, key=lambda name: (len(differences(config, name)), len(_changed(config, name))))


def words(name: str) -> str:
    """A setting in a sentence: its label, or its dotted name."""
    label = ROWS[name].label if name in ROWS else name
    return label[0].lower() + label[1:]


def pose_priors(now: str) -> tuple[str, ...]:
    """The names of those on this computer, and of the current one."""
    latent = [prior.name for prior in list_priors() if not prior.problem]
    there = [name for name in POSE_PRIORS if name in ("axis_angle", "relaxed") or name in latent]
    return tuple(dict.fromkeys(map(_word, [*there, now])))


class FitInputs:
    """Inputs for a tab's `FitSettings`; created where its method is called, hidden while it has no effect."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._gui = tab, tab.client.gui
        self._fields: list[Field[Any]] = []
        self._when: When = always
        self._lines: list[tuple[Board, When]] = []
        """The lines about the preset."""
        self._height = tab.session.project.height
        """The project's, as this tab knows it."""

    @contextmanager
    def shown(self, when: When) -> Iterator[None]:
        """Show the inputs that are created meanwhile only while `when` says so."""
        before, self._when = self._when, when
        yield
        self._when = before

    # --- elements ---

    def add_preset(self) -> None:
        """The preset, with a line about it."""
        hint = " ".join(f"{name}: {line}" for name, line in PRESET_LINES.items())
        self._add_dropdown("preset", "Preset", hint, lambda s: s.preset, self._take_preset, lambda: (*PRESETS,))
        self._lines.append((Board(self._tab), self._when))

    def add_changed(self) -> None:
        """What differs from the preset or is wrong, and the way back."""
        self._changed = Board(self._tab)

    def add(self, *names: str) -> None:
        """Inputs for settings in ROWS."""
        for name in names:
            self._add_setting(name)

    def _add_setting(self, name: str) -> None:
        kind, known, take = settings()[name].type, ROWS[name], partial(self._take, name)
        if kind in (int, float):
            self._add_number(name, self._number(name), known.hint, lambda s: value_of(s.config, name), take)
            return
        choices = tuple(_word(value) for value in get_args(kind) or (True, False))
        options = self._pose_priors if name == "pose_prior" else lambda: choices
        self._add_dropdown(name, known.label, known.hint, lambda s: _word(value_of(s.config, name)), take, options)

    def add_height(self) -> None:
        """The person's height, or nothing; stored in the project."""
        known, shown = RANGES["height"], ROWS["height"]
        number = Number(label=shown.label, low=known.low, high=known.high, of="leave it empty if unknown")

        def take(metres: float | None) -> None:
            self._take("height", metres)
            if not (project := self._tab.session.project).read_only:
                project.set_height(self._tab.state.settings.config.height)
                self._height = project.height

        self._add_number("height", number, shown.hint, lambda s: s.config.height, take, optional=True)

    def add_body(self) -> None:
        """Body model and gender."""
        hint, take = "The model of the body file", lambda kind: self._take_body(kind=kind)
        self._add_dropdown("kind", "Body model", hint, lambda s: s.kind, take, lambda: (*KINDS,))
        hint, take = "Which variant of the model", lambda gender: self._take_body(gender=gender)
        self._add_dropdown("gender", "Gender", hint, lambda s: s.gender, take, lambda: GENDERS)

    def add_focal(self) -> None:
        """The focal length."""
        hint = "For whole fits; a re-run keeps its run's focal length"
        read: Callable[[FitSettings], float] = lambda s: round(float(s.focal or self._camera.focal[0]), 2)  # noqa: E731
        self._add_number("focal", _FOCAL, hint, read, self._take_focal)
        self._focal = Board(self._tab)

    def add_calibration(self) -> None:
        """The project's camera."""
        self._calibration = CameraInput(self._tab, "fit.camera")

    def add_given(self) -> None:
        """What a fit is given besides its clip: the result it starts from, and the person's shape."""
        hint = "The fit or imported result that the first pass starts from"
        self._add_source("start", "Start from", hint, "nothing: only the clip")
        hint = "How close the fit stays to its start; empty: it only starts there"
        with self.shown(lambda: self._tab.state.settings.given.start is not None):
            take = partial(self._take, "start_deviation")
            self._add_number("held", _HELD, hint, lambda s: s.config.start_deviation, take, optional=True)
        hint = "Use this fit's or file's body shape, for whole fits and for fitting the shape again"
        self._add_source("shape", "Same person as", hint, "nobody: estimate from the clip", file=True)
        hint = "On the computer that runs tcfit: a project, a result's folder, or an npz or JSON file with betas"
        path = self._gui.add_text(_PATH, "", hint=hint, visible=False)
        with self.shown(lambda: (shape := self._tab.state.settings.given.shape) is not None and shape.run is None):
            self._add("shape", Field, path, lambda s: s.given.shape.path if s.given.shape else "", self._take_path)

    def add_source(self) -> None:
        """All settings as editable text."""
        self._source = self._gui.add_text("TOML", "", multiline=True)
        for_writers(self._tab, self._source)
        self._source_of: Hashable = None
        Board(self._tab).show(row(button("Use these settings", "fit.source", do=self._take_source)))

    def _pose_priors(self) -> tuple[str, ...]:
        now = self._tab.state.settings.config.pose_prior
        return self._tab.once("pose priors", self._tab.state.settings, lambda: pose_priors(now))

    def _number(self, name: str) -> Number:
        """The valid range of a setting for this clip."""
        length, known, shown = self._tab.length, RANGES.get(name, Range()), ROWS[name]
        whole = settings()[name].type is int
        if shown.most == math.inf:
            of = f"the clip has {length} frames"
            return Number(label=shown.label, low=known.low, high=max(length, known.low), whole=whole, of=of)
        return Number(label=shown.label, low=known.low, high=shown.most, whole=whole)

    def _add_number(
        self, name: str, number: Number, hint: str, read: _Read, take: _Take, *, optional: bool = False
    ) -> None:
        def shown(now: FitSettings) -> str:
            return "" if (value := read(now)) is None else number.shown(value)

        def typed(given: str) -> None:
            take(None if optional and not given.strip() else number.read(given))

        hint = f"{hint}. {number.range.capitalize()}."
        handle = self._gui.add_text(number.label, shown(self._tab.state.settings), hint=hint)
        self._add(name, NumberField, handle, shown, typed)

    def _add_dropdown(self, name: str, label: str, hint: str, read: _Read, take: _Take, options: _Options) -> None:
        now = read(self._tab.state.settings)
        handle = self._gui.add_dropdown(label, options(), initial_value=now, hint=hint)
        self._add(name, partial(Dropdown, options=options), handle, read, take)

    def _add(self, name: str, kind: Callable[..., Field[Any]], handle: Any, read: _Read, take: _Take) -> None:
        tab, when = self._tab, self._when

        def shown() -> Any:
            """What is wrong is not in the settings, and stays in its field; a body that is not there is."""
            now = tab.state.settings
            return None if name in dict(now.problems) and name not in _BODY else read(now)

        def attempt(value: Any) -> None:
            self._attempt(name, lambda: take(value))

        def visible() -> bool:
            return when() and name not in without_effect(tab.state.settings.config, tab.length)

        off = lambda: tab.session.project.read_only  # noqa: E731
        self._fields.append(kind(tab, handle, attempt, shown, off=off, when=visible))

    def _add_source(
        self, name: Literal["start", "shape"], label: str, hint: str, none: str, *, file: bool = False
    ) -> None:
        """A dropdown of the project's runs."""
        tab, also = self._tab, (_FILE,) if file else ()

        def runs() -> dict[str, Source | None]:
            stored = [run for run in reversed(tab.session.fits.runs) if run.stored]
            return {none: None, **{name: Source(run=run.id) for name, run in by_name(stored).items()}}

        def read(now: FitSettings) -> str:
            source = getattr(now.given, name)
            if source is not None and source.run is None:
                return _FILE if file else source.path
            known = (option for option, one in runs().items() if one == source)
            return next(known, "" if source is None else f"{source.run} · a deleted run")

        def take(chosen: str) -> None:
            if chosen == _FILE:
                self._give(shape=Source())
                raise InputError(f"{_PATH} is empty; expected the path of a file or folder.")
            if chosen in (known := runs()):
                self._give(**{name: known[chosen]})

        def options() -> Sequence[str]:
            return tuple(dict.fromkeys((*runs(), *also, read(tab.state.settings))))

        self._add_dropdown(name, label, hint, read, take, options)

    # --- what is entered ---

    def _attempt(self, name: str, take: Callable[[], None]) -> None:
        """Apply a value; if it is invalid, remember why."""
        try:
            take()
            why = ""
        except InputError as error:
            why = str(error)
        # Read after `take`, which may settle problems of other inputs.
        settled = _BODY if name in _BODY else {name}
        others = [(other, text) for other, text in self._tab.state.settings.problems if other not in settled]
        self._set(problems=(*others, *([(name, why)] if why else [])))

    def _set(self, **values: Any) -> None:
        self._tab.set(settings=replace(self._tab.state.settings, **values))

    def _give(self, **sources: Source | None) -> None:
        self._set(given=structs.replace(self._tab.state.settings.given, **sources))

    def _take_preset(self, name: str) -> None:
        self._set(preset=name, config=self._tab.session.preset(name), problems=())

    def _take(self, name: str, value: Any) -> None:
        value = "none" if value is None else _CHOICES.get(value, value)
        value = self._prior(value) if name == "pose_prior" else value
        self._set(config=changed(self._tab.state.settings.config, {name: value}, origin=ORIGIN))

    def _take_path(self, typed: str) -> None:
        path = self._tab.files.path(typed)
        if not path.exists():
            raise InputError(f"{path}: does not exist; expected a file or folder on the computer that runs tcfit.")
        self._give(shape=Source(path=str(path)))

    def _take_body(self, **values: str) -> None:
        self._set(**values)
        now = self._tab.state.settings
        self._tab.session.bodies.check(kind=now.kind, gender=now.gender)

    def _take_focal(self, value: float) -> None:
        same = value == round(float(self._camera.focal[0]), 2)
        now = replace(self._tab.state.settings, focal=None if same else float(value))
        camera_of(now, self._camera)
        self._set(focal=now.focal)

    def _take_source(self) -> None:
        given = {}
        with suppress(ValueError):  # `parsed` reports it
            given = parsed_toml(self._source.value)
        prior = self._prior(given.get("pose_prior"))
        preset, config = parsed(self._source.value, origin=_SOURCE)
        config = replace(config, pose_prior=prior) if prior is not None else config
        self._set(preset=preset, config=config, problems=())
        self._tab.say("Settings applied")

    def _prior(self, given: Any) -> Any:
        """A pose prior as entered; if it is not a known name it is a file, which this page must be allowed to read."""
        known = not isinstance(given, str) or given in (*POSE_PRIORS, self._tab.state.settings.config.pose_prior)
        return given if known else str(self._tab.files.path(given))

    @property
    def _camera(self) -> Camera:
        return self._tab.session.project.footage.camera

    # --- drawing ---

    def draw(self) -> None:
        """Send what changed."""
        self._follow_height()
        now = self._tab.state.settings
        for field in self._fields:
            field.draw()
        self._calibration.draw()
        self._draw_changed(now)
        self._draw_focal(now)
        for board, when in self._lines:
            board.show(*([paragraph(PRESET_LINES[now.preset], "dim")] if when() else []))
        self._draw_source(now)

    def _follow_height(self) -> None:
        """Take over a height that was given in another tab, which the project keeps."""
        height = self._tab.session.project.height
        if height != self._height:
            self._height = height
            self._set(config=replace(self._tab.state.settings.config, height=height))

    def _draw_changed(self, now: FitSettings) -> None:
        names = differences(now.config, now.preset, self._tab.length)
        back = button(
            "Back to the preset",
            "fit.preset",
            do=lambda: self._take_preset(self._tab.state.settings.preset),
            hint="Resets all settings to the preset",
        )
        lines = [paragraph(why, "bad") for _, why in now.problems]
        if names and not lines:
            lines = [paragraph(f"Changed from the preset: {', '.join(map(words, names))}")]
        self._changed.show(*([*lines, row(back)] if lines else []))

    def _draw_focal(self, now: FitSettings) -> None:
        camera = self._camera
        focal, size = now.focal or camera.focal[0], camera.size
        millimetres = focal * FULL_FRAME_DIAGONAL_MM / math.hypot(*size)
        angle = math.degrees(2 * math.atan(size[0] / 2 / focal))
        whose = "The clip's own" if now.focal is None else f"The clip's own is {camera.focal[0]:.2f} pixels. This one"
        self._focal.show(paragraph(f"{whose}: {millimetres:.0f} mm (35 mm equivalent), {angle:.0f}° wide.", "dim"))

    def _draw_source(self, now: FitSettings) -> None:
        key = (now.preset, now.config)
        if key != self._source_of:
            self._source_of = key
            self._source.value = as_toml(now.config, preset_name=now.preset)


def _word(choice: object) -> str:
    return CHOICE_WORDS.get(str(choice), str(choice))
