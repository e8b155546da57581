"""The settings of the next fit: inputs for those changed most often, and all others as TOML."""

from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any, get_args

import viser

from fitting_core.body.files.forms import KINDS
from fitting_core.body.files.registry import GENDERS
from fitting_core.config.schema import POSE_PRIORS, PRESETS, FitConfig
from fitting_core.config.settings import RANGES, Range, changed, settings, value_of
from fitting_core.config.toml import as_toml, parsed
from fitting_core.errors import InputError
from fitting_core.files.toml_text import parsed_toml
from fitting_core.priors.files.registry import list_priors
from tcfit_app.review.gestures.fitting import camera_of
from tcfit_app.review.panels.elements.camera_input import CameraInput
from tcfit_app.review.panels.elements.field import Dropdown, Field, Number, NumberField, for_writers
from tcfit_app.review.panels.elements.html import Board, button, joined, paragraph, row, tag, text
from tcfit_app.review.panels.elements.html import words as marked
from tcfit_app.review.panels.fit.given_inputs import GivenInputs
from tcfit_app.review.panels.fit.perspective import LENSES, Perspective, focal_of_lens, metre_in_pixels
from tcfit_app.review.tab.buttons import one_of
from tcfit_app.review.tab.state import FitSettings
from tcfit_app.review.tab.tab import Tab

ORIGIN = "Fit settings"
"""What messages call the source of wrong values."""
LABELS = {
    "temporal.weight": "w_T",
    "temporal.window_size": "Window",
    "temporal.mode": "Mode",
    "temporal.space": "Space",
    "shape_sample.size": "Shape frames",
    "shape_sample.strategy": "Selected by",
    "shape_sample.seed": "Seed",
    "solver": "Solver",
    "pose_prior": "Pose prior",
    "keypoint_noise": "Keypoint noise",
    "silhouettes": "Silhouettes",
    "height": "Height (cm)",
}
"""Settings with an input of their own, with short labels."""
_CHOICES: dict[str, Any] = {"sliding window": "sliding_window", "on": True, "off": False}
"""Choices shown in other words, by those words."""
CHOICE_WORDS = {str(choice): word for word, choice in _CHOICES.items()}
"""The words for each choice, by its text."""
_HINTS = {
    "temporal.weight": "Weight of consistency over time: the higher, the smoother",
    "temporal.mode": "How consistency over time is solved: a sliding window as in the paper, or all frames at once",
    "temporal.window_size": "Frames per sliding window; not used in global mode",
    "temporal.space": "Consistency over time compares joints relative to the body, or in the camera's space",
    "shape_sample.size": "Number of frames that determine the shared shape",
    "shape_sample.strategy": "How they are selected: at random, the most confident, or so that all parts are visible",
    "shape_sample.seed": "Seed of the random selection",
    "solver": "lm: Levenberg-Marquardt. lbfgs: L-BFGS, as in the paper",
    "pose_prior": "What counts as a likely pose",
    "keypoint_noise": "The detector whose noise model weights the keypoints; auto: the one that found them",
    "silhouettes": "Also fit the shape to the person's silhouette (Shift+U shows it)",
    "height": "The person's height without shoes; it determines the distance",
}
_MOST = {"temporal.weight": 1e5, "shape_sample.seed": 999_999_999}
"""Bounds where the settings have none: nothing improves beyond them."""
_FOCAL = (1.0, 1e6)
_OF_FRAMES = ("temporal.window_size", "shape_sample.size")
"""Numbers of frames, limited by the clip's length."""
_BODY = frozenset(("kind", "gender"))
_TOGETHER = (_BODY,)
"""Inputs whose values are valid or invalid together: a right one settles the problem of the other."""
_SOURCE = "All settings"
_LISTED = 80
"""Characters that fit on two lines."""


_NEED_FRAMES = (
    *("temporal.weight", "temporal.mode", "temporal.window_size", "temporal.space"),
    *("shape_sample.size", "shape_sample.strategy", "shape_sample.seed"),
)
"""Settings that make no difference to a clip of one frame."""


