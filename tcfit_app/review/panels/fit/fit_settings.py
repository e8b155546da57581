"""The settings of the next fit, as inputs: those that are changed most, and all others as TOML."""

import tomllib
from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import replace
from typing import Any, get_args

import viser

from fitting_core.body.files.forms import KINDS
from fitting_core.body.files.registry import GENDERS
from fitting_core.config.schema import POSE_PRIORS, PRESETS, FitConfig
from fitting_core.config.settings import changed, settings, value_of
from fitting_core.config.toml import as_toml, parsed
from fitting_core.errors import InputError
from fitting_core.priors.files.registry import list_priors
from tcfit_app.review.gestures.fitting import camera_of
from tcfit_app.review.panels.elements.field import Dropdown, Field, only_read
from tcfit_app.review.panels.elements.html import Board, button, joined, paragraph, row, text
from tcfit_app.review.panels.elements.html import words as marked
from tcfit_app.review.tab.state import FitSettings
from tcfit_app.review.tab.tab import Tab

ORIGIN = "Fit settings"
"""Where wrong values stand, for messages."""
LABELS = {
    "temporal.weight": "w_T",
    "temporal.window_size": "Window size",
    "temporal.mode": "Mode",
    "temporal.space": "Temporal space",
    "shape_sample.size": "Shape frames",
    "shape_sample.strategy": "Chosen by",
    "shape_sample.seed": "Seed",
    "solver": "Solver",
    "pose_prior": "Pose prior",
}
"""Settings with an input of their own, in short words."""
_SHORT = {"temporal.window_size": "Window", "temporal.space": "Space", "shape_sample.size": "Frames"}
"""Labels that would not fit beside their input; what is around them says the rest."""
_WORDS = {"sliding_window": "sliding window"}
"""Choices that read better otherwise."""
_HINTS = {
    "temporal.weight": "Weight of consistency over time",
    "temporal.window_size": "Frames of a sliding window; mode global has none",
    "temporal.space": "In which consistency over time compares joints",
    "shape_sample.size": "How many frames find the shared shape",
    "shape_sample.seed": "Of the random choice of frames",
    "solver": "Levenberg-Marquardt, or L-BFGS as the paper has it",
}
_SOURCE = "All settings"


def differences(config: FitConfig, preset: str) -> list[str]:
    """Dotted names of the settings that are not the preset's."""
    base = PRESETS[preset]
    return [name for name in settings() if value_of(config, name) != value_of(base, name)]


def nearest_preset(config: FitConfig) -> str:
    """The preset from which a configuration differs least."""
    return min(PRESETS, key=lambda name: len(differences(config, name)))


def words(name: str) -> str:
    """A setting in a sentence: its label, or its dotted name."""
    label = LABELS.get(name, name)
    return label if label == "w_T" else label[0].lower() + label[1:]


def pose_priors(now: str) -> tuple[str, ...]:
    """Those that are on this computer, and the one that is set."""
    latent = [prior.name for prior in list_priors() if not prior.problem]
    there = [name for name in POSE_PRIORS if name in ("axis_angle", "relaxed") or name in latent]
    return tuple(dict.fromkeys([*there, now]))


