"""Every setting of a FitConfig by its dotted name: type, meaning, range, and how a text becomes its value.

The command line, TOML files and the settings' listing all go through this table, which is read off their classes.
"""

import ast
import difflib
import math
import re
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, lru_cache, reduce
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from fitting_core.config import schema, weights
from fitting_core.config.schema import POSE_PRIORS, FitConfig
from fitting_core.errors import InputError
from fitting_core.files.regular import at_home

NONE = "none"
"""How a setting that can be left open is written: neither TOML nor a command line has a null."""
_OPEN = {"pose_prior": "{" + ",".join(POSE_PRIORS) + "}|PATH"}
"""Texts that are a name or something else."""
_DEVICE = re.compile(r"cpu|mps|cuda(:\d+)?")


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One field of FitConfig or of a dataclass inside it."""

    name: str
    """Dotted: "weights.body_pose"."""
    type: Any
    doc: str

    @property
    def group(self) -> str:
        """What stands before the last dot; empty for FitConfig's own fields."""
        return self.name.rpartition(".")[0]

    @property
    def metavar(self) -> str:
        """The values that it takes, in short: "{lm,lbfgs}", "NUMBER"."""
        return _OPEN[self.name] if self.name in _OPEN else _METAVARS[_form(self.type)](self.type)

    @property
    def expected(self) -> str:
        """The values that it takes, in words."""
        return _WORDS[_form(self.type)](self.type)


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`, both included unless `open`."""

    low: float = 0.0
    high: float = math.inf
    open: bool = False

    def __contains__(self, value: float) -> bool:
        inside = self.low < value < self.high if self.open else self.low <= value <= self.high
        return inside and value != math.inf

    def __str__(self) -> str:
        if self.open:
            return f"above {self.low:g}" + ("" if self.high == math.inf else f" and below {self.high:g}")
        return f"{self.low:g} or more" if self.high == math.inf else f"{self.low:g} to {self.high:g}"


_STAGES, _POSITIVE, _TOLERANCE = Range(1, 5), Range(open=True), Range(0, 1, open=True)
RANGES: dict[str, Range] = {
    "shape_sample.size": Range(1),
    "shape_sample.stages": _STAGES,
    "temporal.stages": _STAGES,
    "temporal.window_size": Range(2),
    "settings.iterations": Range(1),
    "settings.rounds": Range(1),
    "settings.stage_tolerance": _TOLERANCE,
    "settings.final_tolerance": _TOLERANCE,
    "settings.sequence_tolerance": _TOLERANCE,
    "settings.camera_tolerance": _TOLERANCE,
    "settings.relative_tolerance": _TOLERANCE,
    "hand_components": Range(1, 45),
    "robust_pixels": _POSITIVE,
    "robust_pixels_fine": _POSITIVE,
    "robust_at_height": _POSITIVE,
    "start_deviation": _POSITIVE,
    "height": Range(50, 250),
    "key_frames_every": Range(1),
}
"""Numbers of all other settings are finite and 0 or more."""
LARGEST = 1e12
"""The largest number of any setting: the square of a larger one soon leaves the range of a float32."""


@cache
def settings() -> dict[str, Setting]:
    """All settings by dotted name, in the order of their classes."""
    return {setting.name: setting for setting in _settings_of(FitConfig, "")}


@cache
def groups() -> dict[str, str]:
    """What each group of settings is about, by its name."""
    hints = get_type_hints(FitConfig)
    return {
        f.name: (hints[f.name].__doc__ or "").split("\n")[0] for f in fields(FitConfig) if is_dataclass(hints[f.name])
    }


def _settings_of(kind: type, prefix: str) -> Iterator[Setting]:
    hints, docs = get_type_hints(kind), _field_docs()[kind.__name__]
    for field in fields(kind):
        name, hint = prefix + field.name, hints[field.name]
        if isinstance(hint, type) and is_dataclass(hint):
            yield from _settings_of(hint, f"{name}.")
        else:
            yield Setting(name=name, type=hint, doc=docs.get(field.name, ""))


@cache
def _field_docs() -> dict[str, dict[str, str]]:
    """The strings below the fields of the configuration's classes: by class, by field."""
    paths = (Path(weights.__file__), Path(schema.__file__))
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in paths]
    found: dict[str, dict[str, str]] = {}
    for kind in (node for tree in trees for node in tree.body if isinstance(node, ast.ClassDef)):
        pairs = zip(kind.body, kind.body[1:], strict=False)
        found[kind.name] = {
            field.target.id: " ".join(ast.literal_eval(text.value).split())
            for field, text in pairs
            if isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
        }
    return found


def value_of(config: FitConfig, name: str) -> Any:
    """The value of the setting with this dotted name."""
    return reduce(getattr, name.split("."), config)


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


def changed(config: FitConfig, values: Mapping[str, Any], *, origin: str, texts: bool = False) -> FitConfig:
    """A configuration with other values of some settings. Raises InputError if a name is not known, or a value has a
    wrong type, count, choice or range.

    Args:
        config: What stays for all others.
        values: By dotted name.
        origin: Where the values stand, for messages: a file's name, "--set".
        texts: The values are texts as on a command line: lists separated by commas, numbers not yet read.
    """
    for name, value in values.items():
        if name not in settings():
            raise InputError(f"{origin}: {unknown(name)}")
        config = _replaced(config, name.split("."), _converted(settings()[name], value, origin, texts))
    _check_ranges(config, origin, list(values))
    return config


def check(config: FitConfig, *, origin: str = "The configuration") -> None:
    """Raise InputError if a number is outside its range, or the device is invalid or lacks the precision."""
    _check_ranges(config, origin, list(settings()))
    # Not where single settings change: one of the two always comes first.
    if config.device == "mps" and config.precision == "float64":
        raise InputError(
            f"{origin}: device mps cannot compute in float64, which Apple's GPUs do not have. Set precision to float32 "
            "or device to cpu."
        )


def unknown(name: str, among: list[str] | None = None) -> str:
    """A sentence that a name is not known, with the names that may have been meant."""
    near = nearest(name, list(settings()) if among is None else among)
    hint = f"did you mean {' or '.join(near)}?" if near else "`tcfit settings` lists them all."
    return f"there is no setting {name!r}; {hint}"


def nearest(name: str, known: list[str]) -> list[str]:
    """Up to three known dotted names that end, or else look, like the given one, nearest first."""
    wanted = name.lower().replace("-", "_")
    if leaves := [k for k in known if k.rpartition(".")[2] == wanted.rpartition(".")[2]]:
        return leaves[:3]
    close = difflib.get_close_matches(wanted, known, n=3, cutoff=0.6)
    # "temporal_weight" and "bodypose" are far from their dotted names, but not once the dots are gone or cut off.
    plain = {k.replace(".", "_"): k for k in known} | {k.rpartition(".")[2]: k for k in known}
    similar = [plain[match] for match in difflib.get_close_matches(wanted, list(plain), n=3, cutoff=0.75)]
    return list(dict.fromkeys([*similar, *close]))[:3]


def _replaced(value: Any, path: list[str], new: Any) -> Any:
    first, *rest = path
    return replace(value, **{first: _replaced(getattr(value, first), rest, new) if rest else new})


def _converted(setting: Setting, value: Any, origin: str, texts: bool) -> Any:
    form = _form(setting.type)
    kind, read = setting.type, value
    if form.startswith("optional"):
        if isinstance(value, str) and value.strip().lower() == NONE:
            return None
        kind = get_args(setting.type)[0]
    if texts:
        read = [part.strip() for part in value.strip("[]() ").split(",")] if "tuple" in form else value.strip()
    try:
        return msgspec.convert(read, kind, strict=not texts)
    except msgspec.ValidationError as error:
        shown = value if texts else _shown(value)
        raise InputError(f"{origin}: {setting.name} is {shown}; expected {setting.expected}.") from error


def _shown(value: Any) -> str:
    """A value as TOML writes it, cut off where it is long."""
    text = msgspec.json.encode(value, enc_hook=str).decode()
    return text if len(text) <= 80 else text[:77] + "..."


def _number(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)[:40]


def _check_ranges(config: FitConfig, origin: str, names: list[str]) -> None:
    for name in names:
        value = value_of(config, name)
        numbers = value if isinstance(value, tuple) else (value,)
        numbers = [n for n in numbers if isinstance(n, int | float) and not isinstance(n, bool)]
        allowed = RANGES.get(name, Range())
        if wrong := [n for n in numbers if n not in allowed or n > LARGEST]:
            most = f", at most {LARGEST:g}" if wrong[0] > LARGEST else ""
            raise InputError(f"{origin}: {name} is {_number(wrong[0])}; expected {allowed}{most}.")
        if value == ():
            raise InputError(f"{origin}: {name} is empty; expected at least one number, {allowed}.")
    prior = config.pose_prior
    known = prior in POSE_PRIORS or (prior != "" and at_home(prior).exists())
    if "pose_prior" in names and not known:
        raise InputError(
            f"{origin}: pose_prior is {prior!r}, neither a name nor an existing file; expected one of "
            f"{', '.join(POSE_PRIORS)}, or the path of VPoser (folder, snapshot or download) or of a pose prior's npz."
        )
    if "device" in names and not _DEVICE.fullmatch(config.device):
        raise InputError(f"{origin}: device is {config.device!r}; expected cpu, cuda, cuda:1 (or another number), mps.")


def _form(kind: Any) -> str:
    """Which row of the tables below describes a type."""
    if get_origin(kind) in (Union, types.UnionType):
        return f"optional {_form(get_args(kind)[0])}"
    if get_origin(kind) is Literal:
        return "choice"
    if get_origin(kind) is tuple:
        return "open tuple" if get_args(kind)[-1] is Ellipsis else "tuple"
    return kind.__name__


def _choices(kind: Any) -> list[str]:
    return [str(choice) for choice in get_args(kind)]


_METAVARS = {
    "choice": lambda kind: "{" + ",".join(_choices(kind)) + "}",
    "tuple": lambda kind: ",".join(f"W{i}" for i in range(1, 1 + len(get_args(kind)))),
    "open tuple": lambda kind: "N,N,...",
    "optional float": lambda kind: "NUMBER|none",
    "float": lambda kind: "NUMBER",
    "int": lambda kind: "N",
    "bool": lambda kind: "{true,false}",
    "str": lambda kind: "TEXT",
}
_WORDS = {
    "choice": lambda kind: "one of " + ", ".join(_choices(kind)),
    "tuple": lambda kind: f"{len(get_args(kind))} numbers, one for each stage",
    "open tuple": lambda kind: "a list of whole numbers",
    "optional float": lambda kind: f'a number or "{NONE}"',
    "float": lambda kind: "a number",
    "int": lambda kind: "a whole number",
    "bool": lambda kind: "true or false",
    "str": lambda kind: "a text",
}