@lru_cache(256)
def without_effect(config: FitConfig, frames: int) -> frozenset[str]:
    """Dotted names of the settings that change nothing in a clip of that many frames, because of other settings."""
    found = {*_NEED_FRAMES} if frames == 1 else set()
    if config.temporal.weight == 0:
        found |= {"temporal.mode", "temporal.window_size", "temporal.space"}
    if config.temporal.mode == "global":
        found.add("temporal.window_size")
    if config.shape_sample.strategy != "random":
        found.add("shape_sample.seed")
    return frozenset(found)


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
    label = LABELS.get(name, name)
    return label if label == "w_T" else label[0].lower() + label[1:]


def pose_priors(now: str) -> tuple[str, ...]:
    """Those on this computer, and the current one."""
    latent = [prior.name for prior in list_priors() if not prior.problem]
    there = [name for name in POSE_PRIORS if name in ("axis_angle", "relaxed") or name in latent]
    return tuple(dict.fromkeys([*there, now]))


class FitInputs:
    """Inputs for a tab's `FitSettings`."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._gui = tab, tab.client.gui
        self._fields: dict[str, Field[Any]] = {}
        self._reads: dict[str, Callable[[FitSettings], Any]] = {}
        self._height = tab.session.project.height
        """The project's, as this tab knows it."""

    # --- elements ---

    def add_preset(self) -> None:
        """The preset, what differs from it or is wrong, and the way back; always the same height, so that inputs below
        do not move under the pointer."""
        now = self._tab.state.settings
        handle = self._gui.add_dropdown(
            "Preset",
            tuple(PRESETS),
            initial_value=now.preset,
            hint="tcfit: best results; paper and smplifyx: as published",
        )
        self._add("preset", handle, self._take_preset, lambda s: s.preset)
        self._changed = Board(self._tab)
        self._tab.buttons.on("fit.preset", lambda _: self._take_preset(self._tab.state.settings.preset))

    def add(self, *names: str) -> None:
        """Inputs for settings in LABELS."""
        for name in names:
            value, setting = value_of(self._tab.state.settings.config, name), settings()[name]
            if isinstance(value, int | float) and not isinstance(value, bool):
                self._add_number(name, self._number(name), _HINTS[name], self._taker(name), self._reader(name))
            else:
                self._add(
                    name,
                    self._choice(name, value, get_args(setting.type) or (True, False)),
                    self._taker(name),
                    self._reader(name),
                )

    def add_height(self) -> None:
        """The person's height, or nothing; stored in the project."""
        known = RANGES["height"]
        number = Number(label=LABELS["height"], low=known.low, high=known.high, of="leave it empty if unknown")

        def take(typed: str) -> None:
            self._taker("height")(number.read(typed) if typed.strip() else "none")
            if not (project := self._tab.session.project).read_only:
                project.set_height(self._tab.state.settings.config.height)
                self._height = project.height

        def read(now: FitSettings) -> str:
            return "" if now.config.height is None else number.shown(now.config.height)

        hint = f"{_HINTS['height']}. {number.range.capitalize()}."
        handle = self._gui.add_text(number.label, read(self._tab.state.settings), hint=hint)
        self._add("height", handle, take, read)

    def add_body(self) -> None:
        """Body model and gender."""
        now, gui = self._tab.state.settings, self._gui
        hint = "The model of the body file"
        kinds = gui.add_dropdown("Body model", tuple(KINDS), initial_value=now.kind, hint=hint)
        self._add("kind", kinds, lambda v: self._take_body(kind=v), lambda s: s.kind)
        genders = gui.add_dropdown("Gender", GENDERS, initial_value=now.gender, hint="Which variant of the model")
        self._add("gender", genders, lambda v: self._take_body(gender=v), lambda s: s.gender)

    def add_camera(self) -> None:
        """The focal length, and what it means."""
        clip = self._camera.focal[0]
        number = Number(label="Focal length", low=_FOCAL[0], high=_FOCAL[1], of="pixels")
        hint = "For whole fits; a re-run keeps its run's focal length"
        self._add_number("focal", number, hint, self._take_focal, lambda s: round(float(s.focal or clip), 2))
        self._focal = Board(self._tab)
        self._tab.buttons.on("fit.lens", self._take_lens, one_of(LENSES))
        self._tab.buttons.on("fit.clip_focal", lambda _: self._set(focal=None))
        self._calibration = CameraInput(self._tab, "fit.camera")

    def add_given(self) -> None:
        """A known start and shape."""
        self._given = GivenInputs(self._tab, self.attempt)

    def add_source(self) -> None:
        """All settings as editable text."""
        self._source = self._gui.add_text("TOML", "", multiline=True)
        for_writers(self._tab, self._source)
        self._source_of: Hashable = None
        Board(self._tab).show(row(button("Use these settings", "fit.source")))
        self._tab.buttons.on("fit.source", lambda _: self._take_source())

    def _choice(self, name: str, value: Any, options: tuple[Any, ...]) -> Any:
        label, hint = LABELS[name], _HINTS[name]
        if name == "pose_prior":
            return self._gui.add_dropdown(label, pose_priors(value), initial_value=value, hint=hint)
        shown = tuple(CHOICE_WORDS.get(str(option), str(option)) for option in options)
        return self._gui.add_dropdown(label, shown, initial_value=CHOICE_WORDS.get(str(value), value), hint=hint)

    def _number(self, name: str) -> Number:
        """The valid range of a setting for this clip."""
        known, whole = RANGES.get(name, Range()), settings()[name].type is int
        length = self._tab.length
        if name in _OF_FRAMES:
            of = f"the clip has {length} frames"
            return Number(label=LABELS[name], low=known.low, high=max(length, known.low), whole=whole, of=of)
        return Number(label=LABELS[name], low=known.low, high=_MOST[name], whole=whole)

    def _add_number(
        self, name: str, number: Number, hint: str, take: Callable[[float], None], read: Callable[[FitSettings], float]
    ) -> None:
        now = number.shown(read(self._tab.state.settings))
        handle = self._gui.add_text(number.label, now, hint=f"{hint}. {number.range.capitalize()}.")
        self._add(name, handle, lambda typed: take(number.read(typed)), lambda s: number.shown(read(s)))

    def _add(self, name: str, handle: Any, take: Callable[[Any], None], read: Callable[[FitSettings], Any]) -> None:
        if isinstance(handle, viser.GuiDropdownHandle):
            kind: type[Field[Any]] = Dropdown
        else:
            kind = NumberField
        for_writers(self._tab, handle)
        self._fields[name] = kind(self._tab, handle, lambda value: self.attempt(name, lambda: take(value)))
        self._reads[name] = read

    # --- what is entered ---

    def attempt(self, name: str, take: Callable[[], None]) -> None:
        """Apply a value; if it is invalid, remember why."""
        group = next((group for group in _TOGETHER if name in group), {name})
        try:
            take()
            why = ""
        except InputError as error:
            why = str(error)
        # Read after `take`, which may settle problems of other inputs.
        others = [(other, text) for other, text in self._tab.state.settings.problems if other not in group]
        self._set(problems=(*others, *([(name, why)] if why else [])))

    def _set(self, **values: Any) -> None:
        self._tab.set(settings=replace(self._tab.state.settings, **values))

    def _take_preset(self, name: str) -> None:
        self._set(preset=name, config=self._tab.session.preset(name), problems=())

    def _taker(self, name: str) -> Callable[[Any], None]:
        def take(value: Any) -> None:
            value = _CHOICES.get(value, value)
            value = self._prior(value) if name == "pose_prior" else value
            self._set(config=changed(self._tab.state.settings.config, {name: value}, origin=ORIGIN))

        return take

    def _reader(self, name: str) -> Callable[[FitSettings], Any]:
        def read(now: FitSettings) -> Any:
            value = value_of(now.config, name)
            return CHOICE_WORDS.get(str(value), value)

        return read

    def _take_body(self, **values: str) -> None:
        self._set(**values)
        now = self._tab.state.settings
        self._tab.session.bodies.check(kind=now.kind, gender=now.gender)

    def _take_focal(self, value: float) -> None:
        same = value == round(float(self._camera.focal[0]), 2)
        now = replace(self._tab.state.settings, focal=None if same else float(value))
        camera_of(now, self._camera)
        self._set(focal=now.focal)

    def _take_lens(self, name: str) -> None:
        self.attempt("focal", lambda: self._take_focal(round(focal_of_lens(name, self._camera.size), 2)))

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
    def _camera(self) -> Any:
        return self._tab.session.project.footage.camera

    # --- drawing ---

    def draw(self) -> None:
        """Send what changed."""
        self._calibration.draw()
        now = self._tab.state.settings
        wrong, idle = dict(now.problems), without_effect(now.config, self._tab.length)
        self._follow_height()
        for name, field in self._fields.items():
            if name == "pose_prior" and isinstance(field, Dropdown):
                prior = now.config.pose_prior
                there = self._tab.once("pose priors", now, lambda: pose_priors(now.config.pose_prior))
                field.offer(there, prior, wrong=name in wrong)
            else:
                field.enable(name not in idle and not self._tab.session.project.read_only)
                field.show(self._reads[name](now), wrong=name in wrong and name not in _BODY)
        self._draw_changed(now)
        self._draw_focal(now)
        self._given.draw()
        self._draw_source(now)

    def _follow_height(self) -> None:
        """Take over a height that was given in another tab, which the project keeps."""
        height = self._tab.session.project.height
        if height != self._height:
            self._height = height
            self._set(config=replace(self._tab.state.settings.config, height=height))

    def _draw_changed(self, now: FitSettings) -> None:
        names, problems = differences(now.config, now.preset, self._tab.length), [why for _, why in now.problems]
        listed = ", ".join(map(words, names)) or "nothing"
        said = listed if len(listed) <= _LISTED else f"{len(names)} settings"
        more = f" ({len(problems) - 1} more)" if len(problems) > 1 else ""
        told = (
            marked(problems[0] + more, "bad")
            if problems
            else joined(text("Changed from the preset: "), marked(said, "strong"))
        )
        hint = "Resets all settings to the preset"
        back = button("Back to the preset", "fit.preset", disabled=not names and not problems, hint=hint)
        self._changed.show(tag("p", told, class_="tcfit-two-lines", title="\n".join(problems) or listed), row(back))

    def _draw_focal(self, now: FitSettings) -> None:
        tab, camera = self._tab, self._camera
        detected = tab.session.project.detections
        metre = tab.once("metre", id(detected), lambda: metre_in_pixels(detected))
        seen = Perspective(focal=now.focal or camera.focal[0], size=camera.size, metre=metre)
        lenses = [button(name, "fit.lens", name, kind="mini", hint=f"{mm:g} mm") for name, mm in LENSES.items()]
        self._focal.show(
            paragraph(self._focal_text(now), "dim"),
            row(*lenses, button("clip's own", "fit.clip_focal", kind="mini", disabled=now.focal is None), wrap=True),
            paragraph(seen.words),
        )

    def _focal_text(self, now: FitSettings) -> str:
        camera = self._camera
        if now.focal is None:
            return "The clip's own, in pixels."
        return f"Set here, in pixels; the clip's own is {camera.focal[0]:.2f}."

    def _draw_source(self, now: FitSettings) -> None:
        key = (now.preset, now.config)
        if key != self._source_of:
            self._source_of = key
            self._source.value = as_toml(now.config, preset_name=now.preset)