class FitInputs:
    """Inputs that set a tab's `FitSettings`."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._gui = tab, tab.client.gui
        self._fields: dict[str, Field[Any]] = {}
        self._reads: dict[str, Callable[[FitSettings], Any]] = {}

    # --- elements ---

    def add_preset(self) -> None:
        """The preset, what is changed in it, and the way back."""
        now = self._tab.state.settings
        handle = self._gui.add_dropdown("Preset", tuple(PRESETS), initial_value=now.preset, hint="Sets all settings")
        self._add("preset", handle, self._take_preset, lambda s: s.preset)
        self._changed = Board(self._tab)
        self._tab.buttons.on("fit.preset", lambda _: self._take_preset(self._tab.state.settings.preset))

    def add(self, *names: str) -> None:
        """Inputs of settings of LABELS."""
        for name in names:
            self._add(name, self._input(name), self._taker(name), self._reader(name))

    def add_body(self) -> None:
        """Body model, gender and focal length."""
        now, gui = self._tab.state.settings, self._gui
        kinds = gui.add_dropdown("Body model", tuple(KINDS), initial_value=now.kind)
        self._add("kind", kinds, lambda v: self._take_body(kind=v), lambda s: s.kind)
        genders = gui.add_dropdown("Gender", GENDERS, initial_value=now.gender)
        self._add("gender", genders, lambda v: self._take_body(gender=v), lambda s: s.gender)
        clip = self._camera.focal[0]
        hint = "In pixels. Counts for whole fits; a re-run keeps that of its run."
        focal = gui.add_number("Focal length", round(float(clip), 2), step=0.01, hint=hint)
        self._add("focal", focal, self._take_focal, lambda s: round(float(s.focal or clip), 2))
        self._focal = Board(self._tab)

    def add_source(self) -> None:
        """All settings as a text that can be changed."""
        self._source = only_read(self._gui.add_text("TOML", "", multiline=True))
        self._source_of: Hashable = None
        Board(self._tab).show(row(button("Use these settings", "fit.source")))
        self._tab.buttons.on("fit.source", lambda _: self._take_source())

    def add_problems(self) -> None:
        """What was entered and cannot be used."""
        self._problems = Board(self._tab)

    def _input(self, name: str) -> Any:
        value, setting = value_of(self._tab.state.settings.config, name), settings()[name]
        label, hint = _SHORT.get(name, LABELS[name]), _HINTS.get(name, setting.doc)
        if name == "pose_prior":
            return self._gui.add_dropdown(label, pose_priors(value), initial_value=value, hint=hint)
        if options := get_args(setting.type):
            shown = tuple(str(_WORDS.get(option, option)) for option in options)
            return self._gui.add_dropdown(label, shown, initial_value=_WORDS.get(value, value), hint=hint)
        # Without bounds: viser would put a wrong number right without a word.
        return self._gui.add_number(label, value, step=1 if isinstance(value, int) else 0.1, hint=hint)

    def _add(self, name: str, handle: Any, take: Callable[[Any], None], read: Callable[[FitSettings], Any]) -> None:
        kind = Dropdown if isinstance(handle, viser.GuiDropdownHandle) else Field
        self._fields[name] = kind(self._tab, handle, lambda value: self._attempt(name, lambda: take(value)))
        self._reads[name] = read

    # --- what is entered ---

    def _attempt(self, name: str, take: Callable[[], None]) -> None:
        """Take a value over; if it is wrong, remember why."""
        problems = dict(self._tab.state.settings.problems)
        problems.pop(name, None)
        try:
            take()
        except InputError as error:
            problems[name] = str(error)
        if name == "preset":
            problems = {}
        self._tab.set(settings=replace(self._tab.state.settings, problems=tuple(problems.items())))

    def _set(self, **values: Any) -> None:
        self._tab.set(settings=replace(self._tab.state.settings, **values))

    def _take_preset(self, name: str) -> None:
        self._set(preset=name, config=PRESETS[name], problems=())

    def _taker(self, name: str) -> Callable[[Any], None]:
        plain = {word: option for option, word in _WORDS.items()}
        whole = settings()[name].type is int

        def take(value: Any) -> None:
            value = plain.get(value, value)
            value = self._prior(value) if name == "pose_prior" else value
            value = int(value) if whole and value == int(value) else value
            self._set(config=changed(self._tab.state.settings.config, {name: value}, origin=ORIGIN))

        return take

    def _reader(self, name: str) -> Callable[[FitSettings], Any]:
        def read(now: FitSettings) -> Any:
            value = value_of(now.config, name)
            return _WORDS.get(value, value)

        return read

    def _take_body(self, **values: str) -> None:
        self._set(**values)
        problems = dict(self._tab.state.settings.problems)
        for name in ("kind", "gender"):
            problems.pop(name, None)
        self._set(problems=tuple(problems.items()))
        now = self._tab.state.settings
        self._tab.session.bodies.check(kind=now.kind, gender=now.gender)

    def _take_focal(self, value: float) -> None:
        same = value == round(float(self._camera.focal[0]), 2)
        now = replace(self._tab.state.settings, focal=None if same else float(value))
        camera_of(now, self._camera)
        self._set(focal=now.focal)

    def _take_source(self) -> None:
        prior = None
        with suppress(tomllib.TOMLDecodeError, RecursionError):  # which `parsed` tells
            prior = self._prior(tomllib.loads(self._source.value).get("pose_prior"))
        preset, config = parsed(self._source.value, origin=_SOURCE)
        config = replace(config, pose_prior=prior) if prior is not None else config
        self._set(preset=preset, config=config, problems=())
        self._tab.say("Settings taken over")

    def _prior(self, given: Any) -> Any:
        """A pose prior as it was entered; one that is no name is a file, which this page must be allowed to name."""
        known = not isinstance(given, str) or given in (*POSE_PRIORS, self._tab.state.settings.config.pose_prior)
        return given if known else str(self._tab.files.path(given))

    @property
    def _camera(self) -> Any:
        return self._tab.session.project.clip.camera

    # --- drawing ---

    def draw(self) -> None:
        """Send what changed."""
        now = self._tab.state.settings
        if not self._tab.sent.differs("fit settings", now) and not self._waiting:
            return
        wrong = dict(now.problems)
        pair = {"kind", "gender"}
        for name, field in self._fields.items():
            if name == "pose_prior" and isinstance(field, Dropdown):
                field.offer(pose_priors(now.config.pose_prior), now.config.pose_prior, wrong=name in wrong)
            else:
                field.show(self._reads[name](now), wrong=name in wrong and name not in pair)
        names = differences(now.config, now.preset)
        said = ", ".join(map(words, names)) if len(names) < 8 else f"{len(names)} settings"
        back = row(button("Back to the preset", "fit.preset", hint="Sets all settings as the preset has them"))
        self._changed.show(*([paragraph(joined(text("Changed: "), marked(said, "strong"))), back] if names else []))
        self._focal.show(paragraph(self._focal_text(now), "dim"))
        self._problems.show(*(paragraph(problem, "bad") for problem in wrong.values()))
        self._draw_source(now)

    @property
    def _waiting(self) -> bool:
        return any(field.waiting for field in self._fields.values())

    def _focal_text(self, now: FitSettings) -> str:
        camera = self._camera
        if now.focal is None:
            return f"px, from the clip: {camera.source}"
        return f"px, set here; the clip's is {camera.focal[0]:.2f} ({camera.source})"

    def _draw_source(self, now: FitSettings) -> None:
        key = (now.preset, now.config)
        if key != self._source_of:
            self._source_of = key
            self._source.value = as_toml(now.config, preset_name=now.preset)
