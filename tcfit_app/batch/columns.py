"""The columns of a list of clips, and the conversion of their cells."""

import re
from dataclasses import dataclass
from functools import cache, reduce
from operator import or_
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.config.choices import FocalRule, Up
from fitting_core.config.schema import PRESETS
from fitting_core.config.settings import Range, nearest, settings
from fitting_core.files.regular import at_home
from tcfit_app.options.fit import SHORTCUTS, BodyOptions, StartOptions, ViewOptions
from tcfit_app.options.removed import SETTINGS

Group = Literal["files", "batch", "clip", "camera", "views", "body", "start", "preset", "setting"]
"""The group of options that a column belongs to."""
FILES = ("video", "keypoints", "out", "shape")
FOCAL = ("focal_length", "fov", "focal_length_35mm", "camera")
"""Options that exclude each other."""
OF_CAMERA_FILE = ("camera_name", "camera_unit", "camera_up")
"""Options of a camera file."""
_OPTIONS: dict[Group, type] = {
    "clip": ClipOptions,
    "camera": CameraOptions,
    "views": ViewOptions,
    "body": BodyOptions,
    "start": StartOptions,
}
_CHOICES = {
    "gender": ("neutral", "male", "female", "child"),
    "keypoint_scale": ("auto", "pixels", "0..1", "-1..1"),
    "preset": tuple(PRESETS),
}
LEAST_PART = Range(0.1)
"""Range of the minutes of a part."""
_NUMBERS = {
    "person": Range(0),
    "first_frame": Range(0),
    "other_person": Range(0),
    "other_first_frame": Range(0),
    "other_focal_length": Range(open=True),
    "last_frame": Range(0),
    "start_person": Range(0),
    "start_first_frame": Range(0),
    "frame_rate": Range(open=True),
    "image_size": Range(1),
    "focal_length": Range(open=True),
    "fov": Range(0, 180, open=True),
    "focal_length_35mm": Range(open=True),
    "camera_unit": Range(open=True),
    "part_minutes": LEAST_PART,
}
_NAME_OR_PATH = ("body_model", "pose_prior", "detector")
_SEPARATORS = re.compile(r"\s*[x×,;\s]\s*")


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column, by its name in the header."""

    name: str
    group: Group
    type: Any = str
    """Type of a cell's value."""
    setting: str = ""
    """The dotted name, in the group "setting"."""

    def value(self, text: str, folder: Path) -> Any:
        """The value of a cell. Raises ValueError, with what is expected, if the text is not valid.

        Args:
            text: Not empty.
            folder: Folder of relative paths.
        """
        if self.type is Path:
            return folder / at_home(text)
        if self.name in _NAME_OR_PATH and (folder / at_home(text)).exists():
            return str(folder / at_home(text))
        if self.group == "setting":
            return text
        value = _converted(text, self.type)
        if self.name in _CHOICES and value not in _CHOICES[self.name]:
            raise ValueError(f"{text!r}; expected one of {', '.join(_CHOICES[self.name])}")
        allowed = _NUMBERS.get(self.name)
        numbers = value if isinstance(value, tuple) else () if isinstance(value, str) else (value,)
        if allowed and any(number not in allowed for number in numbers):
            raise ValueError(f"{text}; expected {_WORDS[self.type]}, {allowed}")
        return value


@cache
def columns() -> dict[str, Column]:
    """All columns by name, except those with the dotted name of a setting; see `find`."""
    named = [Column(name=name, group="files", type=Path) for name in FILES]
    for group, kind in _OPTIONS.items():
        hints = get_type_hints(kind)
        named += [Column(name=name, group=group, type=_plain(hint)) for name, hint in hints.items()]
    named += [Column(name="part_minutes", group="batch", type=float), Column(name="preset", group="preset")]
    named += [Column(name=option, group="setting", setting=name) for option, name in (SHORTCUTS | SETTINGS).items()]
    return {column.name: column for column in named}


def find(header: str) -> Column | None:
    """The column of a header cell, or None; case, hyphens and spaces are ignored."""
    name = re.sub(r"[-\s]+", "_", header.strip().lower())
    if name in settings():
        return Column(name=name, group="setting", setting=name)
    return columns().get(name)


def suggestion(header: str) -> str:
    """The message for an unknown column."""
    if header.lower() == "subject":
        return "the column subject was removed; fit one of its clips, and name the result as shape of the others"
    near = nearest(header, [*columns(), *settings()])
    expected = ", ".join(name for name in columns() if name not in SETTINGS)
    known = f"did you mean {' or '.join(near)}?" if near else f"expected {expected}, or a setting's name"
    return f"there is no column {header!r}; {known}"


def _plain(hint: Any) -> Any:
    """A type without "or None"; of an option that can be repeated, that of one value."""
    if get_origin(hint) is tuple and hint not in _WORDS:
        return get_args(hint)[0]
    if get_origin(hint) in (UnionType, Union):
        return reduce(or_, (kind for kind in get_args(hint) if kind is not NoneType))
    return hint


def _converted(text: str, kind: Any) -> Any:
    parts: Any = _SEPARATORS.split(text.strip("()[] ")) if get_origin(kind) is tuple else text
    try:
        return msgspec.convert(parts, kind, strict=False)
    except msgspec.ValidationError as error:
        raise ValueError(f"{text!r}; expected {_WORDS[kind]}") from error


_WORDS: dict[Any, str] = {
    str: "a text",
    int: "a whole number",
    int | Literal["auto"]: "a whole number or auto",
    float: "a number",
    float | FocalRule: "a number, auto or diagonal",
    Up: f"one of {', '.join(get_args(Up))}",
    tuple[int, int]: "two whole numbers such as 640x480",
    tuple[float, float]: "two numbers such as 320 240",
}
